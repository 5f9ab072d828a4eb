//! The digital controller of a loop under way, with its derivatives, and the commands that are delayed.

use crate::model::Controller;

/// States and commands come in rows: the value, then its derivative by each free parameter.
#[derive(Debug, Clone)]
pub struct Control {
    controller: Controller,
    rows: usize,
    state: Vec<f64>,
    next: Vec<f64>,
    /// What is read: displacements, with noise.
    read: Vec<f64>,
    /// Commands, newest first.
    commands: Vec<f64>,
}

impl Control {
    pub fn new(controller: &Controller, rows: usize) -> Self {
        let (n, m) = (controller.a.nrows(), controller.channels());
        let kept = controller.delay.ceil() as usize + 1;
        Self {
            controller: controller.clone(),
            rows,
            state: vec![0.0; rows * n],
            next: vec![0.0; n],
            read: vec![0.0; m],
            commands: vec![0.0; kept * rows * m],
        }
    }

    /// Controller samples per sample of the record.
    pub fn steps(&self) -> usize {
        self.controller.steps
    }

    pub fn reset(&mut self) {
        self.state.fill(0.0);
        self.commands.fill(0.0);
    }

    /// The noise of the displacements among the inputs; empty where there is none.
    pub fn noise<'a>(&self, u: &'a [f64]) -> &'a [f64] {
        if self.controller.noise { &u[self.controller.channels()..] } else { &[] }
    }

    /// The command of `age` controller samples ago.
    pub fn command(&self, age: usize, row: usize) -> &[f64] {
        let m = self.controller.channels();
        &self.commands[(age * self.rows + row) * m..][..m]
    }

    /// Computes the next command, `-C x - D (y + noise) + i_e`, and the next state. Rows of y stand `stride` apart.
    pub fn update(&mut self, u: &[f64], y: &[f64], stride: usize) {
        let (n, m) = (self.controller.a.nrows(), self.controller.channels());
        let kept = self.commands.len() - self.rows * m;
        self.commands.copy_within(..kept, self.rows * m);
        for row in 0..self.rows {
            self.read.copy_from_slice(&y[row * stride..][..m]);
            let command = &mut self.commands[row * m..(row + 1) * m];
            command.fill(0.0);
            if row == 0 {
                let noise = if self.controller.noise { &u[m..] } else { &[] };
                self.read.iter_mut().zip(noise).for_each(|(read, noise)| *read += noise);
                command.copy_from_slice(&u[..m]);
            }
            let Controller { a, b, c, d, .. } = &self.controller;
            let state = &mut self.state[row * n..(row + 1) * n];
            for (i, command) in command.iter_mut().enumerate() {
                (0..n).for_each(|j| *command -= c[(i, j)] * state[j]);
                (0..m).for_each(|j| *command -= d[(i, j)] * self.read[j]);
            }
            for (i, next) in self.next.iter_mut().enumerate() {
                *next = 0.0;
                (0..n).for_each(|j| *next += a[(i, j)] * state[j]);
                (0..m).for_each(|j| *next += b[(i, j)] * self.read[j]);
            }
            state.copy_from_slice(&self.next);
        }
    }
}
