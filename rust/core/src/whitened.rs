//! Whitened lines of records against a loop, reduced to normal equations; the transient of each record is fitted.
//!
//! On every line the residual r, its derivatives and the basis T of the transient are whitened, and their real and
//! imaginary parts are rows of `[T | dz | r]`. From the Gram matrix of these rows the transient is eliminated, so that
//! what is left is least squares in the parameters alone, exact at the best transient.

mod rows;

use std::sync::{Mutex, PoisonError};

use nalgebra::{Complex, DMatrix, DVector};

use crate::closed_loop::ClosedLoop;
use crate::error::{Error, Result, check_len};
use crate::lines::{OnLines, radius};
use crate::product::add_gram;
use crate::stop::each;
use rows::{Layout, stretch};

type C64 = Complex<f64>;

/// Part of a basis vector's square that must be its own, beside those before it, for it to count.
const OWN: f64 = 1e-11;
/// Size of a basis vector, relative to the largest one, at which it is rounding: of a state that is not seen.
const SEEN: f64 = 1e-10;

/// Part of the sum of squares by which a transient near the best one may raise it.
const FAR: f64 = 1e-3;
/// The same by which it is of no use: what it adds along directions that are not its own, [`OWN`], would be left.
const LOST: f64 = 1e4;

/// Measured lines of a record.
#[derive(Debug, Clone)]
pub struct LineData {
    w: Vec<C64>,
    u: Vec<C64>,
    z: Vec<C64>,
    /// Lines x channels x channels.
    whitening: Vec<C64>,
    channels: usize,
}

/// `sum |W (z - G u - T d)|^2` over lines at the best d, as a quadratic form about `theta`.
#[derive(Debug, Clone)]
pub struct LineNormal {
    /// J'J of the whitened residual, free x free, freed from what the transient can take over.
    pub hessian: DMatrix<f64>,
    /// J'r, r being simulated minus measured.
    pub gradient: DVector<f64>,
    /// Sum of squares.
    pub cost: f64,
    /// The transient of each record.
    pub transients: Vec<Vec<f64>>,
    /// How it changes with each parameter of `free`: free x numbers of the transient.
    pub transient_slopes: Vec<Vec<f64>>,
    /// How many numbers of it the lines determine.
    pub fitted: Vec<usize>,
}

impl LineData {
    /// Points `w` of the unit circle, inputs `u` (lines x inputs), outputs `z` (lines x channels) and `whitening`.
    ///
    /// The channels are the first outputs of the loop.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn new(system: &ClosedLoop, w: Vec<C64>, u: Vec<C64>, z: Vec<C64>, whitening: Vec<C64>) -> Result<Self> {
        let channels = z.len().checked_div(w.len()).unwrap_or(0);
        check_len("inputs on lines", u.len(), w.len() * system.inputs())?;
        check_len("outputs on lines", z.len(), w.len() * channels)?;
        check_len("whitening", whitening.len(), w.len() * channels * channels)?;
        if channels > system.outputs() {
            let (found, expected) = (channels.to_string(), format!("at most {}", system.outputs()));
            return Err(Error::Shape { what: "channels on lines", found, expected });
        }
        for (what, numbers) in [("lines", &w), ("inputs", &u), ("outputs", &z), ("whitening", &whitening)] {
            if numbers.iter().any(|x| !(x.re.is_finite() && x.im.is_finite())) {
                return Err(Error::NotFinite { what });
            }
        }
        Ok(Self { w, u, z, whitening, channels })
    }
}

