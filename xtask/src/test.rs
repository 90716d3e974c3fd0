//! `cargo xtask test`: every test of the workspace, documentation and examples included.

use std::process::Command;

use crate::adapter;
use crate::cargo::{cargo, has_subcommand, run, run_for_output, workspace_root};
use crate::failure::Failure;

/// What to test.
#[derive(clap::Args)]
pub(crate) struct TestArgs {
    /// Fewer random cases per property (16 instead of 256), and no examples or documentation tests
    #[arg(long)]
    quick: bool,
}

/// Random cases per property in a quick run.
const QUICK_CASES: &str = "16";

/// The variable that seeds the cases of all properties.
const SEED_VARIABLE: &str = "PROPTEST_RNG_SEED";

/// The seed where the variable is not set: the same commit gives the same verdict on any day and machine.
const SEED: &str = "20200915";

/// Runs all tests. The test runner's own summary and what kernels were tested on are the last things it
/// prints.
pub(crate) fn test(args: &TestArgs) -> Result<(), Failure> {
    say_where_scenes_are();
    let adapter = adapter::find()?;
    eprintln!("{}", adapter.for_people());
    if !args.quick {
        run_doc_tests()?;
        run_examples()?;
    }
    run_tests(args.quick)?;
    // Again at the end, where a skip is seen.
    eprintln!("{}", adapter.for_people());
    Ok(())
}

/// Tests over real scenes say themselves when they skip; this line says it once, where it is seen.
fn say_where_scenes_are() {
    let scenes = std::env::var_os("LIGHTTREE_SCENES")
        .map_or_else(|| workspace_root().join("../shared/scenes"), std::path::PathBuf::from);
    if scenes.is_dir() {
        eprintln!("real scenes: found; the tests over them run");
    } else {
        eprintln!(
            "real scenes: none beside the workspace, so tests over them skip (LIGHTTREE_SCENES=FOLDER names one)"
        );
    }
}

fn run_tests(quick: bool) -> Result<(), Failure> {
    let nextest = has_subcommand("nextest");
    let runner: &[&str] = if nextest { &["nextest", "run"] } else { &["test"] };
    let mut command = cargo(runner);
    // Mesa's layer for choosing devices finds no display and says so on every start.
    command.env("NODEVICE_SELECT", "1");
    // The same features everywhere, so that no dependency is compiled twice for different steps.
    command.args(["--workspace", "--all-features", "--locked", "--lib", "--bins", "--tests"]);
    if nextest {
        command.args(["--no-fail-fast", "--status-level", "slow", "--cargo-quiet"]);
    } else {
        command.arg("--no-fail-fast");
    }
    if quick {
        command.env("PROPTEST_CASES", QUICK_CASES);
    }
    if std::env::var_os(SEED_VARIABLE).is_none() {
        eprintln!("random cases: seed {SEED} ({SEED_VARIABLE}=N looks at others)");
        command.env(SEED_VARIABLE, SEED);
    }
    run(command, "the lines above name the tests that failed")
}

fn run_doc_tests() -> Result<(), Failure> {
    let command = cargo(&["test", "--doc", "--workspace", "--all-features", "--locked", "--quiet"]);
    run(command, "the lines above name the documentation test that failed")
}

/// Every example of a member runs without arguments and checks its own result.
///
/// All are built in one call with the features of the tests: `cargo run --package` would choose other
/// features for each package, and compile the dependencies again.
fn run_examples() -> Result<(), Failure> {
    let mut command = cargo(&["build", "--workspace", "--all-features", "--locked", "--quiet"]);
    command.args(["--examples", "--message-format=json-render-diagnostics"]);
    let built = run_for_output(command, "the lines above name the example that does not compile")?;
    for line in built.lines() {
        let message: serde_json::Value = serde_json::from_str(line).unwrap_or_default();
        let is_example = message["target"]["kind"]
            .as_array()
            .is_some_and(|kinds| kinds.iter().any(|kind| kind == "example"));
        if let (true, Some(program)) = (is_example, message["executable"].as_str()) {
            run(Command::new(program), "the example's own lines above say what went wrong")?;
        }
    }
    Ok(())
}
