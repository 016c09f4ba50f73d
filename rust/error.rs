//! The crate's one error type. Every message says what was expected and what was found.

use std::fmt;
use std::path::{Path, PathBuf};

/// What can go wrong, by who has to act on it.
#[derive(Debug)]
pub enum Error {
    /// An argument or a scene that cannot be used: Python's `ValueError`.
    Input(String),
    /// A file that is not what it claims to be (truncated, altered, of another version): `deltalux.FileError`.
    File { path: PathBuf, what: String },
    /// The operating system refused: Python's `OSError`, with its number.
    Os { path: PathBuf, source: std::io::Error },
    /// The caller asked for the work to stop (Ctrl-C or a progress callback that raised).
    Cancelled,
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub fn input(message: impl Into<String>) -> Self {
        Error::Input(message.into())
    }

    pub fn file(path: &Path, what: impl Into<String>) -> Self {
        Error::File { path: path.to_owned(), what: what.into() }
    }

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
