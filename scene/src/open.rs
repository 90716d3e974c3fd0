//! A scene by what a user types.

use std::fmt;
use std::path::Path;

use crate::Scene;
use crate::builtin::{BUILTIN_SCENES, BuiltinError, builtin};
use crate::import::{ImportError, ImportOptions, load};

/// Why a scene cannot be opened.
#[derive(Debug)]
pub enum SceneError {
    /// A file cannot be imported.
    Import(ImportError),
    /// A built-in scene cannot be made, or `spec` is neither a file nor the name of one.
    Builtin(BuiltinError),
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Import(error) => error.fmt(f),
            Self::Builtin(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for SceneError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Import(error) => Some(error),
            Self::Builtin(error) => Some(error),
        }
    }
}

/// Opens `spec`: a built-in scene by its name ([`BUILTIN_SCENES`]), or else a `.glb` or `.gltf` file by its
/// path. A file that is called like a built-in scene is reached by `./name`.
///
/// # Errors
/// As [`builtin`] and [`load`]. What looks like no path (no dot, no separator, no such file) is taken for a
/// misspelt name, and the message lists the names.
pub fn open(spec: &str, options: &ImportOptions) -> Result<Scene, SceneError> {
    let name = spec.split(':').next().unwrap_or(spec);
    let is_builtin = BUILTIN_SCENES.iter().any(|(known, _)| *known == name);
    let is_path = spec.contains(['.', '/', '\\']) || Path::new(spec).exists();
    if is_builtin || !is_path {
        builtin(spec).map_err(SceneError::Builtin)
    } else {
        load(Path::new(spec), options).map_err(SceneError::Import)
    }
}
