//! `Stepper`: the loop sample by sample.

use std::sync::{Mutex, MutexGuard, PoisonError};

use ambid_core::Stepper as Core;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{signal, table};
use crate::closed_loop::ClosedLoop;
use crate::errors::raise;

/// Samples between two questions whether a signal came: some milliseconds.
const UNASKED: usize = 4096;

#[pyclass(frozen, module = "ambid._core")]
pub struct Stepper {
    core: Mutex<Core>,
}

impl Stepper {
    fn lock(&self) -> MutexGuard<'_, Core> {
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Stepper {
    #[new]
    fn new(system: &ClosedLoop, theta: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let core = Core::new(&system.core, theta.as_slice()?).map_err(raise)?;
        Ok(Self { core: Mutex::new(core) })
    }

    fn step<'py>(&self, py: Python<'py>, u: PyReadonlyArray1<'py, f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mut core = self.lock();
        let u = signal("excitation", &u, core.inputs())?;
        let y = PyArray1::zeros(py, [core.outputs()], false);
        core.step(u, y.readwrite().as_slice_mut()?).map_err(raise)?;
        Ok(y)
    }

    fn run<'py>(&self, py: Python<'py>, u: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut core = self.lock();
        let (inputs, outputs) = (core.inputs(), core.outputs());
        let u = signal("excitation", &u, inputs)?;
        let mut y = vec![0.0; u.len() / inputs * outputs];
        for (k, (u, y)) in u.chunks_exact(inputs).zip(y.chunks_exact_mut(outputs)).enumerate() {
            if k.is_multiple_of(UNASKED) {
                py.check_signals()?;
            }
            core.step(u, y).map_err(raise)?;
        }
        table(py, y, outputs)
    }

    fn reset(&self) {
        self.lock().reset();
    }
}
