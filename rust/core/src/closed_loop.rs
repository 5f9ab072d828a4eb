//! The noun that callers hold: a closed loop, split into its independent parts.

use std::borrow::Cow;

use nalgebra::{Complex, DMatrix};

use crate::discretise::{Discrete, discretise};
use crate::error::{Result, check_finite, check_len};
use crate::linear::Response;
use crate::modal;
use crate::model::Model;
use crate::nonlinear::Nonlinear;
use crate::reading::{Shifted, last_period, shifts};
use crate::split::{Part, split};
use crate::steady::from_steady_state;
use crate::stop::each;

/// A closed loop of any number of bearings, axes, modes and parameters.
#[derive(Debug, Clone)]
pub struct ClosedLoop {
    model: Model,
    parts: Vec<Part>,
    parameters: usize,
}

impl ClosedLoop {
    /// `parameters` is the length of the parameter vector that the gains, blocks, delay and gain errors of the model
    /// refer to.
    ///
    /// # Errors
    /// [`crate::Error::Shape`] where one of them refers to a parameter that does not exist.
    pub fn new(model: Model, parameters: usize) -> Result<Self> {
        if let Some(missing) = model.parameters().find(|p| *p >= parameters) {
            check_len("parameter vector", parameters, missing + 1)?;
        }
        let parts = split(&model);
        Ok(Self { model, parts, parameters })
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.model.inputs()
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.model.outputs()
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.parameters
    }

    /// The parts that do not act on each other.
    pub(crate) fn each_part(&self) -> &[Part] {
        &self.parts
    }

    /// Number of independent parts.
    pub fn parts(&self) -> usize {
        self.parts.len()
    }

    /// Poles in 1/s; those of a digital loop are `ln(mu)/dt` of its poles over one sample of the record.
    ///
    /// Nonlinear blocks are linearised at rest.
    ///
    /// # Errors
    /// [`crate::Error::Singular`], [`crate::Error::NotFinite`].
    pub fn poles(&self, theta: &[f64]) -> Result<Vec<Complex<f64>>> {
        self.check(theta, &[])?;
        modal::poles(&self.model, theta)
    }

    /// The whole loop over one sample of the record, excitation held; nonlinear blocks linearised at rest.
    ///
    /// # Errors
    /// [`crate::Error::Singular`], [`crate::Error::NotFinite`].
    pub fn discrete(&self, theta: &[f64]) -> Result<Discrete> {
        self.check(theta, &[])?;
        Ok(discretise(&self.model, theta, &[])?.0)
    }

    /// Derivatives of A of [`ClosedLoop::discrete`] by the parameters in `free`, of a loop without nonlinear blocks.
    ///
    /// # Errors
    /// As [`ClosedLoop::discrete`].
    pub fn discrete_slopes(&self, theta: &[f64], free: &[usize]) -> Result<Vec<DMatrix<f64>>> {
        self.check(theta, free)?;
        let (_, slopes) = discretise(&self.model, theta, free)?;
        Ok(slopes.into_iter().map(|slope| slope.a).collect())
    }

    /// The response from rest, samples x outputs, to `u`, samples x inputs, both row by row.
    ///
    /// Inputs are excitations and further inputs of the plant, each held until the next sample.
    ///
    /// # Errors
    /// [`crate::Error::Unstable`], [`crate::Error::Shape`], [`crate::Error::NotFinite`], and as
    /// [`ClosedLoop::poles`].
    pub fn simulate(&self, theta: &[f64], u: &[f64]) -> Result<Vec<f64>> {
        let (y, _) = self.sensitivity(theta, &[], u)?;
        Ok(y)
    }

    /// The response and its exact derivative by the parameters in `free`: samples x outputs x `free`, row by row.
    ///
    /// # Errors
    /// As [`ClosedLoop::simulate`].
    pub fn sensitivity(&self, theta: &[f64], free: &[usize], u: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
        let samples = u.len().checked_div(self.inputs()).unwrap_or(0);
        self.folded(theta, free, u, 0, samples, 1.0)
    }

    /// The same, whole periods of `period` samples from `first` on added up: period x outputs (x `free`).
    ///
    /// The last period counts `last` times, as if it repeated.
    ///
    /// # Errors
    /// As [`ClosedLoop::simulate`].
    pub fn folded(
        &self,
        theta: &[f64],
        free: &[usize],
        u: &[f64],
        first: usize,
        period: usize,
        last: f64,
    ) -> Result<(Vec<f64>, Vec<f64>)> {
        let (ny, np) = (self.outputs(), free.len());
        let samples = u.len().checked_div(self.inputs()).unwrap_or(0);
        check_len("excitation", u.len(), samples * self.inputs())?;
        check_finite("excitation", u)?;
        let fold =
            Fold { first, period, periods: samples.saturating_sub(first).checked_div(period).unwrap_or(0), last };
        let prepared = self.prepare(theta, free)?;
        let sums = each(&prepared, |_, part| part.folded(u, self.inputs(), fold))?;
        let mut y = vec![0.0; period * ny];
        let mut jacobian = vec![0.0; period * ny * np];
        for (part, sum) in prepared.iter().zip(sums) {
            place(&sum, &part.outputs, &part.free, (&mut y, &mut jacobian), [ny, np]);
        }
        Ok((y, jacobian))
    }

