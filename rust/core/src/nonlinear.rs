//! Response of a nonlinear loop and its sensitivities: the linear part exact, the blocks of Delta to fourth order.
//!
//! With `x' = A x + B (u + w)` and `w = w(z, theta)`, the derivative by a parameter obeys
//! `S' = A S + B (dw/dz dz + dw/dtheta)`, and a free gain adds `slope z` at its own port. Value and derivatives take
//! the same steps, with the same matrices.

mod control;
mod phi;
mod plant;
mod rows;
mod run;
mod scheme;
mod segments;

use crate::error::{Error, Result};
use crate::kernel::BLOCK;
use crate::model::{Controller, Model};
use crate::reading::{Group, groups};
use crate::stop::go_on;
use plant::Plant;

pub use run::Run;

/// Substeps are doubled until the response changes by less than this, relative to the peak of each column.
const GOAL: f64 = 2e-7;
/// So many times the change is allowed of a derivative.
const SLOPES: f64 = 5.0;
/// The change that is still accepted at [`MOST_SUBSTEPS`], and how many times that of a derivative: it jumps where a
/// law bends.
const PROMISE: f64 = 1e-6;
const BENT_SLOPES: f64 = 100.0;
const MOST_SUBSTEPS: usize = 256;
/// Samples that decide on the number of substeps of derivatives.
const PROBE: usize = 256;
/// An output beyond this is no response of a machine, be it in metres, amperes or newtons.
const LIMIT: f64 = 1e6;

/// A nonlinear loop at one parameter set.
///
/// Output columns are those of [`crate::linear::Response`].
pub struct Nonlinear {
    plant: Plant,
    controller: Option<Controller>,
    late: Vec<Group>,
    free: Vec<usize>,
    dt: f64,
    substeps: Option<usize>,
    inputs: usize,
    outputs: usize,
    /// Derivatives less than this share of the peak of their output count as this large.
    floors: Vec<f64>,
    /// The same without derivatives, where substeps are to be chosen with some.
    bare: Option<Box<Self>>,
}

impl Nonlinear {
    /// # Errors
    /// [`Error::Singular`], [`Error::NotFinite`].
    pub fn new(model: &Model, theta: &[f64], free: &[usize]) -> Result<Self> {
        let floors = free.iter().map(|f| if theta[*f] == 0.0 { 0.0 } else { 1e-3 / theta[*f].abs() });
        let controller = model.controller.as_ref().filter(|k| k.channels() > 0);
        let controller = controller.map(|k| k.at(theta, model.dt)).transpose()?;
        let bare = (model.substeps.is_none() && !free.is_empty()).then(|| Self::new(model, theta, &[])).transpose()?;
        Ok(Self {
            plant: Plant::new(model, theta, free)?,
            controller,
            late: groups(model, theta, free)?.into_iter().filter(|group| !group.instant.is_at_sample()).collect(),
            free: free.to_vec(),
            dt: model.dt,
            substeps: model.substeps,
            inputs: model.inputs(),
            outputs: model.outputs(),
            floors: [1.0].into_iter().chain(floors).collect(),
            bare: bare.map(Box::new),
        })
    }

    /// Runs from rest over `u` (samples x inputs); see [`crate::kernel::Kernel::run`] for the sink.
    ///
    /// # Errors
    /// [`Error::Diverged`], [`Error::Unresolved`].
    pub fn run(&self, u: &[f64], sink: &mut impl FnMut(usize, usize, &[f64], usize)) -> Result<()> {
        let mut run = self.ready(u)?;
        let columns = self.columns();
        let mut block = vec![0.0; BLOCK * columns];
        for (i, u) in u.chunks(BLOCK * self.inputs).enumerate() {
            go_on()?;
            let count = u.len() / self.inputs;
            for (k, (u, y)) in u.chunks_exact(self.inputs).zip(block.chunks_exact_mut(columns)).enumerate() {
                run.sample(u, y);
                self.check(y, i * BLOCK + k)?;
            }
            sink(i * BLOCK, count, &block, columns);
        }
        Ok(())
    }

    /// The response to `u`, samples x outputs, from a state of the loop linearised at rest on; see [`Run::place`].
    ///
    /// # Errors
    /// As [`Nonlinear::run`].
    pub fn run_from(&self, state: &[f64], u: &[f64]) -> Result<Vec<f64>> {
        let mut run = self.ready(u)?;
        run.place(state);
        self.response(&mut run, u)
    }

