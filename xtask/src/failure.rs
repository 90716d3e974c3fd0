//! How a command ends other than well: one line for people, one exit code for scripts.

use std::fmt;

/// Why a command did not do what it was asked; the text is one line that names the thing and the mend.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The call itself was wrong: exit code 2.
    Usage(String),
    /// The call was right and the work failed: exit code 1.
    Failed(String),
    /// The user ended the work before it was done: exit code 130, as a shell has it for SIGINT.
    Interrupted(String),
}

impl Failure {
    /// A bad call.
    pub(crate) fn usage(line: impl Into<String>) -> Self {
        Self::Usage(line.into())
    }

    /// Work that failed.
    pub(crate) fn failed(line: impl Into<String>) -> Self {
        Self::Failed(line.into())
    }

    /// What the process ends with.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            Self::Failed(_) => 1,
            Self::Interrupted(_) => crate::stop::EXIT_CODE,
        }
    }
}

impl fmt::Display for Failure {
    /// One line, whatever the text held: an error of another crate may bring its own line breaks.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Usage(text) | Self::Failed(text) | Self::Interrupted(text)) = self;
        let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
        write!(f, "error: {line}")
    }
}
