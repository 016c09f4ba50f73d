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
    /// There is no memory for what was asked for: Python's `MemoryError`.
    Memory(String),
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

    /// Refuses so many items that there is no memory for, and takes none.
    ///
    /// A list that cannot grow ends the process. So whoever is about to make lists as long as a caller wished asks first:
    /// for the result, and for what is needed on the way to it.
    pub fn unless_room<T>(count: usize) -> Result<()> {
        let mut asked = Vec::<T>::new();
        let found = asked.try_reserve_exact(count);
        // Memory that nobody looks at need not be asked for, thinks the compiler.
        std::hint::black_box(&mut asked);
        found.map_err(|_| {
            let bytes = count.saturating_mul(size_of::<T>());
            Error::Memory(format!("expected room for {bytes} bytes, but there is not as much memory"))
        })
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
            Error::Memory(message) => f.write_str(message),
            Error::Cancelled => f.write_str("cancelled"),
        }
    }
}

impl std::error::Error for Error {}
