//! A block at one parameter set: w, and its derivatives by the signals and by the coefficients.

use std::sync::Arc;

use crate::block::force::Force;
use crate::block::{Law, Table};
use crate::error::Result;

/// A block with its coefficients put in.
#[derive(Debug, Clone)]
pub(crate) enum Element {
    Force(Force),
    Slew { inverse_limit: f64, smoothing: f64 },
    BoucWen { coefficients: [f64; 3], smoothing: [f64; 2] },
    Table { gain: f64, table: Arc<Table> },
    Polynomial { coefficients: Vec<f64>, exponents: Vec<[u32; 2]> },
}

impl Element {
    pub fn new(law: &Law, values: Vec<f64>) -> Result<Self> {
        Ok(match law {
            Law::Force { curve, single, bias, held, level } => {
                Self::Force(Force::new(*curve, *single, [*bias, *held, *level], &values)?)
            }
            Law::Slew { smoothing } => Self::Slew { inverse_limit: values[0], smoothing: *smoothing },
            Law::BoucWen { rate_smoothing, state_smoothing } => Self::BoucWen {
                coefficients: [values[0], values[1], values[2]],
                smoothing: [*rate_smoothing, *state_smoothing],
            },
            Law::Table(table) => Self::Table { gain: values[0], table: Arc::clone(table) },
            Law::Polynomial { exponents, .. } => {
                Self::Polynomial { coefficients: values, exponents: exponents.clone() }
            }
        })
    }

    /// w and, with `SLOPES`, dw/dz; `by_coefficient` then becomes dw by each coefficient.
    #[inline(always)]
    pub fn evaluate<const FMA: bool, const SLOPES: bool>(
        &self,
        z: [f64; 2],
        by_coefficient: &mut [f64],
    ) -> (f64, [f64; 2]) {
        match self {
            Self::Force(force) => force.evaluate::<FMA, SLOPES>(z, by_coefficient),
            Self::Slew { inverse_limit, smoothing } => slew(z[0], *inverse_limit, *smoothing, by_coefficient),
            Self::BoucWen { coefficients, smoothing } => bouc_wen(z, coefficients, smoothing, by_coefficient),
            Self::Table { gain, table } => {
                let (value, slopes) = table.evaluate(z);
                by_coefficient[0] = value;
                (gain * value, slopes.map(|s| gain * s))
            }
            Self::Polynomial { coefficients, exponents } => polynomial(z, coefficients, exponents, by_coefficient),
        }
    }
}

/// `sat(z / R) R - z`, where sat bends from the diagonal to one over `1 - smoothing .. 1 + smoothing`, twice smooth.
fn slew(z: f64, inverse_limit: f64, smoothing: f64, by_coefficient: &mut [f64]) -> (f64, [f64; 2]) {
    let v = z.abs() * inverse_limit.abs();
    let t = ((v - 1.0 + smoothing) / (2.0 * smoothing)).clamp(0.0, 1.0);
    if t == 0.0 {
        by_coefficient[0] = 0.0;
        return (0.0, [0.0; 2]);
    }
    // slope of sat: 1 - (3 t^2 - 2 t^3)
    let slope = 1.0 - t * t * (3.0 - 2.0 * t);
    let value = if t < 1.0 { 1.0 - smoothing + 2.0 * smoothing * (t - t * t * t * (1.0 - 0.5 * t)) } else { 1.0 };
    by_coefficient[0] = (value - slope * v).copysign(-z * inverse_limit) / (inverse_limit * inverse_limit);
    ((value / inverse_limit.abs()).copysign(z) - z, [slope - 1.0, 0.0])
}

fn bouc_wen(
    [rate, state]: [f64; 2],
    [a, beta, gamma]: &[f64; 3],
    smoothing: &[f64; 2],
    by_coefficient: &mut [f64],
) -> (f64, [f64; 2]) {
    let (size_rate, sign_rate) = magnitude(rate, smoothing[0]);
    let (size_state, sign_state) = magnitude(state, smoothing[1]);
    let parts = [rate, -size_rate * state, -rate * size_state];
    by_coefficient.copy_from_slice(&parts);
    let slopes = [a - beta * sign_rate * state - gamma * size_state, -beta * size_rate - gamma * rate * sign_state];
    (a * parts[0] + beta * parts[1] + gamma * parts[2], slopes)
}

/// `sqrt(v^2 + e^2) - e` and its slope.
fn magnitude(v: f64, e: f64) -> (f64, f64) {
    let size = (v * v + e * e).sqrt();
    (size - e, if size > 0.0 { v / size } else { 0.0 })
}

fn polynomial(
    z: [f64; 2],
    coefficients: &[f64],
    exponents: &[[u32; 2]],
    by_coefficient: &mut [f64],
) -> (f64, [f64; 2]) {
    let (mut value, mut slopes) = (0.0, [0.0; 2]);
    for ((c, [a, b]), term) in coefficients.iter().zip(exponents).zip(by_coefficient) {
        let (a, b) = (*a as i32, *b as i32);
        let (za, zb) = (z[0].powi(a), z[1].powi(b));
        *term = za * zb;
        value += c * *term;
        if a > 0 {
            slopes[0] += c * f64::from(a) * z[0].powi(a - 1) * zb;
        }
        if b > 0 {
            slopes[1] += c * za * f64::from(b) * z[1].powi(b - 1);
        }
    }
    (value, slopes)
}
