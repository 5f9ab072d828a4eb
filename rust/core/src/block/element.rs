//! A block at one parameter set: w, and its derivatives by the signals and by the coefficients.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};
use std::sync::Arc;

use crate::block::force::Force;
use crate::block::hysteresis::BoucWen;
use crate::block::stop::Stop;
use crate::block::{Law, SIGNALS, Table};
use crate::error::{Error, Result};

/// Standard deviations beyond which noise reaches nothing.
const UNHEARD: f64 = 9.0;

/// A block with its coefficients put in.
#[derive(Debug, Clone)]
pub(crate) enum Element {
    Force(Force),
    Limit { inverse: f64, noise: f64 },
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
            Law::Limit if !(values[1] > 0.0 && values[1].is_finite()) => {
                return Err(Error::Block { what: "a limit needs a finite noise above zero" });
            }
            Law::Limit => Self::Limit { inverse: values[0], noise: values[1] },
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
            Self::Limit { inverse, noise } => limit(z[0], *inverse, *noise, by_coefficient),
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

/// Mean of `clip(z + n, -R, R) - (z + n)` over Gaussian noise n.
fn limit(z: f64, inverse: f64, noise: f64, by_coefficient: &mut [f64]) -> (f64, [f64; 2]) {
    let limit = 1.0 / inverse;
    let (below, above) = (-(z + limit) / noise, (z - limit) / noise);
    if inverse <= 0.0 || below.max(above) < -UNHEARD {
        by_coefficient[..2].fill(0.0);
        return (0.0, [0.0; 2]);
    }
    let normal = |x: f64| 0.5 * libm::erfc(-x * FRAC_1_SQRT_2);
    let density = |x: f64| (-0.5 * x * x).exp() * (0.5 * FRAC_2_SQRT_PI * FRAC_1_SQRT_2);
    let (beyond, further, dense) = ([normal(below), normal(above)], [below, above], [density(below), density(above)]);
    let sums: [f64; 2] = std::array::from_fn(|i| further[i] * beyond[i] + dense[i]);
    by_coefficient[0] = (beyond[0] - beyond[1]) * limit * limit;
    by_coefficient[1] = dense[0] - dense[1];
    (noise * (sums[0] - sums[1]), [-beyond[0] - beyond[1], 0.0])
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
