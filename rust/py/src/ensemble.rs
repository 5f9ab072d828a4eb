//! `fit_all`: many fits side by side.

use std::collections::HashMap;

use ambid_core::{End, Fit as Core, Records, Status, fit_all as core};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

use crate::arrays::from_matrix;
use crate::closed_loop::ClosedLoop;
use crate::errors::raise;
use crate::lines::LineData;
use crate::residual::Data;

/// Records of each operating point with its loop.
type Groups<'py, T> = Vec<(Bound<'py, ClosedLoop>, Vec<Bound<'py, T>>)>;

/// One fit; see `ambid_core::Fit`.
#[derive(FromPyObject)]
pub struct Fit<'py> {
    #[pyo3(item, default)]
    lines: Groups<'py, LineData>,
    #[pyo3(item, default)]
    samples: Groups<'py, Data>,
    #[pyo3(item)]
    theta: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    free: Vec<usize>,
    #[pyo3(item)]
    scale: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    lower: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    upper: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    x: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    most: usize,
    #[pyo3(item)]
    step: f64,
    #[pyo3(item, default)]
    enough: f64,
    #[pyo3(item, default)]
    numbers: f64,
    #[pyo3(item, default)]
    witnesses: f64,
    #[pyo3(item, default)]
    prior: Option<PyReadonlyArray1<'py, f64>>,
}

impl Fit<'_> {
    fn core(&self) -> PyResult<Core<'_>> {
        let lines = self.lines.iter();
        let lines = lines.map(|(system, own)| (system, Records::Lines(own.iter().map(|d| &d.get().core).collect())));
        let samples = self.samples.iter();
        let samples =
            samples.map(|(system, own)| (system, Records::Samples(own.iter().map(|d| &d.get().core).collect())));
        Ok(Core {
            groups: lines.chain(samples).map(|(system, records)| (&*system.get().core, records)).collect(),
            theta: self.theta.as_slice()?.to_vec(),
            free: self.free.clone(),
            scale: self.scale.as_slice()?.to_vec(),
            lower: self.lower.as_slice()?.to_vec(),
            upper: self.upper.as_slice()?.to_vec(),
            x: self.x.as_slice()?.to_vec(),
            most: self.most,
            step: self.step,
            enough: self.enough,
            numbers: self.numbers,
            witnesses: self.witnesses,
            prior: match &self.prior {
                Some(prior) => prior.as_slice()?.to_vec(),
                None => vec![0.0; self.free.len()],
            },
        })
    }
}

/// What each fit ended with, a dictionary; or, in its place, the error that kept it from its first evaluation.
#[pyfunction]
pub fn fit_all<'py>(py: Python<'py>, fits: Vec<Fit<'py>>) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let own: Vec<Core<'_>> = fits.iter().map(Fit::core).collect::<PyResult<_>>()?;
    let ended = py.detach(|| core(&own)).map_err(raise)?;
    let each = ended.into_iter().zip(&own).map(|(ended, fit)| match ended {
        Ok(ended) => as_dict(py, ended, fit.free.len()),
        Err(error) => Ok(raise(error).into_value(py).into_bound(py).into_any()),
    });
    each.collect()
}

fn as_dict<'py>(py: Python<'py>, ended: End, parameters: usize) -> PyResult<Bound<'py, PyAny>> {
    let End { theta, status, evaluations, normal } = ended;
    let status = match status {
        Status::Converged => "converged",
        Status::AtBound => "at_bound",
        Status::MaxEvaluations => "max_evaluations",
    };
    let states: Vec<usize> = normal.transients.iter().map(Vec::len).collect();
    let transients: Vec<Bound<'py, PyArray1<f64>>> =
        normal.transients.into_iter().map(|d| d.into_pyarray(py)).collect();
    let slopes = normal.transient_slopes.into_iter().zip(states);
    let slopes = slopes.map(|(slopes, states)| PyArray1::from_vec(py, slopes).reshape([parameters, states]));
    let slopes = slopes.collect::<PyResult<Vec<Bound<'py, PyArray2<f64>>>>>()?;
    let gradient = normal.gradient.as_slice().to_vec().into_pyarray(py);
    let entries: HashMap<&str, Bound<'py, PyAny>> = HashMap::from([
        ("theta", theta.into_pyarray(py).into_any()),
        ("status", status.into_bound_py_any(py)?),
        ("evaluations", evaluations.into_bound_py_any(py)?),
        ("hessian", from_matrix(py, &normal.hessian)?.into_any()),
        ("gradient", gradient.into_any()),
        ("cost", normal.cost.into_bound_py_any(py)?),
        ("transients", transients.into_bound_py_any(py)?),
        ("slopes", slopes.into_bound_py_any(py)?),
        ("fitted", normal.fitted.into_bound_py_any(py)?),
    ]);
    entries.into_bound_py_any(py)
}