    /// One period of the response to an excitation that repeats every `period` samples, the last one of `u`, and its
    /// derivative by the parameters in `free`.
    ///
    /// It starts from the steady state of the loop linearised at rest, so that a nonlinear loop needs less of a lead
    /// than from rest, and a linear one none; derivatives start with nothing, and a linear part that has some at rest.
    ///
    /// # Errors
    /// As [`ClosedLoop::simulate`], and [`crate::Error::Shape`] where `u` is shorter than a period.
    pub fn settled(&self, theta: &[f64], free: &[usize], u: &[f64], period: usize) -> Result<(Vec<f64>, Vec<f64>)> {
        self.check(theta, free)?;
        let (inputs, ny, np) = (self.inputs(), self.outputs(), free.len());
        let samples = u.len().checked_div(inputs).unwrap_or(0);
        check_len("excitation", u.len(), samples.max(period) * inputs)?;
        check_finite("excitation", u)?;
        let (mut y, mut jacobian) = (vec![0.0; period * ny], vec![0.0; period * ny * np]);
        for part in self.parts.iter().filter(|p| !p.inputs.is_empty()) {
            let acts: Vec<usize> = (0..np).filter(|j| part.model.parameters().any(|p| p == free[*j])).collect();
            if part.model.lft.blocks.is_empty() && !acts.is_empty() {
                let fold = Fold { first: samples - period, period, periods: 1, last: 1.0 };
                let last = Prepared::new(part, theta, free)?.folded(u, inputs, fold)?;
                place(&last, &part.outputs, &acts, (&mut y, &mut jacobian), [ny, np]);
                continue;
            }
            let parameters: Vec<usize> = acts.iter().map(|j| free[*j]).collect();
            let found = from_steady_state(&part.model, theta, &parameters, &columns(u, inputs, &part.inputs), period)?;
            let last = last_period(&found, 1 + acts.len(), &shifts(&part.model, theta)?, period);
            place(&last, &part.outputs, &acts, (&mut y, &mut jacobian), [ny, np]);
        }
        Ok((y, jacobian))
    }

    /// Every part at `theta`, with the derivatives by those of `free` that act on it.
    pub(crate) fn prepare(&self, theta: &[f64], free: &[usize]) -> Result<Vec<Prepared<'_>>> {
        self.check(theta, free)?;
        let prepare = |part| Prepared::new(part, theta, free);
        self.parts.iter().filter(|p| !p.inputs.is_empty()).map(prepare).collect()
    }

    /// The same of the outputs that count; of others too where that costs nothing.
    pub(crate) fn prepare_some(
        &self,
        theta: &[f64],
        free: &[usize],
        counts: impl Fn(usize) -> bool,
    ) -> Result<Vec<Prepared<'_>>> {
        let some = self.prepare(theta, free)?.into_iter().map(|part| part.only(&counts));
        Ok(some.filter(|part| !part.outputs.is_empty()).collect())
    }

    /// Whole samples by which each output is recorded late; the rest of its delay is in [`ClosedLoop::discrete`].
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where one is late or early by 1000 samples and more.
    pub fn shifts(&self, theta: &[f64]) -> Result<Vec<isize>> {
        self.check(theta, &[])?;
        shifts(&self.model, theta)
    }

    /// What it was made of.
    pub fn model(&self) -> &Model {
        &self.model
    }

    pub(crate) fn check(&self, theta: &[f64], free: &[usize]) -> Result<()> {
        check_len("parameter vector", theta.len(), self.parameters)?;
        check_finite("parameter vector", theta)?;
        if let Some(last) = free.iter().max().filter(|f| **f >= self.parameters) {
            check_len("parameter vector", self.parameters, last + 1)?;
        }
        Ok(())
    }
}

/// Whole periods from `first` on that are added up, the last one `last` times.
#[derive(Clone, Copy)]
struct Fold {
    first: usize,
    period: usize,
    periods: usize,
    last: f64,
}

/// One part, ready to run.
pub(crate) struct Prepared<'a> {
    path: Path,
    inputs: &'a [usize],
    pub outputs: Vec<usize>,
    /// Positions in the caller's `free` of the parameters that act on this part.
    pub free: Vec<usize>,
    /// Whole samples by which each output is recorded late.
    shifts: Vec<isize>,
}

