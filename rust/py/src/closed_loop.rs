//! `ClosedLoop`: a loop compiled for the core.

use std::sync::Arc;

use ambid_core::{ClosedLoop as Core, Controller, Gain, GainError, Late, Lft, Model, Packed};
use nalgebra::DMatrix;
use numpy::{Complex64, IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::{cube, from_matrix, matrix, signal, table};
use crate::blocks::NonlinearBlock;
use crate::errors::raise;

type Matrix<'py> = PyReadonlyArray2<'py, f64>;
type Matrices<'py> = (Matrix<'py>, Matrix<'py>, Matrix<'py>, Matrix<'py>);

/// A digital controller beside the plant; see `ambid_core::Controller`.
#[derive(FromPyObject)]
pub struct DigitalController<'py> {
    #[pyo3(item)]
    matrices: Matrices<'py>,
    #[pyo3(item, default)]
    reads: Option<Matrix<'py>>,
    #[pyo3(item, default)]
    hidden: usize,
    #[pyo3(item, default)]
    takes: Option<Matrix<'py>>,
    #[pyo3(item)]
    delay: f64,
    #[pyo3(item, default)]
    late: Option<usize>,
    #[pyo3(item)]
    steps: usize,
    #[pyo3(item, default)]
    excitation: Option<Matrix<'py>>,
    #[pyo3(item, default)]
    errors: Vec<OneError<'py>>,
}

/// Parameter, C, D, excitation; see `ambid_core::GainError`.
type OneError<'py> = (usize, Matrix<'py>, Matrix<'py>, Matrix<'py>);

#[pyclass(frozen, module = "ambid._core")]
pub struct ClosedLoop {
    pub core: Arc<Core>,
}

