//! Errors of the core as exceptions of the package.

use std::cell::RefCell;

use ambid_core::Error;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

pyo3::import_exception!(ambid.errors, ModelError);
pyo3::import_exception!(ambid.errors, UnstableLoopError);

thread_local! {
    /// What the handler of a signal raised while this thread was in the core.
    static BY_SIGNAL: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// Whether a signal came that wants the thread that waits for the core to stop. Handlers run in the main thread alone.
pub fn signalled() -> bool {
    let Err(error) = Python::attach(|py| py.check_signals()) else { return false };
    BY_SIGNAL.set(Some(error));
    true
}

pub fn raise(error: Error) -> PyErr {
    match error {
        Error::Stopped => BY_SIGNAL.take().unwrap_or_else(|| PyKeyboardInterrupt::new_err(())),
        Error::Unstable { .. } | Error::Diverged { .. } => UnstableLoopError::new_err(error.to_string()),
        _ => ModelError::new_err(error.to_string()),
    }
}
