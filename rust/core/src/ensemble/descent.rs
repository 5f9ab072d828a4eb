//! A descent within bounds by a reflective trust region (Branch, Coleman and Li, SIAM J. Sci. Comput. 21 (1999) 1).
//!
//! The sum of squares comes as normal equations; with the eigenvectors `J'J = V L V'` a residual `L^-1/2 V'J'r` and a
//! Jacobian `L^1/2 V'` have the same gradient and Hessian as the long ones.

use nalgebra::{DMatrix, DVector, SVD, SymmetricEigen};

use super::region::{Region, feasible, on_bound};
use crate::error::{Error, Result};
use crate::whitened::LineNormal;

/// Where a bound of zero begins.
const TINY: f64 = 1e-9;
/// Least eigenvalue of J'J, relative to the largest one.
const FLOOR: f64 = 1e-15;
/// Distance to a bound that a start keeps, relative to x.
const MARGIN: f64 = 1e-12;
/// The same of a start that lies on a bound.
const OFF_BOUND: f64 = 1e-10;

/// How a descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// At an optimum.
    Converged,
    /// At an optimum on a bound.
    AtBound,
    /// The evaluations ran out before.
    MaxEvaluations,
}

/// See [`super::Fit`].
pub struct Settings<'a> {
    pub scale: &'a [f64],
    pub lower: &'a [f64],
    pub upper: &'a [f64],
    /// See [`super::Fit::prior`]; a value that is known beforehand may lie on its bound.
    pub prior: &'a [f64],
    pub most: usize,
    pub step: f64,
    pub enough: f64,
    pub numbers: f64,
    pub witnesses: f64,
}

pub struct Ended {
    pub x: DVector<f64>,
    pub status: Status,
    pub evaluations: usize,
    pub normal: LineNormal,
}

/// Goes downhill from `x`; where `evaluate` fails there is no model, and the step there is rejected.
///
/// # Errors
/// Of the first evaluation, and [`Error::Stopped`].
pub fn descend(
    evaluate: &mut impl FnMut(&DVector<f64>) -> Result<LineNormal>,
    x: DVector<f64>,
    settings: &Settings<'_>,
) -> Result<Ended> {
    let lower = DVector::from_iterator(x.len(), settings.lower.iter().map(|b| if *b == 0.0 { TINY } else { *b }));
    let upper = DVector::from_column_slice(settings.upper);
    let margin = x.map(|x| MARGIN * x.abs().max(1.0));
    let inside = x.sup(&(&lower + &margin)).inf(&(&upper - &margin));
    let start = feasible(&inside, &lower, &upper, OFF_BOUND);
    let (small, least) = (settings.step.powf(1.25), settings.step.powf(1.5));
    let first = evaluate(&start)?;
    let mut at = Point::new(start, first, settings).ok_or(Error::NotFinite { what: "sum of squares" })?;
    let mut evaluations = 1;
    let (v, _) = at.to_bounds(&lower, &upper);
    let mut radius = at.x.zip_map(&v, |x, v| x / v.sqrt()).norm();
    if radius == 0.0 {
        radius = 1.0;
    }
    let mut damping = 0.0;
    let mut done = false;
    loop {
        if at.explained.norm_squared() < settings.enough.max(least * 2.0 * at.half) {
            // what a step would still gain, bounds or not
            return Ok(Ended { x: at.x, status: Status::Converged, evaluations, normal: at.normal });
        }
        let (v, dv) = at.to_bounds(&lower, &upper);
        let slope = at.gradient.component_mul(&v).amax();
        done |= slope < small;
        if done || evaluations >= settings.most {
            break;
        }
        let region = Region::new(&at.x, &at.gradient, &at.jacobian, v, &dv, &lower, &upper, slope);
        let svd = Singular::new(&region, &at.explained);
        let mut better = None;
        while better.is_none() && evaluations < settings.most {
            let p;
            (p, damping) = svd.step(radius, damping);
            let (step, scaled, predicted) = region.step(p, radius);
            let trial = feasible(&(&at.x + &step), &lower, &upper, 0.0);
            evaluations += 1;
            let found = match evaluate(&trial) {
                Err(Error::Stopped) => return Err(Error::Stopped),
                found => found.ok().and_then(|normal| Point::new(trial, normal, settings)),
            };
            let size = scaled.norm();
            let Some(found) = found else {
                radius = 0.25 * size;
                continue;
            };
            let fall = at.half - found.half;
            let ratio = if predicted > 0.0 { fall / predicted } else { f64::from(predicted == 0.0 && fall == 0.0) };
            let mut wider = radius;
            if ratio < 0.25 {
                wider = 0.25 * size;
            } else if ratio > 0.75 && size > 0.95 * radius {
                wider = 2.0 * radius;
            }
            let (moved, length) = (step.norm(), at.x.norm());
            done = (fall < small * at.half && ratio > 0.25) || moved < settings.step * (settings.step + length);
            if !done {
                damping *= radius / wider;
                radius = wider;
            }
            if fall > 0.0 {
                better = Some(found);
            }
            if done {
                break;
            }
        }
        match better {
            Some(found) => at = found,
            None if done => break,
            None => {} // the evaluations ran out
        }
    }
    let status = if !done {
        Status::MaxEvaluations
    } else if on_bound(&at.x, &lower, &upper, settings.step)
        .zip(at.x.iter().zip(settings.prior))
        .any(|(on, (x, prior))| on != 0 && x.abs() > 10.0 * TINY && *prior == 0.0)
    {
        Status::AtBound
    } else {
        Status::Converged
    };
    Ok(Ended { x: at.x, status, evaluations, normal: at.normal })
}

