//! `Stepper`: the loop sample by sample.

use std::sync::{Mutex, MutexGuard, PoisonError};

use ambid_core::Stepper as Core;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;

use crate::arrays::{signal, table};
use crate::closed_loop::ClosedLoop;
use crate::errors::raise;

#[pyclass(frozen, module = "ambid._core")]
pub struct Stepper {
    core: Mutex<Core>,
}

impl Stepper {
    /// Lets go of Python while another thread steps, which may need it to hear of signals.
    fn lock(&self, py: Python<'_>) -> MutexGuard<'_, Core> {
        self.core.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
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
        let mut core = self.lock(py);
        let u = signal("excitation", &u, core.inputs())?;
        let y = PyArray1::zeros(py, [core.outputs()], false);
        core.step(u, y.readwrite().as_slice_mut()?).map_err(raise)?;
        Ok(y)
    }

    fn run<'py>(&self, py: Python<'py>, u: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut core = self.lock(py);
        let (inputs, outputs) = (core.inputs(), core.outputs());
        let u = signal("excitation", &u, inputs)?;
        let mut y = vec![0.0; u.len() / inputs * outputs];
        let stepper: &mut Core = &mut core;
        py.detach(|| stepper.run(u, &mut y)).map_err(raise)?;
        table(py, y, outputs)
    }

    fn reset(&self, py: Python<'_>) {
        self.lock(py).reset();
    }
}
