//! Local regressions over lines of a spectrum: what follows neither a smooth gain of an excitation nor a transient.
//!
//! A regression takes some lines in a row. At the place x of a line, -1 to 1, its table T has the excitations and a one,
//! each times the powers of x. What is left of a channel e is `e - T (T'T)^-1 T'e`, from the Cholesky factor of T'T in
//! columns of norm one; where columns are nearly the same, from an orthonormal basis of them.

use std::ops::Range;

use nalgebra::{Complex, DMatrix};

use crate::error::{Error, Result, check_len};
use crate::product::{LANES, Panels, ROW_MULTIPLE, add_gram, product};
use crate::stop::go_on;

type C64 = Complex<f64>;

const ZERO: C64 = C64::new(0.0, 0.0);
/// Part of a column's square that is its own, beside those before it, up to which T'T loses too many digits.
const OWN: f64 = 1e-6;

/// Where regressions are made, and of what polynomials.
#[derive(Debug, Clone, Copy)]
pub struct Windows<'a> {
    /// First line of each.
    pub starts: &'a [usize],
    /// Of every line the regression that gives its power; never falling.
    pub nearest: &'a [usize],
    /// Lines of each.
    pub width: usize,
    /// Of the polynomials over a regression's lines.
    pub degree: usize,
    /// Part of a line's noise that a regression takes, at the most.
    pub most_taken: f64,
}

/// Channels whose table is weighted alike: the last one's end, and the weight of every line.
pub type Weighted<'a> = (usize, &'a [f64]);

/// What regressions leave.
#[derive(Debug, Clone)]
pub struct Left {
    /// Sums of `e e^H` over the lines of each regression: regressions x channels x channels.
    pub sums: Vec<C64>,
    /// Power of every line and channel by itself, raised by what the regression took: lines x channels.
    pub power: Vec<f64>,
}

