//! Running Rust work from Python: our own thread pool, no lock held, Ctrl-C and progress served meanwhile.
//!
//! The pool is keyed by the process id: rayon's threads do not survive `fork`, and a child that met its parent's pool
//! would wait for them for ever. It is never rayon's global pool, which does not survive it either.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, mpsc};
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// How often waiting Python looks for Ctrl-C and moves its progress bar.
const POLL: Duration = Duration::from_millis(50);

/// Threads that the next pool is made with; 0: one a processor.
static THREADS: AtomicUsize = AtomicUsize::new(0);
/// The pool last made, in this process or in its parent.
static POOL: AtomicPtr<Owned> = AtomicPtr::new(std::ptr::null_mut());

/// A pool, and the process that made it: one value, so that no thread sees the one without the other.
struct Owned {
    process: u32,
    pool: ThreadPool,
}

/// The pool that was made last, if this process made it.
fn made() -> Option<&'static ThreadPool> {
    // SAFETY: a pool is leaked when it is published and never freed.
    let made = unsafe { POOL.load(Ordering::Acquire).as_ref() }?;
    (made.process == std::process::id()).then_some(&made.pool)
}

/// The system has no thread, or no memory for its stack.
fn no_thread(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(format!("cannot start a thread: {error}"))
}

/// The pool of this process, made on first use. A pool of the parent process is left alone: it cannot be joined here.
fn pool() -> std::result::Result<&'static ThreadPool, PyErr> {
    if let Some(pool) = made() {
        return Ok(pool);
    }
    let pool = ThreadPoolBuilder::new()
        .num_threads(THREADS.load(Ordering::Relaxed))
        .thread_name(|k| format!("deltalux-{k}"))
        .build()
        .map_err(no_thread)?;
    let fresh: &'static mut Owned = Box::leak(Box::new(Owned { process: std::process::id(), pool }));
    POOL.store(fresh, Ordering::Release);
    Ok(&fresh.pool)
}

/// Lets rayon's global pool fail where it is first met, for tests: what runs in it by mistake works until a process forks,
/// and then waits for ever in the child.
#[pyfunction]
fn without_a_global_pool() {
    let none = ThreadPoolBuilder::new().num_threads(1).spawn_handler(|_| Err(std::io::Error::other("no global pool")));
    // The error is the purpose.
    drop(none.build_global());
}

/// A panic in the core is our fault: it reaches the user as a plain `RuntimeError`, never as a `BaseException`.
fn caught<T>(work: impl FnOnce() -> T) -> PyResult<T> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|cause| {
        let what = cause
            .downcast_ref::<String>()
            .map(String::as_str)
            .or_else(|| cause.downcast_ref::<&str>().copied())
            .unwrap_or("unknown cause");
        PyRuntimeError::new_err(format!("internal error in deltalux (please report it): {what}"))
    })
}

/// Short work (a frame): in the pool, with the interpreter free for other threads.
pub(crate) fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    let pool = pool()?;
    py.detach(|| caught(|| pool.install(work)))?.map_err(PyErr::from)
}

/// Short work on something that threads share. The order is the rule of the whole boundary: let go of the interpreter,
/// take the lock on the calling thread, and only then enter the pool. Work that is in the pool already and waits for a
/// lock may have been stolen by the very thread that holds it.
///
/// A panic elsewhere leaves a state that is still whole: its owner changes it only once all that can fail is done.
pub(crate) fn compute_on<S: Send, T: Send>(
    py: Python<'_>,
    shared: &Mutex<S>,
    work: impl FnOnce(&mut S) -> Result<T> + Send,
) -> PyResult<T> {
    let pool = pool()?;
    py.detach(|| {
        let mut guard = shared.lock().unwrap_or_else(PoisonError::into_inner);
        let state = &mut *guard;
        caught(|| pool.install(|| work(state)))
    })?
    .map_err(PyErr::from)
}

/// A look at something that threads share, which needs no pool; the interpreter is free while it waits.
pub(crate) fn look_at<S: Send, T: Send>(py: Python<'_>, shared: &Mutex<S>, look: impl FnOnce(&S) -> T + Send) -> T {
    py.detach(|| look(&shared.lock().unwrap_or_else(PoisonError::into_inner)))
}

