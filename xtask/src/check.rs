//! `cargo xtask check`: everything that is judged without running a test.

mod licences;
mod text;

use crate::cargo::{cargo, has_subcommand, metadata, output_of, run};
use crate::failure::Failure;

type Check = fn() -> Result<(), Failure>;

/// Runs all checks, the quick ones first. Goes on after a failure, so that one run shows everything.
pub(crate) fn check() -> Result<(), Failure> {
    let checks: [(&str, Check); 9] = [
        ("Cargo.lock is committed and fits", lock_file),
        ("one glam", one_glam),
        ("licences", || licences::check(&metadata()?)),
        ("rust-version is stated once and true", rust_version),
        ("committed text", text::check),
        ("format", format),
        ("lints", lints),
        ("crates build alone", alone),
        ("documentation", documentation),
    ];
    let mut failed = Vec::new();
    for (name, check) in checks {
        match check() {
            Ok(()) => eprintln!("ok      {name}"),
            Err(failure) => {
                eprintln!("FAILED  {name}: {failure}");
                failed.push(name);
            }
        }
    }
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::failed(format!("{} of {} checks failed: {}", failed.len(), checks.len(), failed.join(", "))))
}

fn format() -> Result<(), Failure> {
    needs("fmt", "rustfmt")?;
    run(cargo(&["fmt", "--all", "--check"]), "run `cargo fmt --all`")
}

fn lints() -> Result<(), Failure> {
    needs("clippy", "clippy")?;
    let arguments = [
        "clippy",
        "--workspace",
        "--all-targets",
        "--all-features",
        "--locked",
        "--quiet",
        "--",
        "-D",
        "warnings",
    ];
    run(cargo(&arguments), "mend what clippy names above, or argue it with #[expect(lint, reason = \"...\")]")
}

fn documentation() -> Result<(), Failure> {
    let mut command = cargo(&["doc", "--workspace", "--no-deps", "--all-features", "--locked", "--quiet"]);
    command.env("RUSTDOCFLAGS", "-D warnings");
    run(command, "mend the links or code blocks that rustdoc names above")
}

/// Crates that others may take alone have to build with no feature, without their siblings' choices.
fn alone() -> Result<(), Failure> {
    let metadata = metadata()?;
    let members = metadata["workspace_members"].as_array().cloned().unwrap_or_default();
    // `publish = false` is an empty list of registries here, anything else none or some.
    let published = packages(&metadata).filter(|package| {
        members.contains(&package["id"]) && package["publish"].as_array().is_none_or(|list| !list.is_empty())
    });
    for package in published.filter_map(|package| package["name"].as_str()) {
        let command = cargo(&["check", "--package", package, "--no-default-features", "--locked", "--quiet"]);
        run(command, "the crate uses something that only a feature or another member brings")?;
    }
    Ok(())
}

/// `cargo metadata --locked` fails by itself where the lock file does not fit.
fn lock_file() -> Result<(), Failure> {
    metadata()?;
    if !text::is_git_checkout() {
        return Ok(());
    }
    let mend = "run `git add Cargo.lock` and commit it";
    output_of(text::git(&["ls-files", "--error-unmatch", "Cargo.lock"]), mend).map(drop)
}

/// obvhs and this workspace hand each other glam's types, so there must be one glam.
fn one_glam() -> Result<(), Failure> {
    let metadata = metadata()?;
    let versions: Vec<&str> = packages(&metadata)
        .filter(|package| package["name"] == "glam")
        .filter_map(|package| package["version"].as_str())
        .collect();
    match versions[..] {
        [_] => Ok(()),
        _ => Err(Failure::failed(format!(
            "Cargo.lock has {} versions of glam ({}): pin the dependency that brings the second to one that takes ours",
            versions.len(),
            versions.join(", ")
        ))),
    }
}

/// One `rust-version` for all members; older toolchains are refused by cargo, and this one has to be no
/// older.
fn rust_version() -> Result<(), Failure> {
    let metadata = metadata()?;
    let members = metadata["workspace_members"].as_array().cloned().unwrap_or_default();
    let mut stated: Vec<&str> = packages(&metadata)
        .filter(|package| members.contains(&package["id"]))
        .map(|package| package["rust_version"].as_str().unwrap_or("none"))
        .collect();
    stated.sort_unstable();
    stated.dedup();
    let [stated] = stated[..] else {
        return Err(Failure::failed(format!(
            "members state different rust-versions ({}): each manifest says `rust-version.workspace = true`",
            stated.join(", ")
        )));
    };
    let running = running_toolchain()?;
    if minor(&running) != minor(stated) {
        return Err(Failure::failed(format!(
            "Cargo.toml states rust-version {stated} and this is {running}: the statement is only true of a toolchain \
             that runs these checks, so use that toolchain or state this one"
        )));
    }
    text::rust_version_agrees(stated)
}

fn running_toolchain() -> Result<String, Failure> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = std::process::Command::new(rustc);
    command.arg("--version");
    let text = output_of(command, "install Rust")?;
    Ok(text.split_whitespace().nth(1).unwrap_or_default().to_owned())
}

/// Major and minor of a version: `1.95.0-nightly` and `1.95` are the same.
fn minor(version: &str) -> Option<(u32, u32)> {
    let mut numbers = version.split(['.', '-']).map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

fn needs(subcommand: &str, component: &str) -> Result<(), Failure> {
    if has_subcommand(subcommand) {
        return Ok(());
    }
    Err(Failure::failed(format!("cargo {subcommand} is missing: run `rustup component add {component}`")))
}

/// All packages that `cargo metadata` names.
fn packages(metadata: &serde_json::Value) -> impl Iterator<Item = &serde_json::Value> {
    metadata["packages"].as_array().into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::minor;

    #[test]
    fn versions_compare_by_minor() {
        assert_eq!(minor("1.95.0"), minor("1.95"));
        assert_eq!(minor("1.95.0-nightly"), minor("1.95"));
        assert_ne!(minor("1.96.0"), minor("1.95"));
        assert_eq!(minor("none"), None);
    }
}
