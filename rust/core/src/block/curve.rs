//! Flux against magnetomotive force, both relative to their values at rest of an unsaturated magnet.

use crate::block::elementary::{Pair, exp, ln, tanh};

/// B(x) for x >= 0; its slope at zero is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Curve {
    /// `B = x`.
    Unsaturated,
    /// `B = x / (1 + (sigma x)^n)^(1/n)`.
    Power,
    /// `B = tanh(sigma x) / sigma`.
    Tanh,
    /// The root of [`Self::Unsaturated`]: its square, which the force goes with, is the flux.
    RootUnsaturated,
    /// The root of [`Self::Power`].
    RootPower,
}

impl Curve {
    /// The curve that this is the root of.
    fn squared(self) -> Option<Self> {
        match self {
            Self::RootUnsaturated => Some(Self::Unsaturated),
            Self::RootPower => Some(Self::Power),
            _ => None,
        }
    }

    /// Whether `sigma` and `n` are those of a power curve.
    pub(super) fn is_power(self) -> bool {
        matches!(self, Self::Power | Self::RootPower)
    }
}

/// Flux below which its root has no slope.
const NONE: f64 = 1e-12;

/// B at one x, and its derivatives by x, `sigma` and `n`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flux {
    pub value: f64,
    pub by_x: f64,
    pub by_shape: [f64; 2],
}

impl Flux {
    /// Its root, with the derivatives of that.
    #[inline(always)]
    fn root(self) -> Self {
        let value = self.value.sqrt();
        let half = if self.value > NONE { 0.5 / value } else { 0.0 };
        Self { value, by_x: half * self.by_x, by_shape: self.by_shape.map(|slope| half * slope) }
    }
}

/// A curve with its numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub curve: Curve,
    pub sigma: f64,
    pub n: f64,
}

impl Shape {
    /// `B^2` of both magnets.
    #[inline(always)]
    pub fn pull<const FMA: bool>(&self, x: Pair) -> Pair {
        let flux = match self.curve {
            Curve::RootUnsaturated => return x,
            Curve::RootPower => return power::<FMA>(x, self.sigma, self.n).map(|power| power.value),
            Curve::Tanh if self.sigma != 0.0 => {
                let per_sigma = 1.0 / self.sigma;
                let t = tanh::<FMA>([self.sigma * x[0], self.sigma * x[1]]);
                [t[0] * per_sigma, t[1] * per_sigma]
            }
            Curve::Power => power::<FMA>(x, self.sigma, self.n).map(|power| power.value),
            _ => x,
        };
        [flux[0] * flux[0], flux[1] * flux[1]]
    }

    /// B of both magnets with its derivatives.
    #[inline(always)]
    pub fn flux<const FMA: bool>(&self, x: Pair) -> [Flux; 2] {
        let root = self.curve.squared();
        let [first, second] = self.plain::<FMA>(root.unwrap_or(self.curve), x);
        if root.is_some() { [first.root(), second.root()] } else { [first, second] }
    }

    /// The same of a curve that is no root.
    #[inline(always)]
    fn plain<const FMA: bool>(&self, curve: Curve, x: Pair) -> [Flux; 2] {
        let Self { sigma, n, .. } = *self;
        match curve {
            Curve::Tanh if sigma != 0.0 => {
                let t = tanh::<FMA>([sigma * x[0], sigma * x[1]]);
                [tanh_flux(x[0], sigma, t[0]), tanh_flux(x[1], sigma, t[1])]
            }
            Curve::Power => {
                let [first, second] = power::<FMA>(x, sigma, n);
                [first.flux(sigma, n), second.flux(sigma, n)]
            }
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
            Curve::RootUnsaturated => (0.5, [0.0; 2]),
            Curve::RootPower if sigma > 0.0 => {
                let q = sigma.powf(n);
                let share = q / (1.0 + q);
                let value = 0.5 * (1.0 + q).powf(-1.0 / n - 1.0);
                let by_n = value * ((1.0 + q).ln() / (n * n) - (1.0 / n + 1.0) * share * sigma.ln());
                (value, [-(1.0 + n) * value * share / sigma, by_n])
            }
            Curve::RootPower => (0.5, [0.0; 2]),
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

/// B of a power curve with what its derivatives are made of: `q = (sigma x)^n`, its root being `(1 + q)^(-1/n)`.
struct Power {
    value: f64,
    root: f64,
    q: f64,
    log_q: f64,
    log_sum: f64,
}

#[inline(always)]
fn power<const FMA: bool>(x: Pair, sigma: f64, n: f64) -> [Power; 2] {
    let logs = ln::<FMA>([sigma * x[0], sigma * x[1]]);
    let log_q = [n * logs[0], n * logs[1]];
    let q = exp::<FMA>(log_q);
    let sums = ln::<FMA>([1.0 + q[0], 1.0 + q[1]]);
    let per_n = -1.0 / n;
    let root = exp::<FMA>([per_n * sums[0], per_n * sums[1]]);
    let one = |k: usize| Power { value: x[k] * root[k], root: root[k], q: q[k], log_q: log_q[k], log_sum: sums[k] };
    [one(0), one(1)]
}

impl Power {
    #[inline(always)]
    fn flux(&self, sigma: f64, n: f64) -> Flux {
        let inverse = 1.0 / (1.0 + self.q);
        let share = self.q * inverse;
        let by_sigma = if self.q * sigma > 0.0 { -self.value * share / sigma } else { 0.0 };
        let by_n = self.value * (self.log_sum - share * self.log_q) / (n * n);
        Flux { value: self.value, by_x: self.root * inverse, by_shape: [by_sigma, by_n] }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_values() {
        let h = 1e-6;
        for curve in [Curve::Tanh, Curve::Power, Curve::RootPower] {
            for sigma in [1e-3, 0.04, 0.06, 0.5, 1.5] {
                let shape = Shape { curve, sigma, n: 3.5 };
                let with = |sigma: f64, n: f64| Shape { sigma, n, ..shape };
                for x in [0.0, 0.3, 1.0, 4.0].into_iter().filter(|x| *x > 0.0 || curve != Curve::RootPower) {
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