/// What long work reads and reports: whether to stop, and how far it is.
#[derive(Default)]
pub(crate) struct Watch {
    /// The user has asked to stop.
    stop: AtomicBool,
    /// Finished work, in the unit of the work.
    done: AtomicU64,
}

impl Watch {
    /// Counts finished work; an error once the user asked to stop.
    pub(crate) fn advance(&self, amount: u64) -> Result<()> {
        self.done.fetch_add(amount, Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// Long work: as `compute`, while the calling thread looks for Ctrl-C and calls `progress(done)` every 50 ms.
///
/// Raises what the signal handler or the callback raised, after the work has stopped.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> Result<T> + Send,
) -> PyResult<T> {
    let pool = pool()?;
    let watch = Watch::default();
    let progress = progress.map(|callback| callback.clone().unbind());
    py.detach(|| {
        std::thread::scope(|scope| {
            let (finished, wait) = mpsc::channel::<()>();
            let worker = std::thread::Builder::new().spawn_scoped(scope, || {
                let outcome = caught(|| pool.install(|| work(&watch)));
                drop(finished);
                outcome
            });
            let worker = worker.map_err(no_thread)?;
            let mut raised = None;
            while let Err(mpsc::RecvTimeoutError::Timeout) = wait.recv_timeout(POLL) {
                let looked = Python::attach(|py| {
                    py.check_signals()?;
                    match &progress {
                        Some(callback) => callback.call1(py, (watch.done.load(Ordering::Relaxed),)).map(drop),
                        None => Ok(()),
                    }
                });
                if let Err(error) = looked {
                    watch.stop.store(true, Ordering::Relaxed);
                    raised.get_or_insert(error);
                }
            }
            let outcome = worker.join().expect("panics are caught inside the worker")?;
            match raised {
                Some(error) => Err(error),
                None => outcome.map_err(PyErr::from),
            }
        })
    })
}

/// Long work that cannot be told to stop, as a library of others does it: on Ctrl-C it is left behind, to end in its own
/// time, and what it makes is dropped.
pub(crate) fn abandonable<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let pool = pool()?;
    let (finished, wait) = mpsc::channel();
    std::thread::Builder::new()
        .name("deltalux-work".to_owned())
        .spawn(move || finished.send(caught(|| pool.install(work))))
        .map_err(no_thread)?;
    py.detach(move || {
        loop {
            match wait.recv_timeout(POLL) {
                Ok(outcome) => return outcome?.map_err(PyErr::from),
                Err(mpsc::RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    return Err(PyRuntimeError::new_err("internal error in deltalux: a thread ended early"));
                }
            }
        }
    })
}

/// Sets how many threads later calls use.
///
/// Parameters
/// ----------
/// threads
///     1 to 1024; 0: as many as there are processors.
///
/// Raises
/// ------
/// ValueError
///     If there are more, or fewer than 0.
#[pyfunction]
fn set_threads(threads: i64) -> PyResult<()> {
    if !(0..=1024).contains(&threads) {
        return Err(PyValueError::new_err(format!("expected 0 to 1024 threads, got {threads}")));
    }
    let threads = threads as usize;
    THREADS.store(threads, Ordering::Relaxed);
    // The next call makes a new pool; the old one is left to whoever is still using it, for ever. So one that has as many
    // threads stays.
    let wanted =
        if threads > 0 { threads } else { std::thread::available_parallelism().map_or(0, |count| count.get()) };
    if made().is_none_or(|pool| pool.current_num_threads() != wanted) {
        POOL.store(std::ptr::null_mut(), Ordering::Release);
    }
    Ok(())
}

/// How many threads calls use.
///
/// Returns
/// -------
/// int
#[pyfunction]
fn threads() -> PyResult<usize> {
    Ok(pool()?.current_num_threads())
}

/// Adds what this file has for Python to the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(set_threads, module)?)?;
    module.add_function(wrap_pyfunction!(without_a_global_pool, module)?)?;
    module.add_function(wrap_pyfunction!(threads, module)?)?;
    Ok(())
}
