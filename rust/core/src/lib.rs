//! Exact simulation of active magnetic bearing loops, and exact sensitivities to their parameters.
//!
//! The way of the data: [`Lft`] and, where it is digital, [`Controller`] make a [`Model`]; a [`ClosedLoop`] splits it
//! into independent parts, simulates, differentiates, and reduces residuals to [`normal_equations`]; a [`Stepper`]
//! runs it sample by sample without allocating.

mod closed_loop;
mod discretise;
mod error;
mod expm;
mod kernel;
mod lft;
mod linear;
mod modal;
mod model;
mod product;
mod realtime;
mod residual;
mod split;

pub use closed_loop::ClosedLoop;
pub use discretise::Discrete;
pub use error::{Error, Result};
pub use lft::{Gain, Lft};
pub use model::{Controller, Model};
pub use realtime::Stepper;
pub use residual::{Data, Normal, normal_equations};
