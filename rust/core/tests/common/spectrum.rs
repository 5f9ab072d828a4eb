//! Lines of cut records, and least squares on them, in the plainest words.

use ambid_core::{Controller, LineResponse, Model};
use nalgebra::{Complex, DMatrix, DVector};

use super::loops::{Problem, lags, oscillators};
use super::machine::{digital, machine};
use super::random::Random;

pub type C64 = Complex<f64>;

/// Loops of every kind, with their names.
pub fn every_kind(random: &mut Random) -> Vec<(String, Problem)> {
    let mut all: Vec<(String, Problem)> = Vec::new();
    for i in 0..12 {
        all.push((format!("analog {i}"), random.analog_loop()));
    }
    for delay in [0.0, 0.3, 1.0, 2.5] {
        for steps in [1, 2] {
            for i in 0..4 {
                all.push((format!("digital {i}, delay {delay}, {steps} steps"), random.digital_loop(delay, steps)));
            }
        }
    }
    all.extend((0..3).map(|i| (format!("late excitation {i}"), late_excitation(random))));
    for (gyroscopic, spread) in [(0.0, 0.02), (100.0, 0.02), (1e-9, 0.0)] {
        all.push((format!("machine, {gyroscopic} rad/s, spread {spread}"), machine(gyroscopic, spread)));
    }
    for (gyroscopic, delay) in [(0.0, 0.3), (100.0, 0.1)] {
        all.push((format!("digital machine, {gyroscopic} rad/s, delay {delay}"), digital(gyroscopic, delay)));
    }
    all.extend(clusters(0.0).into_iter().map(|(name, p)| (name.to_owned(), p)));
    all.extend(clusters(1e-4).into_iter().map(|(name, p)| (format!("{name}, apart"), p)));
    for (gain, delay) in [(0.0, 1.0), (1e-3, 2.5), (0.1, 2.5)] {
        let digital = |(name, p): (&str, Problem)| (format!("digital {name}"), p.under_digital(0.1, gain, delay));
        all.extend(clusters(0.0).into_iter().map(digital));
    }
    all
}

/// Poles that fall together or lie `gap` apart, some beside each other and some in series; the last has two parts.
pub fn clusters(gap: f64) -> Vec<(&'static str, Problem)> {
    let (one, other) = (0.7, 0.7 * (1.0 + gap));
    let swing = |push| oscillators([3.0, 3.0 * (1.0 + gap)], 0.1, push);
    vec![
        ("three lags in series", lags(&[one, other, one], &[&[], &[0], &[1]], &[2])),
        ("two lags side by side", lags(&[one, other], &[&[], &[]], &[0, 1])),
        ("a lag that is not seen", lags(&[one, other], &[&[], &[0]], &[0])),
        ("oscillators in series", swing([[0.0, 0.0], [1.0, 0.0]])),
        ("oscillators apart", swing([[0.0; 2]; 2])),
    ]
}

/// A loop that is closed already, its excitation late by a parameter.
fn late_excitation(random: &mut Random) -> Problem {
    let Problem { model, mut theta } = random.digital_loop(0.0, 1);
    let m = model.controller.as_ref().expect("digital").channels();
    let empty = DMatrix::zeros;
    theta.push(random.between(0.0, 3.0) * model.dt);
    let idle = Controller::new(empty(0, 0), empty(0, m), empty(m, 0), empty(m, m));
    let controller = Controller { late: Some(theta.len() - 1), ..idle };
    Problem { model: Model::new(model.lft, model.dt, Some(controller)).expect("consistent"), theta }
}

/// The points of all lines of `length` samples from zero to half the sampling rate.
pub fn points(length: usize) -> Vec<C64> {
    let turn = std::f64::consts::TAU / length as f64;
    (0..=length / 2).map(|l| C64::from_polar(1.0, turn * l as f64)).collect()
}

/// `sum x[k] exp(-2 pi i l k / N) / sqrt(N)` of every column of `x` (N x columns): lines x columns.
pub fn transform(x: &[f64], columns: usize) -> Vec<C64> {
    let length = x.len() / columns;
    let root = (length as f64).sqrt();
    let mut found = Vec::new();
    for w in points(length) {
        for column in 0..columns {
            // Horner's scheme in conj(w) would lose digits on long records; powers are exact turns
            let turn = |k: usize| C64::from_polar(1.0 / root, -w.arg() * k as f64);
            found.push((0..length).map(|k| turn(k) * x[k * columns + column]).sum());
        }
    }
    found
}

