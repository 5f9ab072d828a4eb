//! The digital controller of a loop under way, with its derivatives, and the commands that are delayed.

use nalgebra::DMatrix;

use crate::model::Controller;
use crate::nonlinear::rows::{Weights, accumulate};

/// States and commands come in rows: the value, then its derivative by each free parameter.
#[derive(Debug, Clone)]
pub struct Control {
    /// Controller samples per sample of the record.
    pub steps: usize,
    channels: usize,
    rows: usize,
    /// `[state | read]` to `[command | next state]`.
    weights: Weights,
    state: Vec<f64>,
    next: Vec<f64>,
    /// Commands, newest first.
    commands: Vec<f64>,
}

impl Control {
    pub fn new(controller: &Controller, rows: usize) -> Self {
        let Controller { a, b, c, d, .. } = controller;
        let (n, m) = (a.nrows(), controller.channels());
        let mut whole = DMatrix::zeros(m + n, n + m);
        for (at, part) in [((0, 0), &-c), ((0, n), &-d), ((m, 0), a), ((m, n), b)] {
            whole.view_mut(at, part.shape()).copy_from(part);
        }
        let weights = Weights::new(n + m, &[whole]);
        let kept = controller.split_delay().0 + 2;
        Self {
            steps: controller.steps,
            channels: m,
            rows,
            state: vec![0.0; rows * (n + m)],
            next: vec![0.0; rows * weights.columns],
            commands: vec![0.0; kept * rows * m],
            weights,
        }
    }

    pub fn reset(&mut self) {
        self.state.fill(0.0);
        self.commands.fill(0.0);
    }

    /// The command of `age` controller samples ago, in rows.
    pub fn command(&self, age: usize) -> &[f64] {
        let size = self.rows * self.channels;
        &self.commands[age * size..][..size]
    }

    /// Computes the next command, `-C x - D (y + noise) + i_e`, and the next state. Rows of y stand `stride` apart.
    pub fn update(&mut self, excitation: &[f64], noise: &[f64], y: &[f64], stride: usize) {
        let Self { channels: m, rows, weights, state, next, commands, .. } = self;
        let (m, columns, width) = (*m, weights.columns, state.len() / *rows);
        let n = width - m;
        for (state, y) in state.chunks_exact_mut(width).zip(y.chunks(stride)) {
            state[n..].copy_from_slice(&y[..m]);
        }
        state[n..].iter_mut().zip(noise).for_each(|(read, noise)| *read += noise);
        next.fill(0.0);
        next[..m].copy_from_slice(excitation);
        accumulate(*rows, (state, width), weights, (next, columns), columns);
        let older = commands.len() - *rows * m;
        commands.copy_within(..older, *rows * m);
        for (row, next) in next.chunks_exact(columns).enumerate() {
            commands[row * m..][..m].copy_from_slice(&next[..m]);
            state[row * width..][..n].copy_from_slice(&next[m..m + n]);
        }
    }
}
