//! Bytes from disk and data URIs, with one budget for all of them.
//!
//! A scene may name further files by relative paths. They must lie in the folder of the scene file or below
//! it: absolute paths, `..` and symbolic links that lead out are refused, so that a downloaded scene cannot
//! read the rest of the disk. Only plain files are opened, since reading a pipe or a device may never end.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

use gltf::buffer;

use super::{ImportLimits, ImportProblem};

/// Reads files; knows the folder that they must lie in and what is left of the budget.
pub(super) struct Files {
    folder: PathBuf,
    read: u64,
    limit: u64,
}

impl Files {
    /// Reads the scene file itself.
    pub(super) fn open(path: &Path, limits: &ImportLimits) -> Result<(Self, Vec<u8>), ImportProblem> {
        let folder = match path.parent() {
            Some(parent) if parent != Path::new("") => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let mut files = Self { folder, read: 0, limit: limits.max_bytes };
        let bytes = files.read(path, None)?;
        Ok((files, bytes))
    }

    /// What `uri` of the thing `at` stands for: a data URI's content or a file's.
    pub(super) fn fetch(&mut self, uri: &str, at: &str) -> Result<Vec<u8>, ImportProblem> {
        if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
            return data_uri(uri, at);
        }
        let path = self.resolve(uri, at)?;
        self.read(&path, Some(at))
    }

    /// The file that a relative URI names.
    fn resolve(&self, uri: &str, at: &str) -> Result<PathBuf, ImportProblem> {
        let refuse = |why: &str| {
            let mend = "put the file beside the scene and name it by a relative path";
            Err(ImportProblem::invalid(at, format!("file \"{}\" {why}", shorten(uri)), mend))
        };
        if uri.contains(':') {
            return refuse("has a scheme");
        }
        let Ok(decoded) = urlencoding::decode(uri) else { return refuse("is not UTF-8") };
        let relative = Path::new(decoded.as_ref());
        let inside = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
        if decoded.is_empty() || decoded.contains(['\0', '\\']) || !relative.components().all(inside) {
            return refuse("does not lie in the scene's folder");
        }
        let path = self.folder.join(relative);
        let read_error =
            |error| ImportProblem::Read { at: Some(format!("{at}: file \"{}\"", shorten(uri))), error };
        let real = path.canonicalize().map_err(read_error)?;
        let folder = self.folder.canonicalize().map_err(read_error)?;
        if !real.starts_with(&folder) {
            return refuse("leads out of the scene's folder");
        }
        Ok(real)
    }

    fn read(&mut self, path: &Path, at: Option<&str>) -> Result<Vec<u8>, ImportProblem> {
        let read_error = |error| ImportProblem::Read { at: at.map(str::to_owned), error };
        // Asked before opening: opening a pipe waits for somebody to write to it.
        let kind = path.metadata().map_err(read_error)?;
        if !kind.is_file() {
            let what =
                if kind.is_dir() { "it is a folder, not a plain file" } else { "it is not a plain file" };
            return Err(read_error(io::Error::new(io::ErrorKind::InvalidInput, what)));
        }
        let file = File::open(path).map_err(read_error)?;
        let size = file.metadata().map_err(read_error)?.len();
        let over = |found: u64| ImportProblem::Limit {
            at: at.unwrap_or("file").to_owned(),
            found,
            limit: self.limit,
            parameter: "max_bytes",
        };
        let left = self.limit - self.read;
        if size > left {
            return Err(over(self.read.saturating_add(size)));
        }
        let mut bytes = Vec::with_capacity(size as usize);
        // The file may grow while it is read.
        file.take(left + 1).read_to_end(&mut bytes).map_err(read_error)?;
        if bytes.len() as u64 > left {
            return Err(over(self.read + bytes.len() as u64));
        }
        self.read += bytes.len() as u64;
        Ok(bytes)
    }
}

/// Decodes `data:...;base64,...`. Not charged: the text it comes from was.
fn data_uri(uri: &str, at: &str) -> Result<Vec<u8>, ImportProblem> {
    let source = buffer::Source::Uri(uri);
    match buffer::Data::from_source(source, None) {
        // The crate pads the content to a multiple of four with zeros, which no reader here minds.
        Ok(data) => Ok(data.0),
        Err(error) => {
            let why = format!("data URI cannot be decoded ({error})");
            Err(ImportProblem::invalid(at, why, "encode it as data:...;base64,..."))
        }
    }
}

fn shorten(uri: &str) -> String {
    uri.chars().take(120).collect()
}