/// The sum of squares about one x, in units of the scale.
struct Point {
    x: DVector<f64>,
    jacobian: DMatrix<f64>,
    /// The part of the residual that a step can take.
    explained: DVector<f64>,
    gradient: DVector<f64>,
    /// Half the sum of squares.
    half: f64,
    normal: LineNormal,
}

impl Point {
    /// Nothing where a number is not finite.
    ///
    /// Beside a prior, what is left above noise is a misfit that W witnesses share of N numbers: with its size that is
    /// likeliest, `N + W ln V + prior`, `V = 1 + (r'r - N) / W`, takes the place of the sum of squares where `r'r > N`.
    fn new(x: DVector<f64>, normal: LineNormal, settings: &Settings<'_>) -> Option<Self> {
        let scale = DVector::from_column_slice(settings.scale);
        let prior = DVector::from_column_slice(settings.prior).component_mul(&scale).component_mul(&scale);
        let by_prior = prior.component_mul(&x);
        let known = by_prior.dot(&x);
        let measured = normal.cost - known;
        let excess = if settings.witnesses > 0.0 { (measured - settings.numbers).max(0.0) } else { 0.0 };
        let variance = 1.0 + if excess > 0.0 { excess / settings.witnesses } else { 0.0 };
        let cost = normal.cost - excess + if excess > 0.0 { settings.witnesses * variance.ln() } else { 0.0 };
        let rest = 1.0 - 1.0 / variance;
        let mut hessian = DMatrix::from_fn(x.len(), x.len(), |i, j| normal.hessian[(i, j)] * scale[i] * scale[j]);
        let mut slope = normal.gradient.component_mul(&scale);
        if variance > 1.0 {
            hessian.unscale_mut(variance);
            slope.unscale_mut(variance);
            (0..x.len()).for_each(|i| hessian[(i, i)] += rest * prior[i]);
            slope.axpy(rest, &by_prior, 1.0);
        }
        if !(cost.is_finite() && slope.iter().chain(hessian.iter()).all(|number| number.is_finite())) {
            return None;
        }
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(hessian);
        let floor = eigenvalues.max() * FLOOR;
        let roots = eigenvalues.map(|value| value.max(floor).sqrt());
        let explained = eigenvectors.tr_mul(&slope).component_div(&roots);
        let jacobian = DMatrix::from_diagonal(&roots) * eigenvectors.transpose();
        let gradient = jacobian.tr_mul(&explained);
        let half = 0.5 * cost.max(explained.norm_squared());
        half.is_finite().then_some(Self { x, jacobian, explained, gradient, half, normal })
    }

