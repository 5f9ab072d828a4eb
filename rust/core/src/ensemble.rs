//! Many fits side by side: each goes downhill from its own start, on its own records, to the end.
//!
//! A fit runs in one thread from its first evaluation to its last, so that its numbers do not depend on the number of
//! threads. Fits of one experiment that was repeated begin where the first of them ended: there one run of the response
//! serves them all, and one more of its own brings each of them to its optimum, as exactly as from its start.

mod descent;
mod region;
mod repeats;

use nalgebra::{DMatrix, DVector};

use crate::closed_loop::ClosedLoop;
use crate::error::{Result, check_finite, check_len};
use crate::residual::{Data, Normal, normal_equations};
use crate::whitened::{LineData, LineNormal, line_equations};
use descent::{Settings, descend};

pub use descent::Status;
pub use repeats::fit_all;

/// Records that one compiled loop is held against.
#[derive(Debug, Clone)]
pub enum Records<'a> {
    /// Whitened lines of the spectrum.
    Lines(Vec<&'a LineData>),
    /// Weighted samples, simulated from rest (eq. 9).
    Samples(Vec<&'a Data>),
}

/// One fit: what is minimised, and where and how the descent goes.
///
/// The descent is in `x = theta / scale` of the parameters in `free`.
#[derive(Debug, Clone)]
pub struct Fit<'a> {
    /// The loop of each operating point with the records that belong to it.
    pub groups: Vec<(&'a ClosedLoop, Records<'a>)>,
    /// All parameters; those that are not free keep these values.
    pub theta: Vec<f64>,
    /// The parameters that are fitted.
    pub free: Vec<usize>,
    /// Unit of each of them.
    pub scale: Vec<f64>,
    /// Least x; zero is open, since a gain or time constant of zero is no model.
    pub lower: Vec<f64>,
    /// Largest x.
    pub upper: Vec<f64>,
    /// The start.
    pub x: Vec<f64>,
    /// Evaluations.
    pub most: usize,
    /// Relative step at which the descent ends.
    pub step: f64,
    /// Fall of the sum of squares below which no further step is gone; 0 where only `step` ends the descent.
    pub enough: f64,
    /// Judged numbers, and how many of them miss independently where more than noise is left; weighs beside the prior.
    pub numbers: f64,
    pub witnesses: f64,
    /// Of the parameters in `free` one over the variance that each is known to, about 0, before any record; 0 for
    /// nothing. What the values take of it is part of the sum of squares.
    pub prior: Vec<f64>,
}

/// Where a fit ended.
#[derive(Debug, Clone)]
pub struct End {
    /// All parameters.
    pub theta: Vec<f64>,
    /// How it ended.
    pub status: Status,
    /// Of the sum of squares and its derivatives, rejected steps included.
    pub evaluations: usize,
    /// The quadratic form about `theta`; of samples it has no transients.
    pub normal: LineNormal,
}

/// A place that a descent begins at, and what is known of it.
#[derive(Clone)]
struct Begin {
    x: DVector<f64>,
    normal: LineNormal,
}

