//! Licences of everything that is linked or built, against a list of what this workspace may hand on.

use spdx::{Expression, LicenseReq, ParseMode};

use crate::failure::Failure;

/// Permissive licences, all compatible with MIT OR Apache-2.0. Nothing that obliges a user to publish their
/// code.
const ALLOWED: [&str; 12] = [
    "0BSD",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Fails with every package whose licence expression the list does not satisfy.
pub(super) fn check(metadata: &serde_json::Value) -> Result<(), Failure> {
    let refused: Vec<String> = super::packages(metadata).filter_map(refusal).collect();
    if refused.is_empty() {
        return Ok(());
    }
    Err(Failure::failed(format!(
        "{}: replace the dependency, or argue the licence in xtask/src/check/licences.rs",
        refused.join("; ")
    )))
}

/// Why a package's licence is refused, if it is.
fn refusal(package: &serde_json::Value) -> Option<String> {
    let name = package["name"].as_str().unwrap_or("?");
    let Some(licence) = package["license"].as_str() else {
        return Some(format!("{name} states no licence"));
    };
    match Expression::parse_mode(licence, ParseMode::LAX) {
        Ok(expression) if expression.evaluate(is_allowed) => None,
        Ok(_) => Some(format!("{name} is under {licence}")),
        Err(_) => Some(format!("{name} has an unreadable licence, `{licence}`")),
    }
}

/// An exception (`WITH`) only ever allows more than its licence.
fn is_allowed(requirement: &LicenseReq) -> bool {
    requirement.license.id().is_some_and(|licence| ALLOWED.contains(&licence.name))
}

#[cfg(test)]
mod tests {
    use super::refusal;

    fn refuses(licence: &str) -> bool {
        refusal(&serde_json::json!({ "name": "a", "license": licence })).is_some()
    }

    #[test]
    fn a_choice_passes_by_its_best_side() {
        assert!(!refuses("MIT OR Apache-2.0"));
        assert!(!refuses("MIT/Apache-2.0"));
        assert!(!refuses("GPL-3.0 OR MIT"));
        assert!(!refuses("Apache-2.0 WITH LLVM-exception"));
        assert!(!refuses("(MIT OR Apache-2.0) AND Unicode-3.0"));
    }

    #[test]
    fn copyleft_and_silence_are_refused() {
        assert!(refuses("AGPL-3.0-only"));
        assert!(refuses("MIT AND GPL-3.0-or-later"));
        assert!(refuses("LGPL-2.1"));
        assert!(refuses("my own"));
        assert!(refusal(&serde_json::json!({ "name": "a" })).is_some());
    }
}
