//! `cargo xtask bench`: criterion over the whole workspace.

use std::path::Path;

use crate::cargo::{cargo, run};
use crate::failure::Failure;
use crate::output;
use crate::provenance::provenance;

/// What to measure.
#[derive(clap::Args)]
pub(crate) struct BenchArgs {
    /// Only benchmarks whose name contains one of these words, such as `build` or `saoh/100000`
    #[arg(value_name = "NAME")]
    names: Vec<String>,

    /// Stop each benchmark as soon as criterion is sure enough: minutes instead of an hour, with wider
    /// intervals
    #[arg(long)]
    quick: bool,
}

/// Runs every criterion benchmark, or those that the names pick.
pub(crate) fn bench(args: &BenchArgs) -> Result<(), Failure> {
    // `--benches` would also run unit tests in bench mode, whose harness does not know criterion's options.
    let targets = bench_targets()?;
    let mut command = cargo(&["bench", "--workspace", "--locked"]);
    for target in &targets {
        command.args(["--bench", target]);
    }
    command.arg("--");
    if args.quick {
        command.arg("--quick");
    }
    if !args.names.is_empty() {
        command.arg(filter(&args.names));
    }
    run(command, "the lines above name the benchmark that failed")?;
    let metadata = crate::cargo::metadata()?;
    let folder = Path::new(metadata["target_directory"].as_str().unwrap_or("target")).join("criterion");
    // Criterion's own files name no machine.
    output::text(&folder.join("made_by.json"), &format!("{:#}\n", provenance()))?;
    eprintln!(
        "figures and curves: {}; what made them: made_by.json beside it; times are in nanoseconds",
        folder.join("report/index.html").display()
    );
    Ok(())
}

/// One regular expression for several plain words, since criterion takes one filter.
fn filter(names: &[String]) -> String {
    let escape = |name: &String| {
        name.chars().fold(String::new(), |mut escaped, c| {
            if !c.is_alphanumeric() && c != '_' && c != '/' && c != '-' {
                escaped.push('\\');
            }
            escaped.push(c);
            escaped
        })
    };
    names.iter().map(escape).collect::<Vec<_>>().join("|")
}

/// Names of the `[[bench]]` targets of all members.
fn bench_targets() -> Result<Vec<String>, Failure> {
    let metadata = crate::cargo::metadata()?;
    let members = metadata["workspace_members"].as_array().cloned().unwrap_or_default();
    let mut targets: Vec<String> = metadata["packages"]
        .as_array()
        .into_iter()
        .flatten()
        .filter(|package| members.contains(&package["id"]))
        .flat_map(|package| package["targets"].as_array().into_iter().flatten())
        .filter(|target| {
            target["kind"].as_array().is_some_and(|kinds| kinds.iter().any(|kind| kind == "bench"))
        })
        .filter_map(|target| target["name"].as_str().map(str::to_owned))
        .collect();
    targets.sort();
    targets.dedup();
    if targets.is_empty() {
        return Err(Failure::failed("no member of the workspace has a [[bench]] target"));
    }
    Ok(targets)
}

#[cfg(test)]
mod tests {
    use super::filter;

    #[test]
    fn names_are_words_not_expressions() {
        assert_eq!(filter(&["a.b".into(), "saoh/100000".into()]), r"a\.b|saoh/100000");
    }
}
