//! Response of a linear loop and its sensitivities: modal where the poles allow it, dense where they do not.

use nalgebra::Complex;

use crate::discretise::{Discrete, discretise};
use crate::eigen::eigenvalues;
use crate::error::{Error, Result};
use crate::kernel::{BLOCK, Kernel};
use crate::modal::{Modal, Residues};
use crate::model::Model;
use crate::product::{Panels, ROW_MULTIPLE, product};
use crate::stop::go_on;

/// A loop at one parameter set, ready to run over samples.
///
/// Output columns are `[y_0, dy_0/dtheta_0, .., y_1, dy_1/dtheta_0, ..]`.
pub enum Response {
    Modal(Kernel),
    Dense(Dense),
}

impl Response {
    /// Prepares the response, and its derivatives by the parameters in `free`.
    ///
    /// # Errors
    /// [`Error::Unstable`] where a pole does not decay; else as [`Modal::new`].
    pub fn new(model: &Model, theta: &[f64], free: &[usize]) -> Result<Self> {
        if let Some(modal) = Modal::new(model, theta, free, false)? {
            stable(&modal.value.mu, model.dt)?;
            return Ok(Self::Modal(kernel(&modal)));
        }
        let (value, slopes) = discretise(model, theta, free)?;
        stable(&eigenvalues(&value.a)?, model.dt)?;
        Ok(Self::Dense(Dense::new(&value, &slopes)))
    }

    /// Runs from rest over `u` (samples x inputs); see [`Kernel::run`] for the sink.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub fn run(&self, u: &[f64], sink: &mut impl FnMut(usize, usize, &[f64], usize)) -> Result<()> {
        match self {
            Self::Modal(kernel) => kernel.run(u, sink),
            Self::Dense(dense) => dense.run(u, sink),
        }
    }
}

/// Refuses a sampled loop with a pole that does not decay; one that is no number counts as the worst.
pub(crate) fn stable(mu: &[Complex<f64>], dt: f64) -> Result<()> {
    let size = |mu: &Complex<f64>| if mu.norm().is_nan() { f64::INFINITY } else { mu.norm() };
    match mu.iter().max_by(|a, b| size(a).total_cmp(&size(b))) {
        Some(worst) if size(worst) >= 1.0 => Err(Error::unstable(worst.ln() / dt, dt)),
        _ => Ok(()),
    }
}

/// A complex pair of poles (its upper one), or two real poles (the second may be missing).
enum Cell {
    Pair(usize),
    Reals(usize, Option<usize>),
}

impl Cell {
    /// The cells of a set of poles that is closed under conjugation.
    fn all(mu: &[Complex<f64>]) -> Vec<Self> {
        let upper = (0..mu.len()).filter(|i| mu[*i].im > 0.0).map(Self::Pair);
        let real: Vec<usize> = (0..mu.len()).filter(|i| mu[*i].im == 0.0).collect();
        upper.chain(real.chunks(2).map(|r| Self::Reals(r[0], r.get(1).copied()))).collect()
    }

    /// Multiplication by the number of each mode, as a 2 x 2 section.
    fn section(&self, of: impl Fn(usize) -> Complex<f64>) -> [f64; 4] {
        match *self {
            Self::Pair(i) => [of(i).re, -of(i).im, of(i).im, of(i).re],
            Self::Reals(i, j) => [of(i).re, 0.0, 0.0, j.map_or(0.0, |j| of(j).re)],
        }
    }

    /// Weights of the two states that add up to the contribution of these modes to a real output.
    fn weights(&self, of: impl Fn(usize) -> Complex<f64>) -> [f64; 2] {
        match *self {
            Self::Pair(i) => [2.0 * of(i).re, -2.0 * of(i).im],
            Self::Reals(i, j) => [of(i).re, j.map_or(0.0, |j| of(j).re)],
        }
    }
}

