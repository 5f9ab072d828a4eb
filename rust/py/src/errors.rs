//! Errors of the core as exceptions of the package.

use ambid_core::Error;
use pyo3::prelude::*;

pyo3::import_exception!(ambid.errors, ModelError);
pyo3::import_exception!(ambid.errors, UnstableLoopError);

pub fn raise(error: Error) -> PyErr {
    match error {
        Error::Unstable { .. } | Error::Diverged { .. } => UnstableLoopError::new_err(error.to_string()),
        _ => ModelError::new_err(error.to_string()),
    }
}
