//! The loop one sample at a time: no allocation after construction, the same work in every step.

use crate::closed_loop::ClosedLoop;
use crate::discretise::Discrete;
use crate::error::{Result, check_len};

/// Steps a closed loop: give the excitation that is held from now on, get the outputs of now.
#[derive(Debug, Clone)]
pub struct Stepper {
    inputs: usize,
    outputs: usize,
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
        Ok(Self::from_discrete(&system.discrete(theta)?))
    }

    /// From the matrices of the sampled loop.
    pub fn from_discrete(discrete: &Discrete) -> Self {
        let (n, m, p) = (discrete.a.nrows(), discrete.b.ncols(), discrete.c.nrows());
        let columns = discrete.stacked().as_slice().to_vec();
        Self { inputs: m, outputs: p, columns, state: vec![0.0; n], next: vec![0.0; n + p] }
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
    /// [`crate::Error::Shape`] where a slice has the wrong length; the state is then unchanged.
    pub fn step(&mut self, u: &[f64], y: &mut [f64]) -> Result<()> {
        check_len("excitation", u.len(), self.inputs)?;
        check_len("outputs", y.len(), self.outputs)?;
        let n = self.state.len();
        self.next.fill(0.0);
        for (column, x) in self.columns.chunks_exact(n + self.outputs).zip(self.state.iter().chain(u)) {
            for (sum, c) in self.next.iter_mut().zip(column) {
                *sum += c * x;
            }
        }
        self.state.copy_from_slice(&self.next[..n]);
        y.copy_from_slice(&self.next[n..]);
        Ok(())
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        self.state.fill(0.0);
    }
}
