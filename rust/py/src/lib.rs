//! The Python module `ambid._core`: registration, and how the core hears of signals.

mod arrays;
mod blocks;
mod closed_loop;
mod ensemble;
mod errors;
mod lines;
mod noise;
mod residual;
mod stepper;

use pyo3::pymodule;

#[pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::closed_loop::ClosedLoop;
    #[pymodule_export]
    use crate::ensemble::fit_all;
    #[pymodule_export]
    use crate::lines::{LineData, line_equations};
    #[pymodule_export]
    use crate::noise::{Scatter, inverses, local_regressions, through, way_back, whitening, whittle};
    #[pymodule_export]
    use crate::residual::{Data, normal_equations};
    #[pymodule_export]
    use crate::stepper::Stepper;

    /// What the hot loops run with: `avx2`, or `baseline`.
    #[pyfunction]
    fn instructions() -> &'static str {
        ambid_core::Instructions::in_use().name()
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // NumPy's interface is imported with the first array: here, where a signal ends the import, and not later, where
        // it would be a panic
        numpy::PyArray1::<f64>::zeros(module.py(), 0, false);
        ambid_core::ask_before_going_on(crate::errors::signalled);
        Ok(())
    }
}
