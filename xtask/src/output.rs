//! Files that are there whole or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use scene::{Film, ImageError};

use crate::failure::Failure;

/// Writes text to a temporary file beside `path`, and gives it that name once it is complete.
///
/// # Errors
/// A failure that names `path`, if its folder is not there, cannot be written, or is full.
pub(crate) fn text(path: &Path, text: &str) -> Result<(), Failure> {
    let fail = |why: &dyn std::fmt::Display| {
        Failure::failed(format!("{}: cannot be written: {why}", path.display()))
    };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lighttree-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file, less what the umask takes; a temporary file would be for its owner alone.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut temporary = builder.tempfile_in(folder).map_err(|error| fail(&error))?;
    temporary.write_all(text.as_bytes()).map_err(|error| fail(&error))?;
    temporary.persist(path).map_err(|error| fail(&error.error))?;
    Ok(())
}

/// Writes `path` as EXR and, beside it, the same as PNG, brightened by `stops`. Returns the PNG's name.
///
/// # Errors
/// A failure that names the file.
pub(crate) fn picture(path: &Path, film: &Film, stops: f32) -> Result<PathBuf, Failure> {
    let png = path.with_extension("png");
    let fail = |error: ImageError| Failure::failed(format!("{error}: choose another place with -o"));
    scene::write_exr(film, path).map_err(fail)?;
    scene::write_png(film, &png, stops).map_err(fail)?;
    Ok(png)
}

/// Says before any work what could not be written after it.
///
/// # Errors
/// A usage error if `path` is no `.exr` in a folder that is there.
pub(crate) fn check(path: &Path) -> Result<(), Failure> {
    if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("exr")) {
        return Err(Failure::usage(format!(
            "-o {}: write a name that ends in .exr; a PNG is written beside it",
            path.display()
        )));
    }
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => Err(Failure::usage(format!(
            "-o {}: there is no folder {}: make it first",
            path.display(),
            folder.display()
        ))),
        _ => Ok(()),
    }
}
