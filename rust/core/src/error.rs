//! One error per cause that a caller can act on.

use nalgebra::Complex;

/// What can go wrong in the core.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A matrix or slice has the wrong size.
    #[error("{what} has size {found}, expected {expected}")]
    Shape {
        /// The array in question.
        what: &'static str,
        /// Its size.
        found: String,
        /// The size that fits the model.
        expected: String,
    },
    /// A number is NaN or infinite where only finite ones make sense.
    #[error("{what} holds a value that is not finite")]
    NotFinite {
        /// The array in question.
        what: &'static str,
    },
    /// The closed loop has a pole that does not decay.
    #[error(
        "the closed loop is unstable: a pole at {frequency_hz:.1} Hz grows with {rate:.3} 1/s, \
         by the factor {growth:.6} per sample"
    )]
    Unstable {
        /// Largest modulus of the poles of the sampled loop.
        growth: f64,
        /// Rate of that pole in 1/s.
        rate: f64,
        /// Its frequency.
        frequency_hz: f64,
    },
    /// The nonlinear loop leaves every bound.
    #[error("the nonlinear loop diverges: an output passes {limit:.0e} (SI) or is not finite at sample {sample}")]
    Diverged {
        /// First sample where that is seen.
        sample: usize,
        /// Largest output that is still taken for a response.
        limit: f64,
    },
    /// The nonlinear response depends on the number of substeps.
    #[error(
        "the nonlinear response still changes by {change:.1e} of its peak between {substeps} substeps and \
         half as many; smooth the nonlinearity or sample faster"
    )]
    Unresolved {
        /// Largest number of substeps tried.
        substeps: usize,
        /// Change relative to the peak of the column that changes most.
        change: f64,
    },
    /// A nonlinear block, or its integration, was given numbers that are not allowed.
    #[error("{what}")]
    Block {
        /// What is allowed.
        what: &'static str,
    },
    /// Bytes are no packed model.
    #[error("no stepper file, or a broken one: {what} (byte {at}); write it again with ambid export --stepper")]
    Format {
        /// What is wrong.
        what: &'static str,
        /// Where it was seen.
        at: usize,
    },
    /// The caller asked for it, see [`crate::ask_before_going_on`].
    #[error("stopped before it was done")]
    Stopped,
    /// An algebraic loop has no solution, or a parameter value makes the model singular.
    #[error("the model is singular at these parameters: {what}")]
    Singular {
        /// Which step failed.
        what: &'static str,
    },
}

impl Error {
    /// [`Error::Unstable`] by a pole in 1/s; `dt` is the time from sample to sample.
    pub(crate) fn unstable(pole: Complex<f64>, dt: f64) -> Self {
        Self::Unstable {
            growth: (pole.re * dt).exp(),
            rate: pole.re,
            frequency_hz: pole.im.abs() / std::f64::consts::TAU,
        }
    }
}

/// Result of the core.
pub type Result<T> = std::result::Result<T, Error>;

pub(crate) fn check_len(what: &'static str, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Error::Shape { what, found: found.to_string(), expected: expected.to_string() })
}

pub(crate) fn check_finite(what: &'static str, values: &[f64]) -> Result<()> {
    // no early end: records are long, and this way the loop is vectorised
    let finite = values.iter().fold(true, |all, v| all & v.is_finite());
    if finite { Ok(()) } else { Err(Error::NotFinite { what }) }
}
