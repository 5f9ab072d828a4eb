//! The digital controller of a loop under way, with its derivatives, and the commands that are delayed.

use nalgebra::DMatrix;

use crate::model::{Controller, GainError};
use crate::nonlinear::rows::{Weights, accumulate};

/// States and commands come in rows: the value, then its derivative by each free parameter.
#[derive(Debug, Clone)]
pub struct Control {
    /// Controller samples per sample of the record.
    pub steps: usize,
    channels: usize,
    signals: usize,
    rows: usize,
    /// What is read of the outputs, and of the inputs that are no commands: signal, output or input, how much.
    reads: Vec<(usize, usize, f64)>,
    takes: Vec<(usize, usize, f64)>,
    /// `[state | read]` to `[command | next state]`.
    weights: Weights,
    /// What acts of the excitations.
    excitation: DMatrix<f64>,
    /// Rows of the derivatives by gain errors, and these.
    errors: Vec<(usize, GainError)>,
    state: Vec<f64>,
    next: Vec<f64>,
    /// Commands, newest first.
    commands: Vec<f64>,
}

impl Control {
    /// A controller as [`Controller::at`] gives it, and its derivatives by the parameters in `free`.
    pub fn new(controller: &Controller, free: &[usize]) -> Self {
        let Controller { a, b, c, d, .. } = controller;
        let rows = 1 + free.len();
        let (n, m, q) = (a.nrows(), controller.channels(), controller.signals());
        let mut whole = DMatrix::zeros(m + n, n + q);
        for (at, part) in [((0, 0), &-c), ((0, n), &-d), ((m, 0), a), ((m, n), b)] {
            whole.view_mut(at, part.shape()).copy_from(part);
        }
        let weights = Weights::new(n + q, &[whole]);
        let kept = controller.split_delay().0 + 2;
        let errors = free.iter().enumerate().filter_map(|(j, p)| Some((1 + j, controller.slope(*p)?))).collect();
        Self {
            steps: controller.steps,
            channels: m,
            signals: q,
            rows,
            reads: entries(&controller.reads, 0),
            takes: entries(&controller.takes, m),
            state: vec![0.0; rows * (n + q)],
            next: vec![0.0; rows * weights.columns],
            commands: vec![0.0; kept * rows * m],
            weights,
            excitation: controller.excitation.clone(),
            errors,
        }
    }

    pub fn reset(&mut self) {
        self.state.fill(0.0);
        self.commands.fill(0.0);
    }

    /// From this state on, which the commands before follow, newest first; derivatives stay as they are.
    pub fn place(&mut self, state: &[f64]) {
        let width = self.state.len() / self.rows;
        let (own, commands) = state.split_at(width - self.signals);
        self.state[..own.len()].copy_from_slice(own);
        let size = self.rows * self.channels;
        for (kept, command) in self.commands.chunks_exact_mut(size).zip(commands.chunks(self.channels)) {
            kept[..command.len()].copy_from_slice(command);
        }
    }

    /// The command of `age` controller samples ago, in rows.
    pub fn command(&self, age: usize) -> &[f64] {
        let size = self.rows * self.channels;
        &self.commands[age * size..][..size]
    }

    /// Computes the next command, and goes on to the next state. Rows of y stand `stride` apart.
    pub fn update(&mut self, inputs: [&[f64]; 2], y: &[f64], stride: usize) {
        self.compute(inputs, y, stride);
        let Self { channels: m, signals, rows, weights, state, next, commands, .. } = self;
        let (m, columns, width) = (*m, weights.columns, state.len() / *rows);
        let n = width - *signals;
        let older = commands.len() - *rows * m;
        commands.copy_within(..older, *rows * m);
        for (row, next) in next.chunks_exact(columns).enumerate() {
            commands[row * m..][..m].copy_from_slice(&next[..m]);
            state[row * width..][..n].copy_from_slice(&next[m..m + n]);
        }
    }

    /// What the command of this age would be after an update, of which this is the first half; its value alone.
    pub fn coming(&self, age: usize) -> &[f64] {
        if age == 0 { &self.next[..self.channels] } else { &self.command(age - 1)[..self.channels] }
    }

    /// Computes the next command, `-C x - D read + e i_e`, and the next state.
    pub fn compute(&mut self, [excitation, further]: [&[f64]; 2], y: &[f64], stride: usize) {
        let Self { channels: m, signals, rows, reads, takes, weights, state, next, errors, .. } = self;
        let (m, columns, width) = (*m, weights.columns, state.len() / *rows);
        let n = width - *signals;
        for (state, y) in state.chunks_exact_mut(width).zip(y.chunks(stride)) {
            state[n..].fill(0.0);
            reads.iter().for_each(|(i, j, share)| state[n + i] += share * y[*j]);
        }
        takes.iter().for_each(|(i, j, share)| state[n + i] += share * further[*j]);
        next.fill(0.0);
        let fed = |weights: &DMatrix<f64>, i: usize, by: &[f64]| {
            weights.row(i).iter().zip(by).map(|(w, b)| w * b).sum::<f64>()
        };
        next[..m].iter_mut().enumerate().for_each(|(i, next)| *next = fed(&self.excitation, i, excitation));
        for (row, error) in errors {
            let (x, read) = state[..width].split_at(n);
            for (i, next) in next[*row * columns..][..m].iter_mut().enumerate() {
                *next = fed(&error.excitation, i, excitation) - fed(&error.c, i, x) - fed(&error.d, i, read);
            }
        }
        accumulate(*rows, (state, width), weights, (next, columns), columns);
    }
}

/// The entries of a matrix that are not zero, from column `first` on, which counts as 0.
fn entries(m: &DMatrix<f64>, first: usize) -> Vec<(usize, usize, f64)> {
    let all = (first..m.ncols()).flat_map(|j| (0..m.nrows()).map(move |i| (i, j)));
    all.filter(|at| m[*at] != 0.0).map(|(i, j)| (i, j - first, m[(i, j)])).collect()
}
