//! The rate of a hysteresis state.

use crate::error::{Error, Result};

/// `w = A u1' - (beta |v| + gamma v) |h|^(n-1) h1`, `v = u' h / |h|`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoucWen {
    a: f64,
    beta: f64,
    gamma: f64,
    n: f64,
    rate_smoothing: f64,
    state_smoothing: f64,
}

impl BoucWen {
    pub fn new(values: &[f64], rate_smoothing: f64, state_smoothing: f64) -> Result<Self> {
        let [a, beta, gamma, n] = [values[0], values[1], values[2], 1.0 / values[3]];
        if !(1.0..=1e6).contains(&n) {
            return Err(Error::Singular { what: "a hysteresis needs an inverse exponent above 0 and not above 1" });
        }
        Ok(Self { a, beta, gamma, n, rate_smoothing, state_smoothing })
    }

    #[inline(always)]
    pub fn evaluate(&self, [u1, h1, u2, h2]: [f64; 4], by_coefficient: &mut [f64]) -> (f64, [f64; 4]) {
        let Self { a, beta, gamma, n, rate_smoothing, state_smoothing } = self;
        let radius = (h1 * h1 + h2 * h2 + state_smoothing * state_smoothing).sqrt();
        let onto = [h1 / radius, h2 / radius];
        let v = u1 * onto[0] + u2 * onto[1];
        let whole = (v * v + rate_smoothing * rate_smoothing).sqrt();
        let size = whole - rate_smoothing;
        let [value, slope, by_n] = power(radius, *n);
        // what holds it back along h, and that by v
        let (back, by_v) = (beta * size + gamma * v, beta * v / whole + gamma);
        by_coefficient.copy_from_slice(&[
            u1,
            -size * value * onto[0],
            -v * value * onto[0],
            n * n * back * by_n * onto[0],
        ]);
        let along = value / radius;
        let by_rate = [a - value * onto[0] * by_v * onto[0], -value * onto[0] * by_v * onto[1]];
        let by_state =
            |u: f64, onto_own: f64| onto[0] * ((along - slope) * onto_own * back - along * by_v * (u - v * onto_own));
        (
            a * u1 - back * value * onto[0],
            [by_rate[0], by_state(u1, onto[0]) - along * back, by_rate[1], by_state(u2, onto[1])],
        )
    }
}

/// `r^n`, straight beyond one, and its slopes by r and n; r is above zero.
#[inline(always)]
fn power(r: f64, n: f64) -> [f64; 3] {
    if r >= 1.0 {
        return [1.0 + n * (r - 1.0), n, r - 1.0];
    }
    let log = r.ln();
    let value = (n * log).exp();
    [value, n * value / r, value * log]
}
