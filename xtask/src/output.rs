//! Files that are there whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use scene::{Film, ImageError};

use crate::failure::Failure;

/// Lets `write` fill a temporary file beside `path`, and gives it that name once it is complete and on the disk.
///
/// # Errors
/// A failure that names `path`, if its folder is not there, cannot be written, or is full.
pub(crate) fn whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), Failure> {
    let fail = |error: io::Error| Failure::failed(format!("{}: cannot be written: {error}", path.display()));
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lighttree-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file, less what the umask takes; a temporary file would be for its owner alone.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.tempfile_in(folder).map_err(fail)?;
    let mut out = BufWriter::new(temporary.as_file());
    write(&mut out).and_then(|()| out.flush()).and_then(|()| temporary.as_file().sync_all()).map_err(fail)?;
    drop(out);
    temporary.persist(path).map_err(|error| fail(error.error))?;
    Ok(())
}

/// Writes text as [`whole`] does.
///
/// # Errors
/// Those of [`whole`].
pub(crate) fn text(path: &Path, text: &str) -> Result<(), Failure> {
    whole(path, |file| file.write_all(text.as_bytes()))
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
