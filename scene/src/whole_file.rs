//! Files that are there whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File};
use std::path::Path;

/// Lets `write` fill a temporary file in the folder of `path`, which takes that name once it is complete and
/// on the disk.
///
/// # Errors
/// Why it could not be written; nothing is left then, and what was at `path` stays.
pub(crate) fn whole_file(path: &Path, write: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), String> {
    let mut hidden = OsString::from(".");
    hidden.push(path.file_name().ok_or("this is no file name")?);
    hidden.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(hidden);
    let result = write(&temporary)
        .and_then(|()| File::open(&temporary).and_then(|file| file.sync_all()).map_err(|e| e.to_string()))
        .and_then(|()| fs::rename(&temporary, path).map_err(|e| e.to_string()));
    result.inspect_err(|_| {
        // Nothing more can be done if even that fails.
        let _ = fs::remove_file(&temporary);
    })
}
