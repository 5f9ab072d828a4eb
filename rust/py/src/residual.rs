//! `Data` and `normal_equations`: records against a loop.

use ambid_core::{Data as Core, normal_equations as core};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{from_matrix, signal};
use crate::closed_loop::ClosedLoop;
use crate::errors::raise;

#[pyclass(frozen, module = "ambid._core")]
pub struct Data {
    pub core: Core,
}

#[pymethods]
impl Data {
    #[new]
    #[pyo3(signature = (system, u, z, weights, first=0))]
    fn new(
        system: &ClosedLoop,
        u: PyReadonlyArray2<'_, f64>,
        z: PyReadonlyArray2<'_, f64>,
        weights: PyReadonlyArray1<'_, f64>,
        first: usize,
    ) -> PyResult<Self> {
        let u = signal("excitation", &u, system.core.inputs())?.to_vec();
        let z = signal("measurement", &z, system.core.outputs())?.to_vec();
        let core = Core::new(&system.core, u, z, weights.as_slice()?.to_vec(), first).map_err(raise)?;
        Ok(Self { core })
    }
}

#[pyfunction]
#[allow(clippy::type_complexity)]
pub fn normal_equations<'py>(
    py: Python<'py>,
    system: &ClosedLoop,
    theta: PyReadonlyArray1<'py, f64>,
    free: Vec<usize>,
    records: Vec<Bound<'py, Data>>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let theta = theta.as_slice()?;
    let records: Vec<&Core> = records.iter().map(|r| &r.get().core).collect();
    let normal = py.detach(|| core(&system.core, theta, &free, &records)).map_err(raise)?;
    let gradient = normal.gradient.as_slice().to_vec().into_pyarray(py);
    Ok((from_matrix(py, &normal.hessian)?, gradient, normal.squares.into_pyarray(py)))
}
