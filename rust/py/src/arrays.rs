//! The only conversion between NumPy arrays and the core.

use nalgebra::DMatrix;
use numpy::{Element, PyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::errors::ModelError;

/// A matrix of the model, copied.
pub fn matrix(array: &PyReadonlyArray2<'_, f64>) -> DMatrix<f64> {
    let view = array.as_array();
    DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| view[(i, j)])
}

/// A signal, samples x channels, seen in place.
pub fn signal<'a, T: Element, D: numpy::ndarray::Dimension>(
    what: &str,
    array: &'a PyReadonlyArray<'_, T, D>,
    channels: usize,
) -> PyResult<&'a [T]> {
    let found = array.as_array().shape().last().copied().unwrap_or(0);
    if found != channels {
        return Err(ModelError::new_err(format!("{what} has {found} channels, expected {channels}")));
    }
    array.as_slice().map_err(|_| ModelError::new_err(format!("{what} must be C-contiguous")))
}

/// A vector handed over to NumPy without a copy, as rows x columns.
pub fn table<T: Element>(py: Python<'_>, values: Vec<T>, columns: usize) -> PyResult<Bound<'_, PyArray2<T>>> {
    let rows = values.len() / columns.max(1);
    PyArray1::from_vec(py, values).reshape([rows, columns])
}

/// The same with one more axis.
pub fn cube<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 3],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix3>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

/// A matrix of the core as a new array.
pub fn from_matrix<'py>(py: Python<'py>, m: &DMatrix<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = m.transpose().as_slice().to_vec();
    PyArray1::from_vec(py, rows).reshape([m.nrows(), m.ncols()])
}