    /// Distance to the bound that the gradient leads to, 1 where there is none, and its derivative by x.
    fn to_bounds(&self, lower: &DVector<f64>, upper: &DVector<f64>) -> (DVector<f64>, DVector<f64>) {
        let one = |i: usize| match self.gradient[i] {
            g if g < 0.0 && upper[i].is_finite() => (upper[i] - self.x[i], -1.0),
            g if g > 0.0 && lower[i].is_finite() => (self.x[i] - lower[i], 1.0),
            _ => (1.0, 0.0),
        };
        let size = self.x.len();
        (DVector::from_fn(size, |i, _| one(i).0), DVector::from_fn(size, |i, _| one(i).1))
    }
}

/// The augmented Jacobian's singular values, for steps of any length (More 1977).
struct Singular {
    s: DVector<f64>,
    v: DMatrix<f64>,
    /// Residual along the left singular vectors.
    along: DVector<f64>,
}

impl Singular {
    fn new(region: &Region<'_>, explained: &DVector<f64>) -> Self {
        let n = explained.len();
        let augmented = DMatrix::from_fn(2 * n, n, |i, j| match i {
            i if i < n => region.jacobian[(i, j)],
            i if i - n == j => region.curvature[j].sqrt(),
            _ => 0.0,
        });
        let SVD { u, v_t, singular_values: s } = SVD::new(augmented, true, true);
        // both were asked for
        let (u, v_t) = (u.unwrap_or_else(|| DMatrix::zeros(2 * n, n)), v_t.unwrap_or_else(|| DMatrix::zeros(n, n)));
        let along = u.rows(0, n).tr_mul(explained);
        Self { s, v: v_t.transpose(), along }
    }

    /// The step within `radius`, and the damping that makes it so short; `damping` is a first guess.
    fn step(&self, radius: f64, damping: f64) -> (DVector<f64>, f64) {
        let (n, s) = (self.s.len(), &self.s);
        let pulled = s.component_mul(&self.along);
        let full = s[n - 1] > f64::EPSILON * (n + 1) as f64 * s[0];
        if full {
            let p = -(&self.v * self.along.component_div(s));
            if p.norm() <= radius {
                return (p, 0.0);
            }
        }
        // length of the step beyond the radius, and its derivative by the damping
        let beyond = |damping: f64| {
            let size = pulled.zip_map(s, |f, s| f / (s * s + damping)).norm();
            let slope = -pulled.zip_map(s, |f, s| f * f / (s * s + damping).powi(3)).sum() / size;
            (size - radius, slope)
        };
        let mut high = pulled.norm() / radius;
        let mut low = 0.0;
        if full {
            let (phi, slope) = beyond(0.0);
            low = -phi / slope;
        }
        let between = |low: f64, high: f64| (0.001 * high).max((low * high).sqrt());
        let mut damping = if !full && damping == 0.0 { between(low, high) } else { damping };
        for _ in 0..10 {
            if damping < low || damping > high {
                damping = between(low, high);
            }
            let (phi, slope) = beyond(damping);
            if phi < 0.0 {
                high = damping;
            }
            let ratio = phi / slope;
            low = low.max(damping - ratio);
            damping -= (phi + radius) * ratio / radius;
            if phi.abs() < 0.01 * radius {
                break;
            }
        }
        let p = -(&self.v * pulled.zip_map(s, |f, s| f / (s * s + damping)));
        let size = p.norm();
        (p * (radius / size), damping)
    }
}
