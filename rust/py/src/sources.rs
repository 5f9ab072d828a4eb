//! `Sources`: noise of several origins on lines.

use ambid_core::Sources as Core;
use numpy::{
    Complex64, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{cube, signal, table};
use crate::errors::raise;

type Real<'py> = Bound<'py, PyArray2<f64>>;

#[pyclass(frozen, module = "ambid._core")]
pub struct Sources {
    core: Core,
    splines: usize,
}

#[pymethods]
impl Sources {
    #[new]
    fn new(
        ways: PyReadonlyArray3<'_, Complex64>,
        first: PyReadonlyArray1<'_, usize>,
        weights: PyReadonlyArray2<'_, f64>,
        splines: usize,
    ) -> PyResult<Self> {
        let (channels, own) = (ways.shape()[1], signal("ways", &ways, ways.shape()[2])?);
        let weights = signal("weights", &weights, weights.shape()[1])?;
        let core = Core::new(own, channels, first.as_slice()?, weights, splines).map_err(raise)?;
        Ok(Self { core, splines })
    }

    fn likely<'py>(
        &self,
        py: Python<'py>,
        lines: PyReadonlyArray2<'py, Complex64>,
        coefficients: PyReadonlyArray2<'py, f64>,
        usual: f64,
    ) -> PyResult<(f64, Real<'py>, Real<'py>)> {
        let lines = signal("lines", &lines, self.core.channels())?;
        let coefficients = signal("coefficients", &coefficients, self.splines)?;
        let found = py.detach(|| self.core.likely(lines, coefficients, usual)).map_err(raise)?;
        let information = table(py, found.information, self.core.coefficients())?;
        Ok((found.likelihood, table(py, found.score, self.splines)?, information))
    }

    fn fitted<'py>(
        &self,
        py: Python<'py>,
        coefficients: PyReadonlyArray2<'py, f64>,
        variance: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let coefficients = signal("coefficients", &coefficients, self.splines)?;
        let variance = signal("variance", &variance, self.core.coefficients())?;
        let found = py.detach(|| self.core.fitted(coefficients, variance)).map_err(raise)?;
        Ok(PyArray1::from_vec(py, found))
    }

    fn whitening<'py>(
        &self,
        py: Python<'py>,
        coefficients: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<Complex64>>> {
        let coefficients = signal("coefficients", &coefficients, self.splines)?;
        let found = py.detach(|| self.core.whitening(coefficients)).map_err(raise)?;
        let p = self.core.channels();
        cube(py, found, [self.core.lines(), p, p])
    }
}
