//! The crate's one error type. Every message says what was expected and what was found.

use std::fmt;
use std::path::{Path, PathBuf};

/// What can go wrong, by who has to act on it.
#[derive(Debug)]
pub enum Error {
    /// An argument or a scene that cannot be used: Python's `ValueError`.
    Input(String),
    /// A file that is not what it claims to be (truncated, altered, of another version): `deltalux.FileError`.
    File {
        /// The file or directory in question.
        path: PathBuf,
        /// What was expected and what was found.
        what: String,
    },
    /// The operating system refused: Python's `OSError`, with its number.
    Os {
        /// What it was asked about.
        path: PathBuf,
        /// Its answer.
        source: std::io::Error,
    },
    /// The caller asked for the work to stop (Ctrl-C or a progress callback that raised).
    Cancelled,
}

/// What fallible functions of the core give.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Refuses what a caller gave.
    pub fn input(message: impl Into<String>) -> Self {
        Error::Input(message.into())
    }

    /// Refuses a file for what is in it.
    pub fn file(path: &Path, what: impl Into<String>) -> Self {
        Error::File { path: path.to_owned(), what: what.into() }
    }

    /// Passes on what the operating system said of a path.
    pub fn os(path: &Path, source: std::io::Error) -> Self {
        Error::Os { path: path.to_owned(), source }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Input(message) => f.write_str(message),
            Error::File { path, what } => write!(f, "{}: {what}", path.display()),
            Error::Os { path, source } => write!(f, "{}: {source}", path.display()),
            Error::Cancelled => f.write_str("cancelled"),
        }
    }
}

impl std::error::Error for Error {}