/// Real and imaginary parts below each other, row by row of a `rows x columns` array.
pub fn stacked(x: &[C64], rows: usize, columns: usize) -> DMatrix<f64> {
    assert_eq!(x.len(), rows * columns);
    DMatrix::from_fn(2 * rows, columns, |i, j| {
        let x = x[i / 2 * columns + j];
        if i % 2 == 0 { x.re } else { x.im }
    })
}

/// A response in units of the largest line of each output, as columns `[T | dz | z]` of real rows.
pub struct Rows {
    pub basis: DMatrix<f64>,
    pub slopes: DMatrix<f64>,
    pub response: DVector<f64>,
}

impl Rows {
    pub fn new(found: &LineResponse, states: usize, parameters: usize) -> Self {
        let rows = found.response.len();
        Self {
            basis: stacked(&found.basis, rows, states),
            slopes: stacked(&found.slopes, rows, parameters),
            response: stacked(&found.response, rows, 1).column(0).into_owned(),
        }
    }

    /// Multiplies every row by the number of its line and output.
    pub fn scale(&mut self, by: &[f64]) {
        for (i, by) in by.iter().enumerate() {
            for row in [2 * i, 2 * i + 1] {
                self.basis.row_mut(row).scale_mut(*by);
                self.slopes.row_mut(row).scale_mut(*by);
                self.response[row] *= by;
            }
        }
    }
}

/// Orthonormal columns that span those of a matrix: the one that is most its own first, to a remainder of `smallest`.
///
/// What is 1e-10 of the largest column is rounding, and zero.
/// Returns them with the columns they were taken from, and the least part of a column that was its own.
pub fn orthonormal(m: &DMatrix<f64>, smallest: f64) -> (DMatrix<f64>, Vec<usize>, f64) {
    let mut left = m.clone();
    let largest = m.column_iter().map(|column| column.norm()).fold(0.0, f64::max);
    for mut column in left.column_iter_mut() {
        let norm = column.norm();
        column.scale_mut(if norm > 1e-10 * largest { 1.0 / norm } else { 0.0 });
    }
    let mut q = DMatrix::zeros(m.nrows(), 0);
    let (mut taken, mut least) = (Vec::new(), 1.0);
    while let Some(best) = (0..m.ncols())
        .filter(|j| !taken.contains(j))
        .max_by(|a, b| left.column(*a).norm().total_cmp(&left.column(*b).norm()))
        .filter(|j| left.column(*j).norm() > smallest)
    {
        let mut own = left.column(best).into_owned();
        least = own.norm();
        own.unscale_mut(least);
        own = free_of(&own, &q);
        own.unscale_mut(own.norm());
        let at = q.ncols();
        q = q.insert_column(at, 0.0);
        q.set_column(at, &own);
        taken.push(best);
        for (_, mut column) in left.column_iter_mut().enumerate().filter(|(j, _)| !taken.contains(j)) {
            let own = free_of(&column.clone_owned(), &q.columns(at, 1).into_owned());
            column.copy_from(&own);
        }
    }
    (q, taken, least)
}

/// What of `x` the orthonormal columns of `q` do not span, taken off twice for the sake of rounding.
pub fn free_of(x: &DVector<f64>, q: &DMatrix<f64>) -> DVector<f64> {
    let once = x - q * q.tr_mul(x);
    &once - q * q.tr_mul(&once)
}

/// The least squares solution of `m d = x` in the columns that [`orthonormal`] takes; zero elsewhere.
pub fn least_squares(m: &DMatrix<f64>, x: &DVector<f64>, smallest: f64) -> Vec<f64> {
    let (q, taken, _) = orthonormal(m, smallest);
    let own = DMatrix::from_fn(m.nrows(), taken.len(), |i, j| m[(i, taken[j])]);
    let triangle = q.tr_mul(&own);
    let mut d = vec![0.0; m.ncols()];
    let mut rest = x.clone();
    // a second pass takes up what rounding left of the first
    for _ in 0..2 {
        let step = triangle.clone().lu().solve(&q.tr_mul(&rest)).expect("independent columns");
        taken.iter().zip(step.iter()).for_each(|(j, step)| d[*j] += step);
        rest = x - m * DVector::from_column_slice(&d);
    }
    d
}

/// Largest size of each output over lines x outputs; one where it is zero.
pub fn sizes(lines: &[C64], outputs: usize) -> Vec<f64> {
    let of = |o| lines.iter().skip(o).step_by(outputs).fold(0.0_f64, |a, z| a.max(z.norm()));
    (0..outputs).map(of).map(|size| if size > 0.0 { size } else { 1.0 }).collect()
}