/// What regressions on `excitation`, lines x axes, leave of `own`, lines x channels.
///
/// # Errors
/// [`Error::Shape`], [`Error::Stopped`].
pub fn regressed(
    own: &[C64],
    channels: usize,
    excitation: &[C64],
    groups: &[Weighted<'_>],
    windows: Windows<'_>,
) -> Result<Left> {
    let lines = windows.nearest.len();
    check_len("lines of noise", own.len(), lines * channels)?;
    let axes = excitation.len().checked_div(lines).unwrap_or(0);
    check_len("excitation on lines", excitation.len(), lines * axes)?;
    check_len("channels that are weighted", groups.last().map_or(0, |(end, _)| *end), channels)?;
    for (_, weights) in groups {
        check_len("weights of lines", weights.len(), lines)?;
    }
    let last = windows.starts.iter().max().map_or(0, |start| start + windows.width);
    if last > lines || windows.nearest.iter().any(|k| *k >= windows.starts.len()) {
        let (found, expected) = (last.to_string(), format!("at most {lines}"));
        return Err(Error::Shape { what: "lines of a regression", found, expected });
    }
    let mut left = Left {
        sums: Vec::with_capacity(windows.starts.len() * channels * channels),
        power: vec![0.0; lines * channels],
    };
    let mut taken = Gram::new(2 * channels, windows.width);
    let mut tables: Vec<Table> = Vec::with_capacity(groups.len());
    let mut first = 0;
    for (end, weights) in groups {
        tables.push(Table::new(first..*end, weights, (axes + 1) * (windows.degree + 1), windows.width));
        first = *end;
    }
    let mut line = 0;
    for (k, start) in windows.starts.iter().enumerate() {
        go_on()?;
        let next = line + windows.nearest[line..].iter().take_while(|nearest| **nearest == k).count();
        for table in &mut tables {
            table.fill(own, channels, excitation, axes, *start, windows.degree);
            let basis = table.solve();
            for (place, row) in table.left.chunks_exact(table.stride).take(windows.width).enumerate() {
                for (c, channel) in table.channels.clone().enumerate() {
                    taken.rows[place * taken.stride + channel] = row[c];
                    taken.rows[place * taken.stride + channels + channel] = row[table.channels.len() + c];
                }
            }
            for own in line..next {
                let place = own.saturating_sub(*start).min(windows.width - 1);
                let free = 1.0 - table.leverage(&basis, place).min(windows.most_taken);
                let row = &taken.rows[place * taken.stride..];
                for c in table.channels.clone() {
                    left.power[own * channels + c] = (row[c] * row[c] + row[channels + c] * row[channels + c]) / free;
                }
            }
        }
        line = next;
        taken.add_up();
        for (i, j) in (0..channels * channels).map(|k| (k / channels, k % channels)) {
            left.sums.push(taken.product(channels, j, i));
        }
    }
    Ok(left)
}

/// Rows of complex numbers, real parts and then imaginary ones, and their Gram matrix.
struct Gram {
    rows: Vec<f64>,
    stride: usize,
    sums: Vec<f64>,
}

impl Gram {
    fn new(columns: usize, width: usize) -> Self {
        let stride = columns.next_multiple_of(LANES);
        Self {
            rows: vec![0.0; width.next_multiple_of(ROW_MULTIPLE) * stride],
            stride,
            sums: vec![0.0; stride * stride],
        }
    }

    fn add_up(&mut self) {
        self.sums.fill(0.0);
        add_gram(&self.rows, self.stride, &mut self.sums);
    }

    /// Sum over the rows of `conj(x_i) x_j`, of rows of so many numbers.
    fn product(&self, numbers: usize, i: usize, j: usize) -> C64 {
        let at = |i: usize, j: usize| self.sums[i.min(j) * self.stride + i.max(j)];
        C64::new(at(i, j) + at(numbers + i, numbers + j), at(i, numbers + j) - at(j, numbers + i))
    }
}

/// A regression of some channels.
struct Table<'a> {
    channels: Range<usize>,
    weights: &'a [f64],
    /// Numbers that are fitted.
    fitted: usize,
    width: usize,
    /// `[T | e]` of every line.
    gram: Gram,
    /// What is left of every line and channel, real parts and then imaginary ones.
    left: Vec<f64>,
    stride: usize,
}

/// By which the part of a line that a regression takes is determined.
enum Basis {
    /// The Cholesky factor of T'T in columns of norm one, and by what these are scaled.
    Factor(DMatrix<C64>, Vec<f64>),
    Orthonormal(DMatrix<C64>),
}

impl<'a> Table<'a> {
    fn new(channels: Range<usize>, weights: &'a [f64], fitted: usize, width: usize) -> Self {
        let gram = Gram::new(2 * (fitted + channels.len()), width);
        let stride = (2 * channels.len()).next_multiple_of(LANES);
        let left = vec![0.0; width.next_multiple_of(ROW_MULTIPLE) * stride];
        Self { channels, weights, fitted, width, gram, left, stride }
    }

    fn fill(&mut self, own: &[C64], p: usize, excitation: &[C64], axes: usize, start: usize, degree: usize) {
        let numbers = self.fitted + self.channels.len();
        let step = 2.0 / (self.width.max(2) - 1) as f64;
        for (place, row) in self.gram.rows.chunks_exact_mut(self.gram.stride).take(self.width).enumerate() {
            let line = start + place;
            let (re, im) = row.split_at_mut(numbers);
            let x = place as f64 * step - 1.0;
            let inputs = excitation[line * axes..(line + 1) * axes].iter().copied().chain([C64::from(1.0)]);
            for (a, u) in inputs.enumerate() {
                let mut term = u * self.weights[line];
                for i in a * (degree + 1)..(a + 1) * (degree + 1) {
                    (re[i], im[i]) = (term.re, term.im);
                    term *= x;
                }
            }
            for (c, e) in own[line * p..(line + 1) * p][self.channels.clone()].iter().enumerate() {
                (re[self.fitted + c], im[self.fitted + c]) = (e.re, e.im);
            }
        }
    }