#[pymethods]
impl ClosedLoop {
    #[new]
    #[pyo3(signature = (matrices, gains, parameters, dt, controller=None, blocks=Vec::new(), substeps=None, late=Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        matrices: Matrices<'_>,
        gains: Vec<(usize, f64, i32)>,
        parameters: usize,
        dt: f64,
        controller: Option<DigitalController<'_>>,
        blocks: Vec<NonlinearBlock<'_>>,
        substeps: Option<usize>,
        late: Vec<(usize, usize, f64)>,
    ) -> PyResult<Self> {
        let (a, b, c, d) = &matrices;
        let gains = gains.into_iter().map(|(parameter, scale, power)| Gain { parameter, scale, power }).collect();
        let blocks = blocks.iter().map(NonlinearBlock::compile).collect::<PyResult<_>>()?;
        let lft = Lft::with_blocks(matrix(a), matrix(b), matrix(c), matrix(d), gains, blocks).map_err(raise)?;
        let controller = controller.map(|k| {
            let (a, b, c, d) = &k.matrices;
            let (a, b, c, d) = (matrix(a), matrix(b), matrix(c), matrix(d));
            let errors = k.errors.iter();
            let errors = errors.map(|(parameter, c, d, excitation)| GainError {
                parameter: *parameter,
                c: matrix(c),
                d: matrix(d),
                excitation: matrix(excitation),
            });
            let (hidden, delay, late, steps, errors) = (k.hidden, k.delay, k.late, k.steps, errors.collect());
            let mut own = Controller { hidden, delay, late, steps, errors, ..Controller::new(a, b, c, d) };
            if let Some(excitation) = &k.excitation {
                own.excitation = matrix(excitation);
            }
            if let Some(reads) = &k.reads {
                own.reads = matrix(reads);
            }
            if let Some(takes) = &k.takes {
                own.takes = matrix(takes);
            }
            own
        });
        let late = late.into_iter().map(|(output, parameter, scale)| Late { output, parameter, scale }).collect();
        let model = Model::new(lft, dt, controller).and_then(|model| model.recorded(late)).map_err(raise)?;
        let model = Model { substeps, ..model };
        Ok(Self { core: Arc::new(Core::new(model, parameters).map_err(raise)?) })
    }

    #[getter]
    fn inputs(&self) -> usize {
        self.core.inputs()
    }

    #[getter]
    fn outputs(&self) -> usize {
        self.core.outputs()
    }

    #[getter]
    fn parameters(&self) -> usize {
        self.core.parameters()
    }

    #[getter]
    fn parts(&self) -> usize {
        self.core.parts()
    }

    fn poles<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<Complex64>>> {
        let theta = theta.as_slice()?;
        let poles = py.detach(|| self.core.poles(theta)).map_err(raise)?;
        Ok(poles.into_pyarray(py))
    }

    /// The loop at one parameter set as a file for programs without Python.
    fn packed<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        inputs: Vec<String>,
        outputs: Vec<String>,
        parameters: Vec<String>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let packed =
            Packed { model: self.core.model().clone(), theta: theta.as_slice()?.to_vec(), inputs, outputs, parameters };
        let bytes = packed.to_bytes();
        Packed::from_bytes(&bytes).map_err(raise)?; // what cannot be read must not be written
        Ok(PyBytes::new(py, &bytes))
    }

    #[allow(clippy::type_complexity)]
    fn discrete<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray2<f64>>,
    )> {
        let theta = theta.as_slice()?;
        let m = py.detach(|| self.core.discrete(theta)).map_err(raise)?;
        let array = |m| from_matrix(py, m);
        Ok((array(&m.a)?, array(&m.b)?, array(&m.c)?, array(&m.d)?))
    }

    /// Whole samples by which each output is recorded late.
    fn shifts(&self, theta: PyReadonlyArray1<'_, f64>) -> PyResult<Vec<isize>> {
        self.core.shifts(theta.as_slice()?).map_err(raise)
    }

    /// Derivatives of A of `discrete`: free x states x states.
    fn discrete_slopes<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        free: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let theta = theta.as_slice()?;
        let slopes = py.detach(|| self.core.discrete_slopes(theta, &free)).map_err(raise)?;
        let states = slopes.first().map_or(0, DMatrix::nrows);
        let rows = slopes.iter().flat_map(|slope| slope.transpose().as_slice().to_vec()).collect();
        cube(py, rows, [slopes.len(), states, states])
    }

    fn simulate<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (theta, u) = (theta.as_slice()?, signal("excitation", &u, self.core.inputs())?);
        let y = py.detach(|| self.core.simulate(theta, u)).map_err(raise)?;
        table(py, y, self.core.outputs())
    }

    #[allow(clippy::type_complexity)]
    fn sensitivity<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        free: Vec<usize>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>)> {
        let (theta, u) = (theta.as_slice()?, signal("excitation", &u, self.core.inputs())?);
        let (y, jacobian) = py.detach(|| self.core.sensitivity(theta, &free, u)).map_err(raise)?;
        let outputs = self.core.outputs();
        let samples = y.len() / outputs.max(1);
        Ok((table(py, y, outputs)?, cube(py, jacobian, [samples, outputs, free.len()])?))
    }

    /// Response, slopes and basis of the transient at points `w` of the unit circle.
    #[allow(clippy::type_complexity)]
    #[pyo3(signature = (theta, free, w, u, d=None, basis=true))]
    #[allow(clippy::too_many_arguments)]
    fn lines<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        free: Vec<usize>,
        w: PyReadonlyArray1<'py, Complex64>,
        u: PyReadonlyArray2<'py, Complex64>,
        d: Option<PyReadonlyArray1<'py, f64>>,
        basis: bool,
    ) -> PyResult<(Bound<'py, PyArray2<Complex64>>, Bound<'py, PyArray3<Complex64>>, Bound<'py, PyArray3<Complex64>>)>
    {
        let (theta, w, u) = (theta.as_slice()?, w.as_slice()?, signal("inputs on lines", &u, self.core.inputs())?);
        let d = d.as_ref().map_or(Ok(&[][..]), |d| d.as_slice())?;
        let found = py.detach(|| self.core.lines(theta, &free, w, u, d, basis)).map_err(raise)?;
        let (lines, outputs) = (w.len(), self.core.outputs());
        let states = found.basis.len() / (lines * outputs).max(1);
        Ok((
            table(py, found.response, outputs)?,
            cube(py, found.slopes, [lines, outputs, free.len()])?,
            cube(py, found.basis, [lines, outputs, states])?,
        ))
    }

    /// Lines x outputs x inputs at points `w` of the unit circle.
    fn transfer<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        w: PyReadonlyArray1<'py, Complex64>,
    ) -> PyResult<Bound<'py, PyArray3<Complex64>>> {
        let (theta, w) = (theta.as_slice()?, w.as_slice()?);
        let found = py.detach(|| self.core.transfer(theta, w)).map_err(raise)?;
        cube(py, found, [w.len(), self.core.outputs(), self.core.inputs()])
    }

    /// What a transient of `length` samples adds in time: samples x outputs.
    fn free_response<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        d: PyReadonlyArray1<'py, f64>,
        length: usize,
        samples: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (theta, d) = (theta.as_slice()?, d.as_slice()?);
        let y = py.detach(|| self.core.free_response(theta, d, length, samples)).map_err(raise)?;
        table(py, y, self.core.outputs())
    }

    /// The last period of the response to an excitation that repeats, from the steady state of the linearised loop on,
    /// and its derivatives.
    #[allow(clippy::type_complexity)]
    fn settled<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        free: Vec<usize>,
        u: PyReadonlyArray2<'py, f64>,
        period: usize,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>)> {
        let (theta, u) = (theta.as_slice()?, signal("excitation", &u, self.core.inputs())?);
        let (y, jacobian) = py.detach(|| self.core.settled(theta, &free, u, period)).map_err(raise)?;
        let outputs = self.core.outputs();
        Ok((table(py, y, outputs)?, cube(py, jacobian, [period, outputs, free.len()])?))
    }

    /// Response and derivatives, whole periods from `first` on added up, the last one `last` times.
    #[allow(clippy::type_complexity, clippy::too_many_arguments)]
    #[pyo3(signature = (theta, free, u, first, period, last=1.0))]
    fn folded<'py>(
        &self,
        py: Python<'py>,
        theta: PyReadonlyArray1<'py, f64>,
        free: Vec<usize>,
        u: PyReadonlyArray2<'py, f64>,
        first: usize,
        period: usize,
        last: f64,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>)> {
        let (theta, u) = (theta.as_slice()?, signal("excitation", &u, self.core.inputs())?);
        let (y, jacobian) = py.detach(|| self.core.folded(theta, &free, u, first, period, last)).map_err(raise)?;
        let outputs = self.core.outputs();
        Ok((table(py, y, outputs)?, cube(py, jacobian, [period, outputs, free.len()])?))
    }
}