impl Fit<'_> {
    /// The descent from the start, or from where others begin; and x of its end.
    fn run(&self, from: Option<Begin>) -> Result<(DVector<f64>, End)> {
        self.check()?;
        let settings = Settings {
            scale: &self.scale,
            lower: &self.lower,
            upper: &self.upper,
            prior: &self.prior,
            most: self.most,
            step: self.step,
            enough: self.enough,
            numbers: self.numbers,
            witnesses: self.witnesses,
        };
        let start = from.as_ref().map_or_else(|| DVector::from_column_slice(&self.x), |from| from.x.clone());
        let mut known = from;
        let mut before: Option<(DVector<f64>, LineNormal)> = None;
        let mut evaluate = |x: &DVector<f64>| -> Result<LineNormal> {
            if let Some(begin) = known.take_if(|begin| begin.x == *x) {
                return Ok(begin.normal);
            }
            let near = match &before {
                Some((last, normal)) => moved(normal, &(x - last).component_mul(&self.scales())),
                None => Vec::new(), // transients change with the parameters
            };
            let found = self.normal(&self.theta_at(x), &near)?;
            before = Some((x.clone(), found.clone()));
            Ok(found)
        };
        let ended = descend(&mut evaluate, start, &settings)?;
        let theta = self.theta_at(&ended.x);
        Ok((ended.x, End { theta, status: ended.status, evaluations: ended.evaluations, normal: ended.normal }))
    }

    fn check(&self) -> Result<()> {
        let own = [
            ("scale", &self.scale),
            ("lower bounds", &self.lower),
            ("upper bounds", &self.upper),
            ("start", &self.x),
            ("prior", &self.prior),
        ];
        own.iter().try_for_each(|(what, numbers)| check_len(what, numbers.len(), self.free.len()))?;
        check_finite("start", &self.x)?;
        self.groups.iter().try_for_each(|(system, _)| system.check(&self.theta, &self.free))
    }

    fn scales(&self) -> DVector<f64> {
        DVector::from_column_slice(&self.scale)
    }

    fn theta_at(&self, x: &DVector<f64>) -> Vec<f64> {
        let mut theta = self.theta.clone();
        self.free.iter().zip(x.iter().zip(&self.scale)).for_each(|(i, (x, scale))| theta[*i] = x * scale);
        theta
    }

    /// The sum of squares of all groups about `theta`; `near` are transients of the records on lines, or nothing.
    fn normal(&self, theta: &[f64], near: &[Vec<f64>]) -> Result<LineNormal> {
        let size = self.free.len();
        let mut total = without_transients(DMatrix::zeros(size, size), DVector::zeros(size), 0.0);
        for (system, records) in &self.groups {
            match records {
                Records::Lines(records) => {
                    let first = total.transients.len();
                    let own = near.get(first..first + records.len()).unwrap_or_default();
                    let found = line_equations(system, theta, &self.free, records, own)?;
                    total.hessian += found.hessian;
                    total.gradient += found.gradient;
                    total.cost += found.cost;
                    total.transients.extend(found.transients);
                    total.transient_slopes.extend(found.transient_slopes);
                    total.fitted.extend(found.fitted);
                }
                Records::Samples(records) => {
                    let found = normal_equations(system, theta, &self.free, records)?;
                    total.hessian += found.hessian;
                    total.gradient += found.gradient;
                    total.cost += found.squares.iter().sum::<f64>();
                }
            }
        }
        for (k, (i, weight)) in self.free.iter().zip(&self.prior).enumerate() {
            total.hessian[(k, k)] += weight;
            total.gradient[k] += weight * theta[*i];
            total.cost += weight * theta[*i] * theta[*i];
        }
        Ok(total)
    }
}

/// The transients of a quadratic form after a step of the parameters, by their slopes.
fn moved(normal: &LineNormal, step: &DVector<f64>) -> Vec<Vec<f64>> {
    let along = |(d, slopes): (&Vec<f64>, &Vec<f64>)| {
        let mut d = d.clone();
        for (slope, step) in slopes.chunks_exact(d.len().max(1)).zip(step.iter()) {
            d.iter_mut().zip(slope).for_each(|(d, slope)| *d += step * slope);
        }
        d
    };
    normal.transients.iter().zip(&normal.transient_slopes).map(along).collect()
}

fn without_transients(hessian: DMatrix<f64>, gradient: DVector<f64>, cost: f64) -> LineNormal {
    LineNormal { hessian, gradient, cost, transients: Vec::new(), transient_slopes: Vec::new(), fitted: Vec::new() }
}

impl From<Normal> for LineNormal {
    fn from(own: Normal) -> Self {
        without_transients(own.hessian, own.gradient, own.squares.iter().sum())
    }
}
