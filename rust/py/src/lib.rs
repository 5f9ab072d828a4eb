//! The Python module `ambid._core`: registration only.

mod arrays;
mod blocks;
mod closed_loop;
mod errors;
mod lines;
mod noise;
mod residual;
mod stepper;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::closed_loop::ClosedLoop;
    #[pymodule_export]
    use crate::lines::{LineData, line_equations};
    #[pymodule_export]
    use crate::noise::{Scatter, inverses, through, way_back, whitening, whittle};
    #[pymodule_export]
    use crate::residual::{Data, normal_equations};
    #[pymodule_export]
    use crate::stepper::Stepper;
}
