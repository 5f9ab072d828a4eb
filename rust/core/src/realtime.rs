//! The loop one sample at a time: no allocation after construction, the same work in every step.

use crate::closed_loop::ClosedLoop;
use crate::error::{Error, Result, check_finite, check_len};
use crate::nonlinear::{Nonlinear, Run};
use crate::stop::go_on;

/// Substeps of a nonlinear loop whose model does not say otherwise.
const SUBSTEPS: usize = 4;
/// Samples between two questions whether to go on: some milliseconds.
const UNASKED: usize = 1024;

/// Steps a closed loop: give the excitation that is held from now on, get the outputs of now.
#[derive(Debug, Clone)]
pub struct Stepper {
    inputs: usize,
    outputs: usize,
    path: Path,
    past: Past,
}

/// The last rows of outputs, of which some are recorded late by whole samples.
#[derive(Debug, Clone)]
struct Past {
    shifts: Vec<usize>,
    /// A ring of rows, the next one to be written over at `at`.
    rows: Vec<f64>,
    at: usize,
}

impl Past {
    fn new(shifts: &[isize]) -> Result<Self> {
        let what = "an output that is read early by a sample and more cannot be stepped";
        let own = shifts.iter().map(|m| usize::try_from(*m).map_err(|_| Error::Singular { what }));
        let shifts = own.collect::<Result<Vec<_>>>()?;
        let rows = shifts.iter().max().copied().unwrap_or(0) * shifts.len();
        Ok(Self { rows: vec![0.0; rows], shifts, at: 0 })
    }

    /// Puts what is recorded now in the place of what is now; `keeps` the latter for later.
    fn record(&mut self, y: &mut [f64], keeps: bool) {
        let (ny, count) = (y.len(), self.rows.len() / y.len().max(1));
        if count == 0 {
            return;
        }
        for (o, (y, shift)) in y.iter_mut().zip(&self.shifts).enumerate() {
            let now = *y;
            if *shift > 0 {
                *y = self.rows[(self.at + count - shift) % count * ny + o];
            }
            if keeps {
                self.rows[self.at * ny + o] = now;
            }
        }
        if keeps {
            self.at = (self.at + 1) % count;
        }
    }
}

#[derive(Debug, Clone)]
enum Path {
    Linear(Sums),
    Nonlinear(Box<Run>),
}

/// A linear loop.
#[derive(Debug, Clone)]
struct Sums {
    /// `[a b; c d]` column by column, so that a step is a sum of columns.
    columns: Vec<f64>,
    state: Vec<f64>,
    next: Vec<f64>,
}

impl Stepper {
    /// A loop at one parameter set, at rest. It may be unstable: then its outputs grow, as the machine's would.
    ///
    /// # Errors
    /// As [`ClosedLoop::discrete`].
    pub fn new(system: &ClosedLoop, theta: &[f64]) -> Result<Self> {
        let (inputs, outputs, model) = (system.inputs(), system.outputs(), system.model());
        let discrete = system.discrete(theta)?;
        let path = if model.lft.blocks.is_empty() {
            let (n, columns) = (discrete.a.nrows(), discrete.stacked().as_slice().to_vec());
            Path::Linear(Sums { columns, state: vec![0.0; n], next: vec![0.0; n + outputs] })
        } else {
            let substeps = model.substeps.unwrap_or(SUBSTEPS);
            Path::Nonlinear(Box::new(Nonlinear::new(model, theta, &[])?.start(substeps)?))
        };
        Ok(Self { inputs, outputs, path, past: Past::new(&system.shifts(theta)?)? })
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// One sample: `y` becomes the outputs at this instant, `u` is held until the next.
    ///
    /// # Errors
    /// [`crate::Error::Shape`] where a slice has the wrong length, [`crate::Error::NotFinite`]; the state is then
    /// unchanged.
    pub fn step(&mut self, u: &[f64], y: &mut [f64]) -> Result<()> {
        check_len("excitation", u.len(), self.inputs)?;
        check_finite("excitation", u)?;
        check_len("outputs", y.len(), self.outputs)?;
        match &mut self.path {
            Path::Linear(sums) => sums.sample(u, y),
            Path::Nonlinear(run) => run.sample(u, y),
        }
        self.past.record(y, true);
        Ok(())
    }

    /// The outputs at this instant, were `u` held from now on; time stands still.
    ///
    /// # Errors
    /// As [`Stepper::step`].
    pub fn outputs_now(&mut self, u: &[f64], y: &mut [f64]) -> Result<()> {
        check_len("excitation", u.len(), self.inputs)?;
        check_finite("excitation", u)?;
        check_len("outputs", y.len(), self.outputs)?;
        match &mut self.path {
            Path::Linear(sums) => sums.outputs(u, y),
            Path::Nonlinear(run) => run.outputs(u, y),
        }
        self.past.record(y, false);
        Ok(())
    }

    /// Steps through `u`, samples x inputs; `y` becomes samples x outputs.
    ///
    /// # Errors
    /// As [`Stepper::step`], and [`crate::Error::Stopped`]; the samples before are done.
    pub fn run(&mut self, u: &[f64], y: &mut [f64]) -> Result<()> {
        let (inputs, outputs) = (self.inputs.max(1), self.outputs.max(1));
        check_len("outputs", y.len(), u.len() / inputs * self.outputs)?;
        for (u, y) in u.chunks(UNASKED * inputs).zip(y.chunks_mut(UNASKED * outputs)) {
            go_on()?;
            u.chunks(inputs).zip(y.chunks_mut(outputs)).try_for_each(|(u, y)| self.step(u, y))?;
        }
        Ok(())
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        match &mut self.path {
            Path::Linear(sums) => sums.state.fill(0.0),
            Path::Nonlinear(run) => run.reset(),
        }
        self.past.rows.fill(0.0);
    }
}

impl Sums {
    fn sample(&mut self, u: &[f64], y: &mut [f64]) {
        let (n, rows) = (self.state.len(), self.next.len());
        self.next.fill(0.0);
        for (column, x) in self.columns.chunks_exact(rows).zip(self.state.iter().chain(u)) {
            for (sum, c) in self.next.iter_mut().zip(column) {
                *sum += c * x;
            }
        }
        self.state.copy_from_slice(&self.next[..n]);
        y.copy_from_slice(&self.next[n..]);
    }

    fn outputs(&self, u: &[f64], y: &mut [f64]) {
        let (n, rows) = (self.state.len(), self.next.len());
        y.fill(0.0);
        for (column, x) in self.columns.chunks_exact(rows).zip(self.state.iter().chain(u)) {
            for (sum, c) in y.iter_mut().zip(&column[n..]) {
                *sum += c * x;
            }
        }
    }
}
