//! The boundary to Python: convert, check, detach, compute, convert back; nothing else. One file a room or class.

mod arrays;
mod beside;
mod bounces;
mod brdf;
mod clusters;
mod curves;
mod emission;
mod family;
mod gather;
mod gather_pass;
mod harmonics;
mod interrupt;
mod lamps;
mod light;
mod passing;
mod pieces;
mod receivers;
mod relight;
mod rows;
mod scene;
mod tracer;
mod transport;
mod update;
mod writer;

use pyo3::exceptions::{PyMemoryError, PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::error::Error;

pub(crate) use interrupt::{abandonable, compute, compute_on, interruptible, look_at};

pyo3::create_exception!(deltalux, FileError, PyValueError, "A file that is not what it claims to be.");
pyo3::create_exception!(deltalux, Cancelled, PyRuntimeError, "Work that was told to stop.");

impl From<Error> for PyErr {
    fn from(error: Error) -> PyErr {
        let message = error.to_string();
        match error {
            Error::Input(_) => PyValueError::new_err(message),
            Error::File { .. } => FileError::new_err(message),
            Error::Memory(_) => PyMemoryError::new_err(message),
            Error::Os { source, .. } if source.kind() == std::io::ErrorKind::OutOfMemory => {
                PyMemoryError::new_err(message)
            }
            Error::Os { path, source } => match source.raw_os_error() {
                Some(number) => PyOSError::new_err((number, source.to_string(), path.to_string_lossy().into_owned())),
                None => PyOSError::new_err(message),
            },
            Error::Cancelled => Cancelled::new_err(message),
        }
    }
}

/// The extension module `deltalux._core`.
#[pymodule(name = "_core")]
fn core_module(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("FileError", module.py().get_type::<FileError>())?;
    module.add("Cancelled", module.py().get_type::<Cancelled>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("DEBUG_BUILD", cfg!(debug_assertions))?;
    interrupt::register(module)?;
    update::register(module)?;
    receivers::register(module)?;
    pieces::register(module)?;
    transport::register(module)?;
    writer::register(module)?;
    light::register(module)?;
    harmonics::register(module)?;
    relight::register(module)?;
    scene::register(module)?;
    rows::register(module)?;
    bounces::register(module)?;
    brdf::register(module)?;
    family::register(module)?;
    gather::register(module)?;
    gather_pass::register(module)?;
    lamps::register(module)?;
    passing::register(module)?;
    clusters::register(module)?;
    curves::register(module)?;
    emission::register(module)?;
    tracer::register(module)?;
    Ok(())
}
