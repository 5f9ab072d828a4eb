//! `Scatter`, and what is done with the small matrices of noise on lines.

use ambid_core::{Scatter as Core, Weighted, Windows, noise, regressed};
use numpy::{
    Complex64, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{cube, signal, table};
use crate::closed_loop::ClosedLoop;
use crate::errors::raise;

type Matrices<'py> = Bound<'py, PyArray3<Complex64>>;

#[pyclass(frozen, module = "ambid._core")]
pub struct Scatter {
    core: Core,
    channels: usize,
}

#[pymethods]
impl Scatter {
    #[new]
    fn new(lines: PyReadonlyArray2<'_, Complex64>, used: PyReadonlyArray1<'_, bool>) -> PyResult<Self> {
        let channels = lines.shape()[1];
        let core = Core::new(signal("lines", &lines, channels)?, channels, used.as_slice()?).map_err(raise)?;
        Ok(Self { core, channels })
    }

    #[pyo3(signature = (low, high, left_out=None))]
    fn between<'py>(
        &self,
        py: Python<'py>,
        low: PyReadonlyArray1<'py, usize>,
        high: PyReadonlyArray1<'py, usize>,
        left_out: Option<PyReadonlyArray1<'py, usize>>,
    ) -> PyResult<Matrices<'py>> {
        let left_out = left_out.as_ref().map(|own| own.as_slice()).transpose()?;
        let (low, high) = (low.as_slice()?, high.as_slice()?);
        let found = py.detach(|| self.core.between(low, high, left_out)).map_err(raise)?;
        cube(py, found, [low.len(), self.channels, self.channels])
    }
}

/// What regressions leave: see `ambid_core::regressed`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn local_regressions<'py>(
    py: Python<'py>,
    lines: PyReadonlyArray2<'py, Complex64>,
    excitation: PyReadonlyArray2<'py, Complex64>,
    weighted: Vec<(usize, PyReadonlyArray1<'py, f64>)>,
    starts: PyReadonlyArray1<'py, usize>,
    nearest: PyReadonlyArray1<'py, usize>,
    width: usize,
    degree: usize,
    most_taken: f64,
) -> PyResult<(Matrices<'py>, Bound<'py, PyArray2<f64>>)> {
    let p = lines.shape()[1];
    let own = signal("lines", &lines, p)?;
    let excitation = signal("excitation on lines", &excitation, excitation.shape()[1])?;
    let groups = weighted.iter().map(|(end, weights)| Ok((*end, weights.as_slice()?)));
    let groups = groups.collect::<PyResult<Vec<Weighted<'_>>>>()?;
    let windows = Windows { starts: starts.as_slice()?, nearest: nearest.as_slice()?, width, degree, most_taken };
    let left = py.detach(|| regressed(own, p, excitation, &groups, windows)).map_err(raise)?;
    Ok((cube(py, left.sums, [starts.len(), p, p])?, table(py, left.power, p)?))
}

#[pyfunction]
pub fn whitening<'py>(
    py: Python<'py>,
    covariance: PyReadonlyArray3<'py, Complex64>,
    back: PyReadonlyArray3<'py, Complex64>,
) -> PyResult<(Matrices<'py>, Matrices<'py>)> {
    let p = covariance.shape()[2];
    let shape = [covariance.shape()[0], p, p];
    let (covariance, back) = (signal("covariance", &covariance, p)?, signal("way back", &back, p)?);
    let (inner, both) = py.detach(|| noise::whitening(covariance, back, p)).map_err(raise)?;
    Ok((cube(py, inner, shape)?, cube(py, both, shape)?))
}

#[pyfunction]
pub fn whittle<'py>(
    py: Python<'py>,
    covariance: PyReadonlyArray3<'py, Complex64>,
    lines: PyReadonlyArray2<'py, Complex64>,
) -> PyResult<f64> {
    let p = lines.shape()[1];
    let (covariance, lines) = (signal("covariance", &covariance, p)?, signal("lines", &lines, p)?);
    py.detach(|| noise::whittle(covariance, lines, p)).map_err(raise)
}

#[pyfunction]
pub fn inverses<'py>(py: Python<'py>, matrices: PyReadonlyArray3<'py, Complex64>) -> PyResult<Matrices<'py>> {
    let n = matrices.shape()[2];
    let (count, matrices) = (matrices.shape()[0], signal("matrices", &matrices, n)?);
    let found = py.detach(|| noise::inverses(matrices, n)).map_err(raise)?;
    cube(py, found, [count, n, n])
}

#[pyfunction]
pub fn through<'py>(
    py: Python<'py>,
    matrices: PyReadonlyArray3<'py, Complex64>,
    lines: PyReadonlyArray2<'py, Complex64>,
) -> PyResult<Bound<'py, PyArray2<Complex64>>> {
    let n = lines.shape()[1];
    let (matrices, lines) = (signal("matrices", &matrices, n)?, signal("lines", &lines, n)?);
    let found = py.detach(|| noise::through(matrices, lines, n)).map_err(raise)?;
    table(py, found, n)
}

#[pyfunction]
pub fn way_back<'py>(
    py: Python<'py>,
    system: &ClosedLoop,
    theta: PyReadonlyArray1<'py, f64>,
    w: PyReadonlyArray1<'py, Complex64>,
    inputs: Vec<usize>,
    channels: usize,
) -> PyResult<Matrices<'py>> {
    let (theta, w) = (theta.as_slice()?, w.as_slice()?);
    let found = py.detach(|| noise::way_back(&system.core, theta, w, &inputs, channels)).map_err(raise)?;
    cube(py, found, [w.len(), channels, channels])
}
