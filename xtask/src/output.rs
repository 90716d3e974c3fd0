//! Files that are there whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use scene::{Film, ImageError};
use serde_json::Value;

use crate::failure::Failure;

/// Writes to standard output. A reader that has had enough (`| head`) ends the text and is no failure.
///
/// # Errors
/// A failure where standard output cannot be written for another reason: a full disk, as a rule.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("standard output cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}

/// Says before any work whether a folder for results can be made, and files be put into it.
///
/// # Errors
/// A failure that names the folder.
pub(crate) fn check_folder(path: &Path) -> Result<(), Failure> {
    let there = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    if !there.is_dir() {
        let what = format!("{} is a file, not a folder", there.display());
        return Err(Failure::failed(format!("-o {}: {what}: choose another folder", path.display())));
    }
    temporary_in(there).map(drop).map_err(|error| in_folder(path, &error))
}

/// Makes a folder for results, if it is not there.
///
/// # Errors
/// A failure that names the folder.
pub(crate) fn make_folder(path: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(path).map_err(|error| in_folder(path, &error))
}

fn in_folder(path: &Path, error: &io::Error) -> Failure {
    Failure::failed(format!("-o {}: {error}: choose another folder", path.display()))
}

/// A file in `folder` that is gone when it is dropped.
fn temporary_in(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lighttree-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file, less what the umask takes; a temporary file would be for its owner alone.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// The folder that `path` lies in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Lets `write` fill a temporary file beside `path`, and gives it that name once it is complete and on the
/// disk.
///
/// # Errors
/// A failure that names `path`, if its folder is not there, cannot be written, or is full.
pub(crate) fn whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), Failure> {
    let fail = |error: io::Error| Failure::failed(format!("{}: cannot be written: {error}", path.display()));
    let temporary = temporary_in(folder_of(path)).map_err(fail)?;
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

/// Writes `path` as EXR, with what it is (`about`), and, beside it, the same as PNG, brightened by `stops`.
/// Returns the PNG's name.
///
/// # Errors
/// A failure that names the file.
pub(crate) fn picture(path: &Path, film: &Film, stops: f32, about: &Value) -> Result<PathBuf, Failure> {
    let png = path.with_extension("png");
    let fail = |error: ImageError| Failure::failed(format!("{error}: choose another place with -o"));
    scene::write_exr_about(film, path, &about.to_string()).map_err(fail)?;
    scene::write_png(film, &png, stops).map_err(fail)?;
    Ok(png)
}

/// Says before any work what could not be written after it.
///
/// # Errors
/// A usage error if `path` is no `.exr` in a folder that is there; a failure if no file can be put there.
pub(crate) fn check(path: &Path) -> Result<(), Failure> {
    if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("exr")) {
        return Err(Failure::usage(format!(
            "-o {}: write a name that ends in .exr; a PNG is written beside it",
            path.display()
        )));
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(Failure::usage(format!(
            "-o {}: there is no folder {}: make it first",
            path.display(),
            folder.display()
        )));
    }
    for file in [path, &path.with_extension("png")] {
        if file.is_dir() {
            return Err(Failure::usage(format!("-o {}: {} is a folder", path.display(), file.display())));
        }
    }
    temporary_in(folder).map(drop).map_err(|error| {
        let folder = folder.display();
        Failure::failed(format!("-o {}: nothing can be written in {folder}: {error}", path.display()))
    })
}
