//! A block at one parameter set: w, and its derivatives by the signals and by the coefficients.

use std::sync::Arc;

use crate::block::force::Force;
use crate::block::hysteresis::BoucWen;
use crate::block::stop::Stop;
use crate::block::{Law, SIGNALS, Table};
use crate::error::Result;

/// A block with its coefficients put in.
#[derive(Debug, Clone)]
pub(crate) enum Element {
    Force(Force),
    Slew { inverse_limit: f64, smoothing: f64 },
    BoucWen(BoucWen),
    Stop(Stop),
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
            Law::BoucWen { rate_smoothing, state_smoothing, .. } => {
                Self::BoucWen(BoucWen::new(&values, *rate_smoothing, *state_smoothing)?)
            }
            Law::Stop { smoothing, .. } => {
                Self::Stop(Stop { clearance: values[0], damping: values[1], smoothing: *smoothing })
            }
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
        z: [f64; SIGNALS],
        by_coefficient: &mut [f64],
    ) -> (f64, [f64; SIGNALS]) {
        let two = [z[0], z[1]];
        let (value, [first, second]) = match self {
            Self::BoucWen(law) => return law.evaluate(z, by_coefficient),
            Self::Stop(stop) => return stop.evaluate(z, by_coefficient),
            Self::Force(force) => force.evaluate::<FMA, SLOPES>(two, by_coefficient),
            Self::Slew { inverse_limit, smoothing } => slew(z[0], *inverse_limit, *smoothing, by_coefficient),
            Self::Table { gain, table } => {
                let (value, slopes) = table.evaluate(two);
                by_coefficient[0] = value;
                (gain * value, slopes.map(|s| gain * s))
            }
            Self::Polynomial { coefficients, exponents } => polynomial(two, coefficients, exponents, by_coefficient),
        };
        (value, [first, second, 0.0, 0.0])
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