/// The normal equations of all records together, by the parameters in `free`.
///
/// `near` holds a transient of each record, close to the best one, or nothing; it is only needed for the derivatives of
/// what the transient adds, and where there is none, the best one at `theta` is found first.
///
/// # Errors
/// [`Error::Unstable`], [`Error::Shape`] where a record belongs to another loop, and as [`ClosedLoop::poles`].
pub fn line_equations(
    system: &ClosedLoop,
    theta: &[f64],
    free: &[usize],
    records: &[&LineData],
    near: &[Vec<f64>],
) -> Result<LineNormal> {
    let radius = records.iter().map(|data| radius(&data.w)).fold(f64::INFINITY, f64::min).max(1.0);
    let parts = system.on_lines(theta, free, radius, false)?;
    let states: usize = parts.iter().map(OnLines::states).sum();
    for data in records {
        check_len("inputs of a record on lines", data.u.len(), data.w.len() * system.inputs())?;
    }
    let np = free.len();
    let is_near = near.len() == records.len() && near.iter().all(|d| d.len() == states);
    let afresh = |data: &LineData| -> Result<Vec<f64>> {
        let value = system.on_lines(theta, &[], radius, false)?;
        Ok(Gram::new(&value, 0, data, system.inputs(), &[])?.eliminated().transient(&value, 0))
    };
    let one = |k: usize, data: &&LineData| -> Result<LineNormal> {
        let mut start = match (is_near, free.is_empty()) {
            (true, _) => near[k].clone(),
            (false, true) => Vec::new(),
            (false, false) => afresh(data)?,
        };
        let mut found = Gram::new(&parts, np, data, system.inputs(), &start)?.eliminated();
        if is_near && found.is_far(LOST) {
            start = afresh(data)?;
            found = Gram::new(&parts, np, data, system.inputs(), &start)?.eliminated();
        } else if is_near && !free.is_empty() && found.is_far(FAR) {
            let more = found.transient(&parts, np);
            start.iter_mut().zip(more).for_each(|(d, more)| *d += more);
            found = Gram::new(&parts, np, data, system.inputs(), &start)?.eliminated();
        }
        Ok(found.normal(&parts, np, start))
    };
    let each = each(records, one)?;
    let mut total = LineNormal {
        hessian: DMatrix::zeros(np, np),
        gradient: DVector::zeros(np),
        cost: 0.0,
        transients: Vec::with_capacity(each.len()),
        transient_slopes: Vec::with_capacity(each.len()),
        fitted: Vec::with_capacity(each.len()),
    };
    for own in each {
        total.hessian += own.hessian;
        total.gradient += own.gradient;
        total.cost += own.cost;
        total.fitted.extend(own.fitted);
        total.transients.extend(own.transients);
        total.transient_slopes.extend(own.transient_slopes);
    }
    Ok(total)
}

/// Second moments of the rows `[T | dz | r]`.
struct Gram {
    states: usize,
    moments: DMatrix<f64>,
}

impl Gram {
    fn new(parts: &[OnLines], np: usize, data: &LineData, inputs: usize, d: &[f64]) -> Result<Self> {
        let layout = Layout::new(parts, np, data.channels, true);
        let (stride, count, own) = (layout.stride, data.w.len(), stretch(data.w.len()));
        let starts: Vec<usize> = (0..count).step_by(own).collect();
        let one = |_: usize, first: &usize| -> Result<Vec<f64>> {
            let (mut sum, lines) = (vec![0.0; stride * stride], *first..(first + own).min(count));
            layout.walk(parts, data, lines, inputs, d, &mut |_, rows| add_gram(rows, stride, &mut sum))?;
            Ok(sum)
        };
        let mut sum = vec![0.0; stride * stride];
        for own in each(&starts, one)? {
            sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
        let moments = DMatrix::from_fn(layout.size, layout.size, |i, j| sum[i.min(j) * stride + i.max(j)]);
        Ok(Self { states: layout.states, moments })
    }

    /// Takes the transient out, number by number, the one that is most its own first.
    fn eliminated(self) -> Eliminated {
        let Self { states, mut moments } = self;
        let size = moments.nrows();
        let before = moments[(size - 1, size - 1)];
        let mut scale: Vec<f64> = (0..states).map(|i| moments[(i, i)].sqrt()).collect();
        let seen = SEEN * scale.iter().copied().fold(0.0, f64::max);
        scale.iter_mut().filter(|scale| **scale <= seen).for_each(|scale| *scale = 0.0);
        for (i, scale) in scale.iter().enumerate().filter(|(_, scale)| **scale > 0.0) {
            moments.row_mut(i).unscale_mut(*scale);
            moments.column_mut(i).unscale_mut(*scale);
        }
        let mut left: Vec<usize> = (0..states).filter(|i| scale[*i] > 0.0).collect();
        let mut order = Vec::with_capacity(states);
        while let Some((place, pivot)) = (left.iter().copied().enumerate())
            .max_by(|a, b| moments[(a.1, a.1)].total_cmp(&moments[(b.1, b.1)]))
            .filter(|(_, pivot)| moments[(*pivot, *pivot)] > OWN)
        {
            left.swap_remove(place);
            let row: Vec<f64> = moments.row(pivot).iter().copied().collect();
            let rest: Vec<usize> = left.iter().copied().chain(states..size).collect();
            for i in &rest {
                let factor = row[*i] / row[pivot];
                rest.iter().for_each(|j| moments[(*i, *j)] -= factor * row[*j]);
            }
            order.push((pivot, row));
        }
        Eliminated { states, moments, before, scale, order }
    }
}

/// Moments after the transient was taken out, and the rows that it was taken out by.
struct Eliminated {
    states: usize,
    moments: DMatrix<f64>,
    /// r'r before.
    before: f64,
    scale: Vec<f64>,
    order: Vec<(usize, Vec<f64>)>,
}

impl Eliminated {
    /// Whether the transient that was started from is too far from the best one for the derivatives to be its own.
    fn is_far(&self, by: f64) -> bool {
        let last = self.moments.nrows() - 1;
        self.before - self.moments[(last, last)] > by * self.moments[(last, last)]
    }

