//! What committed files may not say: paths of the machine they were written on, or a second truth.

use std::process::Command;

use crate::cargo::{output_of, workspace_root};
use crate::failure::Failure;

/// Top folders of a machine's own paths; joined at run time so that this file does not find itself.
const MACHINE_FOLDERS: [&str; 6] = ["work", "farm", "root", "tmp", "home", "Users"];

/// Largest committed file, bytes: pictures in `docs/` are small, scenes stay outside.
const LARGEST: u64 = 1 << 20;

/// A call of git in the workspace's root.
pub(super) fn git(arguments: &[&str]) -> Command {
    let mut command = Command::new("git");
    command.args(arguments).current_dir(workspace_root());
    command
}

/// An unpacked archive has no committed files to look at.
pub(super) fn is_git_checkout() -> bool {
    output_of(git(&["rev-parse", "--is-inside-work-tree"]), "").is_ok()
}

/// Fails with each line that names a machine's folder, and each file that is too large.
pub(super) fn check() -> Result<(), Failure> {
    if !is_git_checkout() {
        eprintln!("note: not a git checkout, so committed text is not looked at");
        return Ok(());
    }
    let mut found = Vec::new();
    for path in committed_files()? {
        let file = workspace_root().join(&path);
        let Ok(bytes) = std::fs::read(&file) else {
            continue; // deleted in the working tree, or a link
        };
        if bytes.len() as u64 > LARGEST {
            found.push(format!("{path} has {} bytes, more than {LARGEST}", bytes.len()));
        }
        let Ok(text) = String::from_utf8(bytes) else {
            continue;
        };
        let lines = text.lines().enumerate().filter(|(_, line)| names_a_machine(line));
        found.extend(lines.map(|(i, line)| format!("{path}:{}: `{}`", i + 1, line.trim())));
    }
    if found.is_empty() {
        return Ok(());
    }
    Err(Failure::failed(format!("{}: take the machine's path or the large file out", found.join("; "))))
}

/// README and CHANGELOG quote the minimum supported Rust version (`Rust 1.x`; the latest stands first), but
/// no other than the manifest's.
pub(super) fn rust_version_agrees(stated: &str) -> Result<(), Failure> {
    for file in ["README.md", "CHANGELOG.md"] {
        let Ok(text) = std::fs::read_to_string(workspace_root().join(file)) else {
            continue;
        };
        let latest = text.lines().find(|line| line.contains("Rust 1."));
        if latest.is_some_and(|line| !line.contains(stated)) {
            return Err(Failure::failed(format!(
                "{file} says `{}` where Cargo.toml states rust-version {stated}: make them agree",
                latest.unwrap_or_default().trim()
            )));
        }
    }
    Ok(())
}

fn committed_files() -> Result<Vec<String>, Failure> {
    let list = output_of(git(&["ls-files", "-z"]), "is this folder a git checkout?")?;
    Ok(list.split('\0').filter(|path| !path.is_empty()).map(str::to_owned).collect())
}

/// Whether a line has an absolute path below one of the folders: nothing path-like may stand before it.
fn names_a_machine(line: &str) -> bool {
    MACHINE_FOLDERS.iter().any(|folder| {
        let path = format!("/{folder}/");
        line.match_indices(&path).any(|(at, _)| {
            let before = line[..at].chars().next_back();
            !before.is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | '/' | '}' | ')'))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::names_a_machine;

    #[test]
    fn absolute_paths_are_found_and_relative_ones_are_not() {
        let absolute = ["", "work", "main"].join("/");
        assert!(names_a_machine(&format!("see {absolute}")));
        assert!(names_a_machine(&format!("\"{absolute}\"")));
        assert!(!names_a_machine(&format!("target{absolute}")));
        assert!(!names_a_machine(&format!("..{absolute}")));
        assert!(!names_a_machine("work/main and tmp/x"));
    }
}
