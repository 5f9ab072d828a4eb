//! Residuals of a loop against records, reduced to normal equations whose size does not depend on the records'.

mod repeats;

use nalgebra::{DMatrix, DVector};

use crate::closed_loop::ClosedLoop;
use crate::error::{Error, Result, check_finite, check_len};
use crate::kernel::BLOCK;
use crate::product::{LANES, add_gram};
use crate::stop::each;

pub use repeats::of_repeats;

/// A measured record.
#[derive(Debug, Clone)]
pub struct Data {
    /// Samples x inputs.
    pub u: Vec<f64>,
    /// Samples x outputs, each channel's mean from `first` on removed.
    z: Vec<f64>,
    /// Weight of each output; zero leaves the channel out.
    weights: Vec<f64>,
    /// First sample that counts. The simulation starts at 0 all the same.
    first: usize,
    /// Sum of squares of each output from `first` on.
    squares: Vec<f64>,
}

/// `sum of weight^2 (z - y)^2` with each channel's mean removed from both, as a quadratic form about `theta`.
#[derive(Debug, Clone)]
pub struct Normal {
    /// J'J of the residual y - z, free x free.
    pub hessian: DMatrix<f64>,
    /// J'r.
    pub gradient: DVector<f64>,
    /// Sum of squares of each output, weighted.
    pub squares: Vec<f64>,
}

impl Data {
    /// `u` is samples x inputs, `z` samples x outputs, both row by row; `weights` has one entry per output.
    ///
    /// # Errors
    /// [`crate::Error::Shape`], [`crate::Error::NotFinite`].
    pub fn new(system: &ClosedLoop, u: Vec<f64>, mut z: Vec<f64>, weights: Vec<f64>, first: usize) -> Result<Self> {
        let ny = system.outputs();
        check_len("weights", weights.len(), ny)?;
        check_finite("weights", &weights)?;
        check_finite("excitation", &u)?;
        check_finite("measurement", &z)?;
        let samples = z.len().checked_div(ny).unwrap_or(0);
        check_len("excitation", u.len(), samples * system.inputs())?;
        check_len("measurement", z.len(), samples * ny)?;
        if first >= samples {
            let (found, expected) = (first.to_string(), format!("less than the {samples} samples"));
            return Err(Error::Shape { what: "first sample that counts", found, expected });
        }
        let mut means = vec![0.0; ny];
        for row in z[first * ny..].chunks_exact(ny) {
            means.iter_mut().zip(row).for_each(|(sum, z)| *sum += z);
        }
        means.iter_mut().for_each(|sum| *sum /= (samples - first) as f64);
        let mut squares = vec![0.0; ny];
        for (k, row) in z.chunks_exact_mut(ny).enumerate() {
            row.iter_mut().zip(&means).for_each(|(z, mean)| *z -= mean);
            if k >= first {
                squares.iter_mut().zip(&*row).for_each(|(sum, z)| *sum += z * z);
            }
        }
        Ok(Self { u, z, weights, first, squares })
    }

    fn check(&self, system: &ClosedLoop) -> Result<()> {
        let ny = system.outputs();
        check_len("weights of a record", self.weights.len(), ny)?;
        check_len("excitation of a record", self.u.len(), self.z.len() / ny * system.inputs())
    }

    /// Adds the outputs that no input reaches, which stay zero.
    fn add_unseen(&self, seen: &[bool], sum: &mut Normal) {
        for (o, _) in seen.iter().enumerate().filter(|(_, seen)| !**seen) {
            sum.squares[o] += self.squares[o] * self.weights[o].powi(2);
        }
    }
}

impl Normal {
    fn zeros(free: usize, outputs: usize) -> Self {
        Self { hessian: DMatrix::zeros(free, free), gradient: DVector::zeros(free), squares: vec![0.0; outputs] }
    }
}

