//! Calls of cargo and git in the workspace's root.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::failure::Failure;

/// The folder that holds the workspace's manifest.
pub(crate) fn workspace_root() -> PathBuf {
    // `cargo run` sets it to where the package is now; the compiled-in one serves a binary called directly.
    let package = std::env::var_os("CARGO_MANIFEST_DIR")
        .map(PathBuf::from)
        .filter(|folder| folder.join("src/check.rs").is_file())
        .unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")));
    package.parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf)
}

/// A call of the cargo that runs this program.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(program);
    command.args(arguments).current_dir(workspace_root());
    command
}

/// Says on standard error what it runs, and runs it with its output shown.
///
/// # Errors
/// `mend` in one line if it cannot be started or ends badly.
pub(crate) fn run(mut command: Command, mend: &str) -> Result<(), Failure> {
    let line = describe(&command);
    eprintln!("$ {line}");
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(Failure::failed(format!("`{line}` ended with {status}: {mend}"))),
        Err(error) => Err(Failure::failed(format!("`{line}` cannot be started ({error}): {mend}"))),
    }
}

/// As [`run`], but what the command says on standard output is returned instead of shown.
///
/// # Errors
/// `mend` in one line if it cannot be started or ends badly.
pub(crate) fn run_for_output(mut command: Command, mend: &str) -> Result<String, Failure> {
    let line = describe(&command);
    eprintln!("$ {line}");
    match command.stderr(Stdio::inherit()).output() {
        Ok(output) if output.status.success() => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        Ok(output) => Err(Failure::failed(format!("`{line}` ended with {}: {mend}", output.status))),
        Err(error) => Err(Failure::failed(format!("`{line}` cannot be started ({error}): {mend}"))),
    }
}

/// Standard output of a call that is not worth showing.
///
/// # Errors
/// `mend` in one line if it cannot be started or ends badly, with the first line it said.
pub(crate) fn output_of(mut command: Command, mend: &str) -> Result<String, Failure> {
    let line = describe(&command);
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| Failure::failed(format!("`{line}` cannot be started ({error}): {mend}")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let first = said.lines().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
        return Err(Failure::failed(format!("`{line}`: {first}: {mend}")));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Whether cargo knows a subcommand, such as `nextest`.
pub(crate) fn has_subcommand(name: &str) -> bool {
    cargo(&[name, "--version"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// `cargo metadata` of the workspace and all its dependencies, against the committed lock file.
///
/// # Errors
/// If cargo refuses: as a rule because `Cargo.lock` does not fit the manifests.
pub(crate) fn metadata() -> Result<serde_json::Value, Failure> {
    let text = output_of(
        cargo(&["metadata", "--format-version", "1", "--locked"]),
        "if Cargo.lock does not fit the manifests, run `cargo update --workspace` and commit it",
    )?;
    serde_json::from_str(&text)
        .map_err(|error| Failure::failed(format!("cargo metadata is not JSON: {error}")))
}

/// The command as a person would type it.
fn describe(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_stem().unwrap_or(command.get_program());
    let words = std::iter::once(program).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}