    /// Finds what is left of the table's channels.
    fn solve(&mut self) -> Basis {
        let (q, p) = (self.fitted, self.channels.len());
        let numbers = q + p;
        self.gram.add_up();
        let norm = |j: usize| self.gram.product(numbers, j, j).re.sqrt();
        let scale: Vec<f64> = (0..q).map(|j| if norm(j) > 0.0 { 1.0 / norm(j) } else { 0.0 }).collect();
        let scaled = DMatrix::from_fn(q, q, |i, j| self.gram.product(numbers, i, j) * (scale[i] * scale[j]));
        let Some(factor) = factor(scaled) else { return self.by_basis(&scale) };
        let mut gains = DMatrix::from_fn(q, p, |j, c| self.gram.product(numbers, j, q + c) * scale[j]);
        factor.solve_lower_triangular_mut(&mut gains);
        factor.ad_solve_lower_triangular_mut(&mut gains);
        // of the real row [T e] the columns of what is left
        let mut weights = vec![0.0; self.gram.stride * 2 * p];
        let mut put = |row: usize, column: usize, value: f64| weights[row * 2 * p + column] = value;
        for c in 0..p {
            for (j, scale) in scale.iter().enumerate() {
                let gain = gains[(j, c)] * *scale;
                put(j, c, -gain.re);
                put(numbers + j, c, gain.im);
                put(j, p + c, -gain.im);
                put(numbers + j, p + c, -gain.re);
            }
            put(q + c, c, 1.0);
            put(numbers + q + c, p + c, 1.0);
        }
        let weights = Panels::new(self.gram.stride, 2 * p, &weights);
        product(&self.gram.rows, self.left.len() / self.stride, &weights, &mut self.left);
        Basis::Factor(factor, scale)
    }

    /// The same by an orthonormal basis of the columns.
    fn by_basis(&mut self, scale: &[f64]) -> Basis {
        let (q, p) = (self.fitted, self.channels.len());
        let basis = DMatrix::from_fn(self.width, q, |place, j| self.number(place, j) * scale[j]).qr().q();
        let own = DMatrix::from_fn(self.width, p, |place, c| self.number(place, q + c));
        let left = &own - &basis * basis.ad_mul(&own);
        for (place, row) in self.left.chunks_exact_mut(self.stride).take(self.width).enumerate() {
            (0..p).for_each(|c| (row[c], row[p + c]) = (left[(place, c)].re, left[(place, c)].im));
        }
        Basis::Orthonormal(basis)
    }

    fn number(&self, place: usize, j: usize) -> C64 {
        let row = &self.gram.rows[place * self.gram.stride..];
        C64::new(row[j], row[self.fitted + self.channels.len() + j])
    }

    /// Part of a line's noise that the regression takes.
    fn leverage(&self, basis: &Basis, place: usize) -> f64 {
        match basis {
            Basis::Orthonormal(basis) => basis.row(place).norm_squared(),
            Basis::Factor(factor, scale) => {
                let own = scale.iter().enumerate().map(|(j, scale)| self.number(place, j).conj() * *scale);
                let mut row = DMatrix::from_iterator(self.fitted, 1, own);
                factor.solve_lower_triangular_mut(&mut row);
                row.norm_squared()
            }
        }
    }
}

/// The lower Cholesky factor; `None` where a column is nearly one of those before it.
fn factor(mut a: DMatrix<C64>) -> Option<DMatrix<C64>> {
    let n = a.nrows();
    for j in 0..n {
        let pivot = a[(j, j)].re;
        if pivot.is_nan() || pivot < OWN {
            return None;
        }
        let root = pivot.sqrt();
        a.view_mut((j, j), (n - j, 1)).unscale_mut(root);
        (0..j).for_each(|i| a[(i, j)] = ZERO);
        for k in j + 1..n {
            let own = a[(k, j)].conj();
            for i in k..n {
                let done = a[(i, j)];
                a[(i, k)] -= own * done;
            }
        }
    }
    Some(a)
}