impl<'a> Prepared<'a> {
    fn new(part: &'a Part, theta: &[f64], free: &[usize]) -> Result<Self> {
        let acts = |parameter: usize| part.model.parameters().any(|p| p == parameter);
        let own: Vec<usize> = (0..free.len()).filter(|j| acts(free[*j])).collect();
        let parameters: Vec<usize> = own.iter().map(|j| free[*j]).collect();
        let path = if part.model.lft.blocks.is_empty() {
            Path::Linear(Response::new(&part.model, theta, &parameters)?)
        } else {
            modal::poles(&part.model, theta)?; // refuses a command that would follow itself at once; a pole may grow
            Path::Nonlinear(Box::new(Nonlinear::new(&part.model, theta, &parameters)?))
        };
        let shifts = shifts(&part.model, theta)?;
        Ok(Self { path, inputs: &part.inputs, outputs: part.outputs.clone(), free: own, shifts })
    }

    /// The same without the outputs that do not count, where it is cheaper without them.
    fn only(mut self, counts: impl Fn(usize) -> bool) -> Self {
        if let Path::Linear(Response::Modal(kernel)) = &mut self.path {
            let width = 1 + self.free.len();
            kernel.keep(|column| counts(self.outputs[column / width]));
            let own = self.outputs.iter().zip(&self.shifts).filter(|(o, _)| counts(**o));
            (self.outputs, self.shifts) = own.map(|(o, m)| (*o, *m)).unzip();
        }
        self
    }

    /// Runs over all samples of `u`, which has `inputs` columns; see [`crate::kernel::Kernel::run`] for the sink.
    ///
    /// # Errors
    /// [`crate::Error::Diverged`] and [`crate::Error::Unresolved`] of a nonlinear part.
    pub fn run(&self, u: &[f64], inputs: usize, sink: &mut impl FnMut(usize, usize, &[f64], usize)) -> Result<()> {
        let u = columns(u, inputs, self.inputs);
        if self.shifts.iter().all(|m| *m == 0) {
            return self.path.run(&u, sink);
        }
        let mut shifted = Shifted::new(&self.shifts, 1 + self.free.len());
        let u = shifted.extended(&u, self.inputs.len());
        self.path.run(&u, &mut |_, count, block, stride| shifted.take(count, block, stride, sink))
    }

    /// The sum of its rows of outputs, each followed by its derivatives, over the periods.
    fn folded(&self, u: &[f64], inputs: usize, fold: Fold) -> Result<Vec<f64>> {
        let Fold { first, period, periods, last } = fold;
        let (columns, end) = (self.outputs.len() * (1 + self.free.len()), first + periods * period);
        let mut sum = vec![0.0; period * columns];
        self.run(u, inputs, &mut |from, count, block, stride| {
            // stretches of the block that lie in one period
            let (mut at, stop) = (from.max(first), (from + count).min(end));
            while at < stop {
                let place = (at - first) % period;
                let own = (stop - at).min(period - place);
                let weight = if at + period >= end { last } else { 1.0 };
                let rows = block[(at - from) * stride..].chunks_exact(stride).take(own);
                for (row, sum) in rows.zip(sum[place * columns..].chunks_exact_mut(columns)) {
                    sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
                }
                at += own;
            }
        })?;
        Ok(sum)
    }
}

/// Rows of some outputs, each followed by its derivatives by some parameters, where they belong among all.
fn place(
    rows: &[f64],
    outputs: &[usize],
    free: &[usize],
    (y, jacobian): (&mut [f64], &mut [f64]),
    [ny, np]: [usize; 2],
) {
    let width = 1 + free.len();
    for (k, row) in rows.chunks_exact((outputs.len() * width).max(1)).enumerate() {
        for (o, own) in outputs.iter().zip(row.chunks_exact(width)) {
            y[k * ny + o] = own[0];
            let slopes = &mut jacobian[(k * ny + o) * np..][..np];
            free.iter().zip(&own[1..]).for_each(|(free, slope)| slopes[*free] = *slope);
        }
    }
}

/// Some of the columns of a table that has `all`.
fn columns<'a>(table: &'a [f64], all: usize, some: &[usize]) -> Cow<'a, [f64]> {
    if some.len() == all {
        return Cow::Borrowed(table);
    }
    let rows = table.chunks_exact(all);
    Cow::Owned(rows.flat_map(|row| some.iter().map(|i| row[*i])).collect())
}

/// The two ways to a response.
enum Path {
    Linear(Response),
    Nonlinear(Box<Nonlinear>),
}

impl Path {
    fn run(&self, u: &[f64], sink: &mut impl FnMut(usize, usize, &[f64], usize)) -> Result<()> {
        match self {
            Self::Linear(response) => response.run(u, sink),
            Self::Nonlinear(nonlinear) => nonlinear.run(u, sink),
        }
    }
}
