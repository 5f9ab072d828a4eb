//! The magnetic force less its linearisation.

use crate::block::Curve;
use crate::block::curve::Shape;
use crate::error::{Error, Result};

/// Below this strength the force is linear to rounding.
const NEGLIGIBLE: f64 = 1e-6;
/// Smallest gap relative to that at rest; it bends towards this value from twice as wide on.
const CLOSED: f64 = 0.02;

/// `w = c (F - alpha - beta)` with `alpha = i/i0`, `beta = s/s0`, `c = K_i i0`.
///
/// `F = (B^2(x+) - B^2(x-)) / (2 (1 + o) B(1) B'(1))`, `x+ = (1 + alpha) / (1 - beta)`,
/// `x- = (1 - o alpha) / (1 + o beta)`; o is 1 for a pair of magnets, 0 for one against a constant load. Where a
/// constant current holds a constant load, i counts from it, and the part of w that belongs to it is left out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Force {
    shape: Shape,
    coefficients: usize,
    level: f64,
    linear: bool,
    k_i: f64,
    k_s: f64,
    nu: f64,
    /// 1/i0, 1/s0, c.
    per_current: f64,
    per_displacement: f64,
    scale: f64,
    /// o.
    opposite: f64,
    /// `1 / (2 (1 + o) B(1) B'(1))`, and the relative derivative of `B(1) B'(1)` by sigma and n.
    normal: f64,
    normal_slopes: [f64; 2],
    /// Current that holds a constant load; w there, and its derivatives by the coefficients.
    held: f64,
    at_held: f64,
    at_held_slopes: [f64; 5],
}

impl Force {
    pub fn new(curve: Curve, single: bool, [bias, held, level]: [f64; 3], values: &[f64]) -> Result<Self> {
        let (k_i, k_s, nu) = (values[0], values[1], values[2]);
        let of = |place: usize| values.get(place).copied().unwrap_or(1.0);
        let shape = Shape { curve, sigma: level * of(3), n: of(4) };
        let (rest, slopes) = shape.at_rest();
        let linear = nu.abs() < NEGLIGIBLE;
        let opposite = if single { 0.0 } else { 1.0 };
        let mut force = Self {
            shape,
            coefficients: values.len(),
            level,
            linear,
            k_i,
            k_s,
            nu,
            per_current: nu / bias,
            per_displacement: k_s * nu / (k_i * bias),
            scale: if linear { 0.0 } else { k_i * bias / nu },
            opposite,
            normal: 0.5 / (1.0 + opposite) / rest,
            normal_slopes: slopes.map(|slope| slope / rest),
            held,
            at_held: 0.0,
            at_held_slopes: [0.0; 5],
        };
        let constants = [force.per_displacement, force.scale, force.normal];
        let allowed = !curve.is_power() || (shape.sigma >= 0.0 && shape.n > 0.0);
        if !allowed || constants.iter().chain(&force.normal_slopes).any(|c| !c.is_finite()) {
            return Err(Error::Singular {
                what: "a force law needs K_i other than zero; a power curve sigma >= 0, n > 0",
            });
        }
        if held != 0.0 {
            let mut slopes = [0.0; 5];
            let (at_held, _) = force.evaluate::<false, true>([0.0; 2], &mut slopes[..force.coefficients]);
            (force.at_held, force.at_held_slopes) = (at_held, slopes);
        }
        Ok(force)
    }

    #[inline(always)]
    pub fn evaluate<const FMA: bool, const SLOPES: bool>(
        &self,
        z: [f64; 2],
        by_coefficient: &mut [f64],
    ) -> (f64, [f64; 2]) {
        if self.linear {
            by_coefficient.fill(0.0);
            return (0.0, [0.0; 2]);
        }
        let (alpha, beta) = (self.per_current * (z[0] + self.held), self.per_displacement * z[1]);
        if SLOPES {
            return self.with_slopes::<FMA>(alpha, beta, z[1], by_coefficient);
        }
        let gaps = [gap(1.0 - beta).0, gap(1.0 + self.opposite * beta).0];
        let currents = [1.0 + alpha, 1.0 - self.opposite * alpha];
        let pull = self.shape.pull::<FMA>([(currents[0] / gaps[0]).max(0.0), (currents[1] / gaps[1]).max(0.0)]);
        (self.scale * ((pull[0] - pull[1]) * self.normal - alpha - beta) - self.at_held, [0.0; 2])
    }

    #[inline(always)]
    fn with_slopes<const FMA: bool>(
        &self,
        alpha: f64,
        beta: f64,
        s: f64,
        by_coefficient: &mut [f64],
    ) -> (f64, [f64; 2]) {
        let o = self.opposite;
        let gaps = [gap(1.0 - beta), gap(1.0 + o * beta)];
        let per_gap = [1.0 / gaps[0].0, 1.0 / gaps[1].0];
        let x = [((1.0 + alpha) * per_gap[0]).max(0.0), ((1.0 - o * alpha) * per_gap[1]).max(0.0)];
        let flux = self.shape.flux::<FMA>(x);
        let moved = [per_gap[0], o * per_gap[1]];
        // F, and its derivatives by alpha, beta, sigma, n
        let (mut value, mut by_alpha, mut by_beta, mut by_shape) = (0.0, 0.0, 0.0, [0.0; 2]);
        for (k, sign) in [1.0, -1.0].into_iter().enumerate() {
            let flux = flux[k];
            let twice = 2.0 * flux.value * self.normal;
            let by_current = twice * flux.by_x * moved[k];
            value += sign * flux.value * flux.value * self.normal;
            by_alpha += by_current;
            by_beta += by_current * x[k] * gaps[k].1;
            for (sum, slope) in by_shape.iter_mut().zip(flux.by_shape) {
                *sum += sign * twice * slope;
            }
        }
        for (sum, normal) in by_shape.iter_mut().zip(self.normal_slopes) {
            *sum -= value * normal;
        }
        let excess = value - alpha - beta;
        let (by_alpha, by_beta) = (by_alpha - 1.0, by_beta - 1.0);
        let all = [
            self.scale / self.k_i * (excess - beta * by_beta),
            by_beta * s,
            self.scale / self.nu * (alpha * by_alpha + beta * by_beta - excess),
            self.scale * self.level * by_shape[0],
            self.scale * by_shape[1],
        ];
        for ((slope, all), held) in by_coefficient.iter_mut().zip(all).zip(self.at_held_slopes) {
            *slope = all - held;
        }
        (self.scale * excess - self.at_held, [self.k_i * by_alpha, self.k_s * by_beta])
    }
}

/// The gap relative to rest, kept open, and its slope.
#[inline(always)]
fn gap(free: f64) -> (f64, f64) {
    if free > 2.0 * CLOSED {
        return (free, 1.0);
    }
    let bend = ((free - 2.0 * CLOSED) / CLOSED).exp();
    (CLOSED * (1.0 + bend), bend)
}
