//! `LineData` and `line_equations`: measured lines of the spectrum against a loop.

use ambid_core::{LineData as Core, line_equations as core, line_rows};
use numpy::{
    Complex64, IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::prelude::*;

use crate::arrays::{from_matrix, signal, table};
use crate::closed_loop::ClosedLoop;
use crate::errors::raise;

#[pyclass(frozen, module = "ambid._core")]
pub struct LineData {
    pub core: Core,
}

#[pymethods]
impl LineData {
    #[new]
    fn new(
        system: &ClosedLoop,
        w: PyReadonlyArray1<'_, Complex64>,
        u: PyReadonlyArray2<'_, Complex64>,
        z: PyReadonlyArray2<'_, Complex64>,
        whitening: PyReadonlyArray3<'_, Complex64>,
    ) -> PyResult<Self> {
        let channels = z.as_array().ncols();
        let u = signal("inputs on lines", &u, system.core.inputs())?.to_vec();
        let z = signal("outputs on lines", &z, channels)?.to_vec();
        let whitening = signal("whitening", &whitening, channels)?.to_vec();
        let core = Core::new(&system.core, w.as_slice()?.to_vec(), u, z, whitening).map_err(raise)?;
        Ok(Self { core })
    }

    /// Whitened rows `[T | dz | r]`, see `ambid_core::line_rows`.
    #[pyo3(signature = (system, theta, free, d=None, transients=true))]
    fn rows<'py>(
        &self,
        py: Python<'py>,
        system: &ClosedLoop,
        theta: PyReadonlyArray1<'py, f64>,
        free: Vec<usize>,
        d: Option<PyReadonlyArray1<'py, f64>>,
        transients: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let theta = theta.as_slice()?;
        let d = d.as_ref().map_or(Ok(&[][..]), |d| d.as_slice())?;
        let rows = py.detach(|| line_rows(&system.core, theta, &free, &self.core, d, transients));
        let (rows, columns) = rows.map_err(raise)?;
        table(py, rows, columns)
    }
}

#[pyfunction]
#[pyo3(signature = (system, theta, free, records, near=Vec::new()))]
#[allow(clippy::type_complexity)]
pub fn line_equations<'py>(
    py: Python<'py>,
    system: &ClosedLoop,
    theta: PyReadonlyArray1<'py, f64>,
    free: Vec<usize>,
    records: Vec<Bound<'py, LineData>>,
    near: Vec<Vec<f64>>,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    Vec<Bound<'py, PyArray1<f64>>>,
    Vec<Bound<'py, PyArray2<f64>>>,
    Vec<usize>,
)> {
    let theta = theta.as_slice()?;
    let records: Vec<&Core> = records.iter().map(|r| &r.get().core).collect();
    let normal = py.detach(|| core(&system.core, theta, &free, &records, &near)).map_err(raise)?;
    let gradient = normal.gradient.as_slice().to_vec().into_pyarray(py);
    let states: Vec<usize> = normal.transients.iter().map(Vec::len).collect();
    let transients = normal.transients.into_iter().map(|d| d.into_pyarray(py)).collect();
    let slopes = normal.transient_slopes.into_iter().zip(states).map(|(slopes, states)| {
        let parameters = free.len();
        PyArray1::from_vec(py, slopes).reshape([parameters, states])
    });
    let slopes = slopes.collect::<PyResult<_>>()?;
    Ok((from_matrix(py, &normal.hessian)?, gradient, normal.cost, transients, slopes, normal.fitted))
}