/// The normal equations of all records together, by the parameters in `free`.
///
/// # Errors
/// [`crate::Error::Unstable`], [`crate::Error::Shape`] where a record belongs to another loop, and as
/// [`ClosedLoop::poles`].
pub fn normal_equations(system: &ClosedLoop, theta: &[f64], free: &[usize], records: &[&Data]) -> Result<Normal> {
    let np = free.len();
    records.iter().try_for_each(|data| data.check(system))?;
    let prepared = system.prepare_some(theta, free, |o| records.iter().any(|data| data.weights[o] != 0.0))?;
    let (inputs, ny) = (system.inputs(), system.outputs());
    let one = |_, data: &&Data| -> Result<Normal> {
        let mut sum = Normal::zeros(np, ny);
        let mut seen = vec![false; ny];
        for part in &prepared {
            let mut moments: Vec<Moments> = part.outputs.iter().map(|_| Moments::new(part.free.len())).collect();
            part.run(&data.u, inputs, &mut |from, count, block, stride| {
                let skip = data.first.saturating_sub(from).min(count);
                let judged =
                    part.outputs.iter().zip(&mut moments).enumerate().filter(|(_, (o, _))| data.weights[**o] != 0.0);
                for (i, (o, moments)) in judged {
                    let rows = block.chunks_exact(stride).take(count).skip(skip);
                    let measured = data.z[(from + skip) * ny..].chunks_exact(ny).map(|z| z[*o]);
                    moments.lay(i * moments.width, rows);
                    moments.subtract(measured.take(count - skip));
                    moments.add(count - skip);
                }
            })?;
            for (o, moments) in part.outputs.iter().zip(moments) {
                seen[*o] = true;
                if data.weights[*o] == 0.0 {
                    continue;
                }
                moments.add_to(&mut sum, *o, data.weights[*o], &part.free);
            }
        }
        data.add_unseen(&seen, &mut sum);
        Ok(sum)
    };
    let mut sums = each(records, one)?.into_iter();
    let mut total = sums.next().unwrap_or_else(|| Normal::zeros(np, ny));
    for sum in sums {
        total.hessian += sum.hessian;
        total.gradient += sum.gradient;
        total.squares.iter_mut().zip(sum.squares).for_each(|(t, s)| *t += s);
    }
    Ok(total)
}

/// Second moments of one channel's row `[residual, slopes.., 1]`.
struct Moments {
    width: usize,
    /// A block of rows, each filled up to `stride`.
    rows: Vec<f64>,
    stride: usize,
    /// stride x stride, upper part, row by row.
    sum: Vec<f64>,
}

impl Moments {
    fn new(slopes: usize) -> Self {
        let width = 1 + slopes;
        let stride = (width + 1).next_multiple_of(LANES);
        let mut rows = vec![0.0; BLOCK * stride];
        rows.iter_mut().skip(width).step_by(stride).for_each(|one| *one = 1.0);
        Self { width, rows, stride, sum: vec![0.0; stride * stride] }
    }

    /// Takes over rows that hold `[output, slopes..]` from cell `at` on.
    fn lay<'a>(&mut self, at: usize, rows: impl Iterator<Item = &'a [f64]> + Clone) {
        for i in 0..self.width {
            for (own, row) in self.rows.chunks_exact_mut(self.stride).zip(rows.clone()) {
                own[i] = row[at + i];
            }
        }
    }

    fn subtract(&mut self, measured: impl Iterator<Item = f64>) {
        for (own, measured) in self.rows.chunks_exact_mut(self.stride).zip(measured) {
            own[0] -= measured;
        }
    }

    /// Adds the first rows to the sums.
    fn add(&mut self, count: usize) {
        add_gram(&self.rows[..count * self.stride], self.stride, &mut self.sum);
    }

    fn add_to(&self, total: &mut Normal, output: usize, weight: f64, free: &[usize]) {
        let moment = |i: usize, j: usize| self.sum[i.min(j) * self.stride + i.max(j)];
        let one = self.width;
        let central = |i, j| weight * weight * (moment(i, j) - moment(i, one) * moment(j, one) / moment(one, one));
        total.squares[output] += central(0, 0).max(0.0);
        for (i, a) in free.iter().enumerate() {
            total.gradient[*a] += central(0, 1 + i);
            for (j, b) in free.iter().enumerate() {
                total.hessian[(*a, *b)] += central(1 + i, 1 + j);
            }
        }
    }
}
