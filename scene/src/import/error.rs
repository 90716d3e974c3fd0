//! Why a file could not be imported.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Why a file could not be imported. Its message is one line: the file, the thing in it, what is wrong, what
/// to do.
#[derive(Debug)]
pub struct ImportError {
    /// The file that was asked for.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: ImportProblem,
}

/// What is wrong with a file.
#[derive(Debug)]
#[non_exhaustive]
pub enum ImportProblem {
    /// A file cannot be read.
    Read {
        /// The file asked for (`None`), or the buffer or image that names another file.
        at: Option<String>,
        /// What the operating system says.
        error: io::Error,
    },
    /// The thing at `at` breaks glTF's rules, or uses a part of it that the importer does not know.
    Invalid {
        /// Kind, index and name, e.g. `light 2 "lamp"`; or a JSON path.
        at: String,
        /// What is wrong.
        why: String,
        /// What to do about it.
        mend: &'static str,
    },
    /// The file asks for more than [`ImportLimits`](crate::ImportLimits) admits.
    Limit {
        /// Kind, index and name of what asks.
        at: String,
        /// How much it asks for, with what came before it.
        found: u64,
        /// How much is admitted.
        limit: u64,
        /// The field of [`ImportLimits`](crate::ImportLimits).
        parameter: &'static str,
    },
}

impl ImportProblem {
    pub(super) fn invalid(at: impl fmt::Display, why: impl fmt::Display, mend: &'static str) -> Self {
        Self::Invalid { at: at.to_string(), why: why.to_string(), mend }
    }

    /// Adds the file's name.
    pub(super) fn of(self, file: &Path) -> ImportError {
        ImportError { file: file.to_owned(), problem: self }
    }
}

impl fmt::Display for ImportProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { at: None, error } => write!(f, "cannot be read: {error}"),
            Self::Read { at: Some(at), error } => write!(f, "{at}: cannot be read: {error}"),
            Self::Invalid { at, why, mend } => write!(f, "{at}: {why}: {mend}"),
            Self::Limit { at, found, limit, parameter } => {
                write!(f, "{at}: needs {found} where {limit} is the limit: raise ImportLimits::{parameter}")
            }
        }
    }
}

impl fmt::Display for ImportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let message = format!("{}: {}", self.file.display(), self.problem);
        f.write_str(&one_line(&message))
    }
}

impl std::error::Error for ImportError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.problem {
            ImportProblem::Read { error, .. } => Some(error),
            _ => None,
        }
    }
}

/// `text` without line breaks and control characters, which names in a file may hold, and of bounded length.
pub(super) fn one_line(text: &str) -> String {
    const LONGEST: usize = 600;
    let mut line: String = text.chars().take(LONGEST).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(LONGEST).is_some() {
        line.push('…');
    }
    line
}

/// `kind index "name"`, the name where there is one.
pub(super) fn thing(kind: &str, index: usize, name: Option<&str>) -> String {
    match name {
        Some(name) if !name.is_empty() => {
            format!("{kind} {index} \"{}\"", one_line(&name.chars().take(80).collect::<String>()))
        }
        _ => format!("{kind} {index}"),
    }
}