    /// The transient that leaves least of a column: of `dz` by one parameter, or, behind these, of `r`.
    fn transient(&self, parts: &[OnLines], column: usize) -> Vec<f64> {
        let last = self.states + column;
        let mut d = vec![0.0; self.states];
        for (pivot, row) in self.order.iter().rev() {
            let others: f64 = row[..self.states].iter().zip(&d).map(|(m, d)| m * d).sum();
            d[*pivot] = -(row[last] + others) / row[*pivot];
        }
        d.iter_mut().zip(&self.scale).filter(|(_, scale)| **scale > 0.0).for_each(|(d, scale)| *d /= scale);
        let mut left = &mut d[..];
        for part in parts {
            let (own, rest) = left.split_at_mut(part.states());
            part.of_loop(own);
            left = rest;
        }
        d
    }

    fn normal(self, parts: &[OnLines], np: usize, start: Vec<f64>) -> LineNormal {
        let slopes = (0..np).flat_map(|j| self.transient(parts, j)).collect();
        let mut transient = self.transient(parts, np);
        transient.iter_mut().zip(start).for_each(|(d, start)| *d += start);
        let (first, last) = (self.states, self.moments.nrows() - 1);
        LineNormal {
            hessian: self.moments.view((first, first), (np, np)).into_owned(),
            gradient: self.moments.view((first, last), (np, 1)).column(0).into_owned(),
            cost: self.moments[(last, last)].max(0.0),
            transients: vec![transient],
            transient_slopes: vec![slopes],
            fitted: vec![self.order.len()],
        }
    }
}

/// Whitened rows `[T | dz | r]` of a record: of every line and channel the real part and then the imaginary one.
///
/// `r` is simulated minus measured with the transient `d`; without `transients` there is no T.
///
/// # Errors
/// As [`line_equations`].
pub fn line_rows(
    system: &ClosedLoop,
    theta: &[f64],
    free: &[usize],
    data: &LineData,
    d: &[f64],
    transients: bool,
) -> Result<(Vec<f64>, usize)> {
    let parts = system.on_lines(theta, free, radius(&data.w), free.is_empty() && d.is_empty() && !transients)?;
    let states: usize = parts.iter().map(OnLines::states).sum();
    check_len("inputs of a record on lines", data.u.len(), data.w.len() * system.inputs())?;
    if !d.is_empty() {
        check_len("transient", d.len(), states)?;
    }
    let layout = Layout::new(&parts, free.len(), data.channels, transients);
    let (per_line, stretch) = (2 * data.channels * layout.size, stretch(data.w.len()));
    let mut out = vec![0.0; data.w.len() * per_line];
    let places: Vec<Mutex<&mut [f64]>> = out.chunks_mut((stretch * per_line).max(1)).map(Mutex::new).collect();
    each(&places, |k, place| {
        let (first, mut own) = (k * stretch, place.lock().unwrap_or_else(PoisonError::into_inner));
        let lines = first..first + own.len() / per_line;
        layout.walk(&parts, data, lines, system.inputs(), d, &mut |line, rows| {
            let to = own[(line - first) * per_line..].chunks_exact_mut(layout.size);
            rows.chunks_exact(layout.stride).zip(to).for_each(|(row, to)| to.copy_from_slice(&row[..layout.size]));
        })
    })?;
    drop(places);
    let mut at = 0;
    for part in parts.iter().filter(|_| transients) {
        let n = part.states();
        out.chunks_exact_mut(layout.size).for_each(|row| part.of_loop(&mut row[at..at + n]));
        at += n;
    }
    Ok((out, layout.size))
}