fn kernel(modal: &Modal) -> Kernel {
    let Residues { mu, b, c, d } = &modal.value;
    let cells = Cell::all(mu);
    let (nu, ny, np) = (b.ncols(), c.nrows(), modal.slopes.len());
    let lanes = cells.len();
    let mut kernel = Kernel { inputs: nu, columns: ny * (1 + np), ..Kernel::default() };
    kernel.feedthrough = d.iter().chain(modal.slopes.iter().flat_map(|s| s.d.iter())).any(|x| *x != 0.0);
    // the value alone: one bank, driven through b. With derivatives: one lane per cell and input, driven by the
    // input itself, and a second bank for the derivative of the poles.
    let split = np > 0;
    let copies = if split { nu } else { 1 };
    for _ in 0..copies {
        cells.iter().for_each(|cell| kernel.p.push(cell.section(|i| mu[i])));
    }
    kernel.p.pad();
    kernel.lanes = lanes;
    for a in 0..nu {
        for copy in 0..copies {
            for cell in &cells {
                let [re, _, im, second] = cell.section(|i| if split { Complex::from(1.0) } else { b[(i, a)] });
                let forced = if !split || copy == a { 1.0 } else { 0.0 };
                let im = if matches!(cell, Cell::Reals(..)) { second } else { im };
                kernel.force.push([forced * re, forced * im, 0.0, 0.0]);
            }
        }
        kernel.force.pad();
        if split {
            cells.iter().for_each(|cell| kernel.drive.push(cell.section(|i| b[(i, a)])));
            kernel.drive.pad();
        }
    }
    if split {
        cells.iter().for_each(|cell| kernel.q.push(cell.section(|i| mu[i])));
    }
    let (lp, lq) = (kernel.p.padded(), kernel.q.padded());

    let columns = kernel.columns;
    let mut weights = vec![0.0; kernel.basis() * columns];
    let mut put = |row: usize, column: usize, value: f64| weights[row * columns + column] = value;
    for o in 0..ny {
        let column = o * (1 + np);
        for (l, cell) in cells.iter().enumerate() {
            if !split {
                let [re, im] = cell.weights(|i| c[(o, i)]);
                put(l, column, re);
                put(lp + l, column, im);
                continue;
            }
            for a in 0..nu {
                let lane = a * lanes + l;
                let [re, im] = cell.weights(|i| c[(o, i)] * b[(i, a)]);
                put(lane, column, re);
                put(lp + lane, column, im);
                for (j, s) in modal.slopes.iter().enumerate() {
                    let [re, im] = cell.weights(|i| s.c[(o, i)] * b[(i, a)] + c[(o, i)] * s.b[(i, a)]);
                    put(lane, column + 1 + j, re);
                    put(lp + lane, column + 1 + j, im);
                }
            }
            for (j, s) in modal.slopes.iter().enumerate() {
                let [re, im] = cell.weights(|i| c[(o, i)] * s.mu[i]);
                put(2 * lp + l, column + 1 + j, re);
                put(2 * lp + lq + l, column + 1 + j, im);
            }
        }
        if kernel.feedthrough {
            let from = 2 * (lp + lq);
            for a in 0..nu {
                put(from + a, column, d[(o, a)]);
                for (j, s) in modal.slopes.iter().enumerate() {
                    put(from + a, column + 1 + j, s.d[(o, a)]);
                }
            }
        }
    }
    kernel.weights = weights;
    kernel
}

/// The plain recursion, right for every loop: `S+ = A S + dA x + dB u` beside `x+ = A x + B u`.
///
/// A sample is a row, and matrices stand to its right: `[x | u]` gives `[x+ | y]`.
pub struct Dense {
    states: usize,
    inputs: usize,
    outputs: usize,
    parameters: usize,
    step: Panels,
    /// Derivatives of `step`, those of all parameters side by side.
    forcing: Panels,
    /// The part of `step` that x meets, here met by the rows of S.
    carry: Panels,
}

impl Dense {
    fn new(value: &Discrete, slopes: &[Discrete]) -> Self {
        let (n, nu, ny, np) = (value.a.nrows(), value.b.ncols(), value.c.nrows(), slopes.len());
        // a matrix stored column by column is its transpose row by row
        let step = value.stacked();
        let slopes: Vec<_> = slopes.iter().map(Discrete::stacked).collect();
        let mut forcing = Vec::with_capacity((n + nu) * np * (n + ny));
        for column in 0..n + nu {
            slopes.iter().for_each(|slope| forcing.extend(slope.column(column).iter()));
        }
        Self {
            states: n,
            inputs: nu,
            outputs: ny,
            parameters: np,
            step: Panels::new(n + nu, n + ny, step.as_slice()),
            forcing: Panels::new(n + nu, np * (n + ny), &forcing),
            carry: Panels::new(n, n + ny, step.as_slice()),
        }
    }

    fn run(&self, u: &[f64], sink: &mut impl FnMut(usize, usize, &[f64], usize)) -> Result<()> {
        let (n, inputs, ny, np) = (self.states, self.inputs, self.outputs, self.parameters);
        let (depth, width) = (n + inputs, 1 + np);
        let columns = ny * width;
        let mut rows = vec![0.0; (BLOCK + ROW_MULTIPLE) * depth];
        let mut next = vec![0.0; ROW_MULTIPLE * self.step.stride];
        let mut forced = vec![0.0; BLOCK * self.forcing.stride];
        // a row of S and what comes of it, per parameter
        let padded = np.next_multiple_of(ROW_MULTIPLE);
        let mut s = vec![0.0; padded * n];
        let mut carried = vec![0.0; padded * self.carry.stride];
        let mut block = vec![0.0; BLOCK * columns];
        for (i, u) in u.chunks(BLOCK * inputs).enumerate() {
            go_on()?;
            let count = u.len() / inputs;
            for (k, u) in u.chunks_exact(inputs).enumerate() {
                let row = &mut rows[k * depth..];
                row[n..depth].copy_from_slice(u);
                product(row, 1, &self.step, &mut next);
                row[depth..depth + n].copy_from_slice(&next[..n]);
                let outputs = block[k * columns..].iter_mut().step_by(width);
                outputs.zip(&next[n..n + ny]).for_each(|(y, next)| *y = *next);
            }
            product(&rows, count, &self.forcing, &mut forced);
            for k in 0..count {
                product(&s, np, &self.carry, &mut carried);
                for j in 0..np {
                    let forced = &forced[k * self.forcing.stride + j * (n + ny)..];
                    let sum = carried[j * self.carry.stride..].iter().zip(forced).map(|(c, f)| c + f);
                    let outputs = block[k * columns + 1 + j..].iter_mut().step_by(width).take(ny);
                    s[j * n..(j + 1) * n].iter_mut().chain(outputs).zip(sum).for_each(|(to, sum)| *to = sum);
                }
            }
            sink(i * BLOCK, count, &block, columns);
            rows.copy_within(count * depth..count * depth + n, 0);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