    /// The loop at rest, with the substeps that are given or that `u` needs.
    fn ready(&self, u: &[f64]) -> Result<Run> {
        self.start(self.substeps.map_or_else(|| self.everywhere(u, self.resolved(u)?), Ok)?)
    }

    /// The loop at rest with a given number of substeps.
    pub fn start(&self, substeps: usize) -> Result<Run> {
        Run::new(self.plant.clone(), self.controller.as_ref(), &self.free, self.dt, substeps, &self.late)
    }

    /// As many substeps as the loudest stretch of `u` needs.
    fn resolved(&self, u: &[f64]) -> Result<usize> {
        let probe = loudest(u, PROBE * self.inputs);
        let mut before = self.response(&mut self.start(1)?, probe);
        let mut substeps = 1;
        loop {
            let after = self.response(&mut self.start(2 * substeps)?, probe);
            let change = match (&before, &after) {
                (Ok(before), Ok(after)) => self.change(before, after, SLOPES),
                _ => f64::INFINITY,
            };
            if change < GOAL {
                return Ok(substeps);
            }
            substeps *= 2;
            if substeps >= MOST_SUBSTEPS {
                let change = self.change(&before?, &after?, BENT_SLOPES);
                return if change < PROMISE { Ok(substeps) } else { Err(Error::Unresolved { substeps, change }) };
            }
            before = after;
        }
    }

    /// As many as all of `u` needs, at least so many: what the loudest stretch begins, motion may reach later.
    fn everywhere(&self, u: &[f64], mut substeps: usize) -> Result<usize> {
        let bare = self.bare.as_deref().unwrap_or(self);
        let mut before = bare.response(&mut bare.start(substeps)?, u);
        while substeps < MOST_SUBSTEPS {
            let after = bare.response(&mut bare.start(2 * substeps)?, u);
            match (&before, &after) {
                (Ok(before), Ok(after)) if bare.change(before, after, SLOPES) < GOAL => break,
                (Err(Error::Diverged { sample, .. }), Err(Error::Diverged { sample: later, .. }))
                    if sample.abs_diff(*later) <= 1 =>
                {
                    break; // by itself, not by its steps
                }
                (Err(error), _) | (_, Err(error)) if !matches!(error, Error::Diverged { .. }) => {
                    return Err(error.clone());
                }
                _ => {}
            }
            substeps *= 2;
            before = after;
        }
        Ok(substeps)
    }

    fn response(&self, run: &mut Run, u: &[f64]) -> Result<Vec<f64>> {
        let columns = self.columns();
        let mut out = vec![0.0; u.len() / self.inputs * columns];
        for (k, (u, y)) in u.chunks_exact(self.inputs).zip(out.chunks_exact_mut(columns)).enumerate() {
            if k % BLOCK == 0 {
                go_on()?;
            }
            run.sample(u, y);
            self.check(y, k)?;
        }
        Ok(out)
    }

    /// Largest change of a column relative to its peak, of derivatives by the factor `slopes` less.
    fn change(&self, before: &[f64], after: &[f64], slopes: f64) -> f64 {
        let (columns, rows) = (self.columns(), self.plant.rows);
        let peak = |column: usize| after.iter().skip(column).step_by(columns).fold(0.0, |a: f64, y| a.max(y.abs()));
        let relative = |column: usize| {
            let pairs = before.iter().zip(after).skip(column).step_by(columns);
            let change = pairs.fold(0.0, |a: f64, (b, c)| a.max((b - c).abs()));
            let row = column % rows;
            let size = peak(column).max(peak(column - row) * self.floors[row]) * if row > 0 { slopes } else { 1.0 };
            if change > 0.0 { change / size } else { 0.0 }
        };
        (0..columns).map(relative).fold(0.0, f64::max)
    }

    fn columns(&self) -> usize {
        self.outputs * self.plant.rows
    }

    fn check(&self, y: &[f64], sample: usize) -> Result<()> {
        let bounded = y.iter().step_by(self.plant.rows).all(|y| y.abs() < LIMIT) && y.iter().all(|y| y.is_finite());
        if bounded { Ok(()) } else { Err(Error::Diverged { sample, limit: LIMIT }) }
    }
}

/// The stretch of `length` values with the largest sum of squares.
fn loudest(u: &[f64], length: usize) -> &[f64] {
    let power = |stretch: &[f64]| stretch.iter().map(|u| u * u).sum::<f64>();
    u.chunks(length).fold((&u[..0], -1.0), |best, s| if power(s) > best.1 { (s, power(s)) } else { best }).0
}
