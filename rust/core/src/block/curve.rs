//! Flux against magnetomotive force, both relative to their values at rest of an unsaturated magnet.

use std::f64::consts::LOG2_E;

use crate::product::fused;

/// B(x) for x >= 0; its slope at zero is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Curve {
    /// `B = x`.
    Unsaturated,
    /// `B = x / (1 + (sigma x)^n)^(1/n)`.
    Power,
    /// `B = tanh(sigma x) / sigma`.
    Tanh,
}

/// B at one x, and its derivatives by x, `sigma` and `n`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flux {
    pub value: f64,
    pub by_x: f64,
    pub by_shape: [f64; 2],
}

/// A curve with its numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub curve: Curve,
    pub sigma: f64,
    pub n: f64,
}

/// The two magnets of an axis.
pub(super) type Pair = [f64; 2];

impl Shape {
    /// `B^2` of both magnets.
    #[inline(always)]
    pub fn pull<const FMA: bool>(&self, x: Pair) -> Pair {
        let flux = match self.curve {
            Curve::Tanh if self.sigma != 0.0 => {
                let per_sigma = 1.0 / self.sigma;
                let t = tanh::<FMA>([self.sigma * x[0], self.sigma * x[1]]);
                [t[0] * per_sigma, t[1] * per_sigma]
            }
            Curve::Power => [self.power(x[0]), self.power(x[1])],
            _ => x,
        };
        [flux[0] * flux[0], flux[1] * flux[1]]
    }

    fn power(&self, x: f64) -> f64 {
        // logarithms and exponentials: a power costs more than both
        let q = (self.n * (self.sigma * x).ln()).exp();
        x * ((1.0 + q).ln() * (-1.0 / self.n)).exp()
    }

    /// B of both magnets with its derivatives.
    #[inline(always)]
    pub fn flux<const FMA: bool>(&self, x: Pair) -> [Flux; 2] {
        let Self { curve, sigma, n } = *self;
        match curve {
            Curve::Tanh if sigma != 0.0 => {
                let t = tanh::<FMA>([sigma * x[0], sigma * x[1]]);
                [tanh_flux(x[0], sigma, t[0]), tanh_flux(x[1], sigma, t[1])]
            }
            Curve::Power => x.map(|x| power_flux(x, sigma, n)),
            _ => x.map(|x| Flux { value: x, by_x: 1.0, by_shape: [0.0; 2] }),
        }
    }

    /// `B B'` at x = 1, and its derivatives by `sigma` and `n`.
    pub fn at_rest(&self) -> (f64, [f64; 2]) {
        let Self { curve, sigma, n } = *self;
        match curve {
            Curve::Tanh if sigma != 0.0 => {
                let t = sigma.tanh();
                let slope = 1.0 - t * t;
                (t * slope / sigma, [slope * (tanh_bend(sigma, t) - 2.0 * t * t / sigma), 0.0])
            }
            Curve::Power if sigma > 0.0 => {
                let q = sigma.powf(n);
                let share = q / (1.0 + q);
                let value = (1.0 + q).powf(-2.0 / n - 1.0);
                let by_n = value * (2.0 * (1.0 + q).ln() / (n * n) - (2.0 / n + 1.0) * share * sigma.ln());
                (value, [-(2.0 + n) * value * share / sigma, by_n])
            }
            _ => (1.0, [0.0; 2]),
        }
    }
}

/// With `t = tanh(sigma x)`.
#[inline(always)]
fn tanh_flux(x: f64, sigma: f64, t: f64) -> Flux {
    let by_sigma = x * x * tanh_bend(sigma * x, t);
    Flux { value: t / sigma, by_x: 1.0 - t * t, by_shape: [by_sigma, 0.0] }
}

fn power_flux(x: f64, sigma: f64, n: f64) -> Flux {
    let ln_x = (sigma * x).ln();
    let q = (n * ln_x).exp();
    let log = (1.0 + q).ln();
    let root = (-log / n).exp();
    let share = q / (1.0 + q);
    let value = x * root;
    let by_sigma = if q > 0.0 { -value * share / sigma } else { 0.0 };
    let by_n = if q > 0.0 { value * (log / (n * n) - share * ln_x / n) } else { 0.0 };
    Flux { value, by_x: root / (1.0 + q), by_shape: [by_sigma, by_n] }
}

/// `(t tanh'(t) - tanh(t)) / t^2`, with `value = tanh(t)`.
#[inline(always)]
fn tanh_bend(t: f64, value: f64) -> f64 {
    if t.abs() > 0.05 {
        return (t * (1.0 - value * value) - value) / (t * t);
    }
    let square = t * t;
    t * (-2.0 / 3.0 + square * (8.0 / 15.0 + square * (-34.0 / 105.0 + square * (496.0 / 2835.0))))
}

