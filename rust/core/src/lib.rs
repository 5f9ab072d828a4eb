//! Exact simulation of active magnetic bearing loops, and exact sensitivities to their parameters.
//!
//! The way of the data: [`Lft`] and, where it is digital, [`Controller`] make a [`Model`]; a [`ClosedLoop`] splits it
//! into independent parts, simulates, differentiates, and reduces residuals to [`normal_equations`]; a [`Stepper`]
//! runs it sample by sample without allocating. Nonlinear [`Block`]s of Delta change nothing of that.
//!
//! ```
//! use ambid_core::{ClosedLoop, Gain, Lft, Model};
//! use nalgebra::DMatrix;
//!
//! // a lag, x' = (u - x) / tau: the port z = u - x reaches w = z / tau
//! let b = DMatrix::from_row_slice(1, 2, &[0.0, 1.0]);
//! let c = DMatrix::from_row_slice(2, 1, &[1.0, -1.0]);
//! let d = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 1.0, 0.0]);
//! let lft = Lft::new(DMatrix::zeros(1, 1), b, c, d, vec![Gain { parameter: 0, scale: 1.0, power: -1 }])?;
//! let system = ClosedLoop::new(Model::new(lft, 0.1, None)?, 1)?;
//! let (y, slope) = system.sensitivity(&[0.5], &[0], &[1.0, 1.0])?;
//! assert!((y[1] - (1.0 - (-0.2_f64).exp())).abs() < 1e-15);
//! assert!((slope[1] + 0.4 * (-0.2_f64).exp()).abs() < 1e-15);
//! # Ok::<(), ambid_core::Error>(())
//! ```

mod block;
mod closed_loop;
mod discretise;
mod eigen;
mod ensemble;
mod error;
mod expm;
mod instructions;
mod kernel;
mod lft;
mod linear;
mod lines;
mod modal;
mod model;
pub mod noise;
mod nonlinear;
mod packed;
mod product;
mod reading;
mod realtime;
mod regression;
mod residual;
mod sources;
mod split;
mod steady;
mod stop;
mod whitened;

pub use block::{Block, Coefficient, Curve, Law, Table};
pub use closed_loop::ClosedLoop;
pub use discretise::Discrete;
pub use ensemble::{End, Fit, Records, Status, fit_all};
pub use error::{Error, Result};
pub use instructions::{Instructions, SWITCH};
pub use lft::{Gain, Lft};
pub use lines::LineResponse;
pub use model::{Controller, GainError, Model};
pub use noise::Scatter;
pub use packed::Packed;
pub use reading::Late;
pub use realtime::Stepper;
pub use regression::{Left, Weighted, Windows, regressed};
pub use residual::{Data, Normal, normal_equations};
pub use sources::{Likely, Sources};
pub use stop::ask_before_going_on;
pub use whitened::{LineData, LineNormal, line_equations, line_rows};

// the loops and the reference of the integration tests serve the unit tests too
#[cfg(test)]
extern crate self as ambid_core;
#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;