/// `1/2!, 1/3!, .. 1/13!`.
const INVERSE_FACTORIALS: [f64; 12] = [
    0.5,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// tanh of two numbers to a few units in the last place, without a call: `e/(e + 2)` with `e = exp(2 |x|) - 1`.
///
/// `2 |x| = k ln 2 + r`; the exponential of r less one is its Taylor series, which keeps small numbers exact.
#[inline(always)]
pub(super) fn tanh<const FMA: bool>(x: Pair) -> Pair {
    const TO_INTEGER: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: adding it rounds to an integer
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let c = &INVERSE_FACTORIALS;
    let mut out = [0.0; 2];
    for (out, x) in out.iter_mut().zip(x) {
        let y = 2.0 * x.abs().min(20.0);
        let shifted = fused::<FMA>(y, LOG2_E, TO_INTEGER);
        let k = shifted - TO_INTEGER;
        let r = fused::<FMA>(k, -LN_2_LOW, fused::<FMA>(k, -LN_2_HIGH, y));
        let r2 = r * r;
        let r4 = r2 * r2;
        let pair = |i: usize| fused::<FMA>(c[i + 1], r, c[i]);
        let four = |i: usize| fused::<FMA>(r2, pair(i + 2), pair(i));
        let series = fused::<FMA>(r4, fused::<FMA>(r4, four(8), four(4)), four(0));
        let small = fused::<FMA>(r2, series, r);
        let scale = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1.0_f64.to_bits())); // 2^k
        let e = fused::<FMA>(small, scale, scale - 1.0);
        *out = (e / (e + 2.0)).copysign(x);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tanh_is_that_of_the_standard_library() {
        for i in -4000..=4000 {
            let x = f64::from(i) * 7.3e-3;
            for found in [tanh::<false>([x; 2]), tanh::<true>([x; 2])] {
                let error = (found[0] - x.tanh()).abs();
                assert!(error <= 6e-16 * x.tanh().abs(), "tanh({x}) off by {error:.1e}");
            }
        }
        assert_eq!(tanh::<false>([1e-200, f64::INFINITY]), [1e-200, 1.0]);
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        let h = 1e-6;
        for curve in [Curve::Tanh, Curve::Power] {
            for sigma in [1e-3, 0.04, 0.06, 0.5, 1.5] {
                let shape = Shape { curve, sigma, n: 3.5 };
                let with = |sigma: f64, n: f64| Shape { sigma, n, ..shape };
                for x in [0.0, 0.3, 1.0, 4.0] {
                    let [flux, _] = shape.flux::<false>([x; 2]);
                    assert!((flux.value.powi(2) - shape.pull::<false>([x; 2])[0]).abs() < 1e-14);
                    let at = |s: Shape, x: f64| s.flux::<false>([x; 2])[0].value;
                    let hs = h * sigma;
                    let by_sigma = (at(with(sigma + hs, 3.5), x) - at(with(sigma - hs, 3.5), x)) / (2.0 * hs);
                    let by_n = (at(with(sigma, 3.5 + h), x) - at(with(sigma, 3.5 - h), x)) / (2.0 * h);
                    assert!((flux.by_shape[0] - by_sigma).abs() < 1e-8 * (1.0 + 1.0 / sigma), "{curve:?} {sigma} {x}");
                    assert!((flux.by_shape[1] - by_n).abs() < 1e-8, "{curve:?} {sigma} {x}");
                    if x > 0.0 {
                        let by_x = (at(shape, x + h) - at(shape, x - h)) / (2.0 * h);
                        assert!((flux.by_x - by_x).abs() < 1e-8, "{curve:?} {sigma} {x}");
                    }
                }
                let (rest, slopes) = shape.at_rest();
                let [flux, _] = shape.flux::<false>([1.0; 2]);
                assert!((rest - flux.value * flux.by_x).abs() < 1e-15);
                let hs = h * sigma;
                let by_sigma = (with(sigma + hs, 3.5).at_rest().0 - with(sigma - hs, 3.5).at_rest().0) / (2.0 * hs);
                let by_n = (with(sigma, 3.5 + h).at_rest().0 - with(sigma, 3.5 - h).at_rest().0) / (2.0 * h);
                assert!((slopes[0] - by_sigma).abs() < 1e-8 * (1.0 + 1.0 / sigma), "{curve:?} {sigma}");
                assert!((slopes[1] - by_n).abs() < 1e-8, "{curve:?} {sigma}");
            }
        }
    }
}
