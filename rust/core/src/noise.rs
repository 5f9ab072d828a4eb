//! Small complex matrices of noise, one a line of the spectrum: sums over neighbours, whitening, the way back.

use nalgebra::Complex;

use crate::closed_loop::ClosedLoop;
use crate::error::{Error, Result, check_len};
use crate::stop::go_on;

type C64 = Complex<f64>;

const ZERO: C64 = C64::new(0.0, 0.0);
/// Part of the power of a channel, beside what follows from other channels, below which it is what sums were rounded by:
/// whether any is left would differ from processor to processor.
const ROUNDING: f64 = 1e-12;
/// Lines between two questions whether to go on.
const UNASKED: usize = 1024;

/// Asks now and then, by the number of a line.
pub(crate) fn go_on_at(line: usize) -> Result<()> {
    if line.is_multiple_of(UNASKED) { go_on() } else { Ok(()) }
}

/// Running sums of `e e^H` over lines e of p channels each.
#[derive(Debug, Clone)]
pub struct Scatter {
    channels: usize,
    lines: Vec<C64>,
    /// Lower triangles, row by row, of the sums over all lines before each.
    below: Vec<C64>,
}

impl Scatter {
    /// Lines x channels; those that are not `used` count for nothing.
    ///
    /// # Errors
    /// [`Error::Shape`].
    pub fn new(lines: &[C64], channels: usize, used: &[bool]) -> Result<Self> {
        check_len("lines of noise", lines.len(), used.len() * channels)?;
        let size = channels * (channels + 1) / 2;
        let mut lines = lines.to_vec();
        let mut below = Vec::with_capacity((used.len() + 1) * size);
        let mut sum = vec![ZERO; size];
        below.extend_from_slice(&sum);
        for (line, used) in lines.chunks_exact_mut(channels.max(1)).zip(used) {
            if !used {
                line.fill(ZERO);
            }
            for (own, sum) in triangle(line).zip(&mut sum) {
                *sum += own;
            }
            below.extend_from_slice(&sum);
        }
        Ok(Self { channels, lines, below })
    }

    /// Sums from line `low` up to `high`, without one line that is `left_out`, of every place: places x p x p.
    ///
    /// # Errors
    /// [`Error::Shape`].
    pub fn between(&self, low: &[usize], high: &[usize], left_out: Option<&[usize]>) -> Result<Vec<C64>> {
        let (p, size) = (self.channels, self.channels * (self.channels + 1) / 2);
        check_len("last lines", high.len(), low.len())?;
        check_len("lines left out", left_out.map_or(low.len(), <[usize]>::len), low.len())?;
        let most = (self.below.len() / size.max(1)).saturating_sub(1);
        let beyond = low.iter().chain(high).any(|k| *k > most);
        if beyond || left_out.is_some_and(|own| own.iter().any(|k| *k >= most)) {
            return Err(Error::Shape { what: "places", found: "more".into(), expected: format!("at most {most}") });
        }
        let mut found = vec![ZERO; low.len() * p * p];
        for (k, found) in found.chunks_exact_mut((p * p).max(1)).enumerate() {
            go_on_at(k)?;
            let (from, to) = (&self.below[low[k] * size..], &self.below[high[k] * size..]);
            let places = (0..p).flat_map(|i| (0..=i).map(move |j| (i, j)));
            for ((i, j), (from, to)) in places.clone().zip(from.iter().zip(to)) {
                found[i * p + j] = to - from;
            }
            if let Some(own) = left_out {
                for ((i, j), own) in places.clone().zip(triangle(&self.lines[own[k] * p..][..p])) {
                    found[i * p + j] -= own;
                }
            }
            places.for_each(|(i, j)| found[j * p + i] = found[i * p + j].conj());
        }
        Ok(found)
    }
}

/// Lower triangle of `e e^H`, row by row.
fn triangle(e: &[C64]) -> impl Iterator<Item = C64> {
    e.iter().enumerate().flat_map(move |(i, a)| e[..=i].iter().map(move |b| a * b.conj()))
}

/// The lower Cholesky factor in place of a Hermitian matrix, whose upper part stays as it was.
///
/// # Errors
/// [`Error::Singular`] where it is not positive definite, but for rounding.
pub(crate) fn cholesky(a: &mut [C64], n: usize) -> Result<()> {
    for j in 0..n {
        let (before, rest) = a.split_at_mut((j + 1) * n);
        let row = &mut before[j * n..];
        let pivot = row[j].re - row[..j].iter().map(C64::norm_sqr).sum::<f64>();
        if pivot.is_nan() || pivot <= ROUNDING * row[j].re {
            return Err(Error::Singular { what: "a covariance that is not positive definite" });
        }
        let root = pivot.sqrt();
        row[j] = C64::from(root);
        for other in rest.chunks_exact_mut(n) {
            let sum = other[..j].iter().zip(&row[..j]).fold(other[j], |sum, (x, y)| sum - x * y.conj());
            other[j] = sum / root;
        }
    }
    Ok(())
}

/// `root^-1 x` in place; `root` is lower triangular with a real diagonal, `x` has any number of columns.
pub(crate) fn solve_lower(root: &[C64], n: usize, x: &mut [C64]) {
    let columns = x.len() / n;
    for i in 0..n {
        let (before, row) = x.split_at_mut(i * columns);
        let row = &mut row[..columns];
        for (factor, other) in root[i * n..i * n + i].iter().zip(before.chunks_exact(columns)) {
            row.iter_mut().zip(other).for_each(|(x, y)| *x -= factor * y);
        }
        let over = 1.0 / root[i * n + i].re;
        row.iter_mut().for_each(|x| *x = x.scale(over));
    }
}

/// `sqrt(2) L^-1` and `sqrt(2) L^-1 back` of every line, L being the Cholesky factor of its covariance.
///
/// # Errors
/// [`Error::Singular`] where a covariance is not positive definite, [`Error::Shape`].
pub fn whitening(covariance: &[C64], back: &[C64], p: usize) -> Result<(Vec<C64>, Vec<C64>)> {
    check_len("way back", back.len(), covariance.len())?;
    let size = p * p;
    let (mut inner, mut both) = (vec![ZERO; covariance.len()], back.to_vec());
    let mut root = vec![ZERO; size];
    let lines = covariance.chunks_exact(size.max(1)).zip(inner.chunks_exact_mut(size.max(1)));
    for (k, ((covariance, inner), both)) in lines.zip(both.chunks_exact_mut(size.max(1))).enumerate() {
        go_on_at(k)?;
        root.copy_from_slice(covariance);
        cholesky(&mut root, p)?;
        root.iter_mut().for_each(|x| *x = x.scale(std::f64::consts::FRAC_1_SQRT_2));
        (0..p).for_each(|i| inner[i * p + i] = C64::from(1.0));
        solve_lower(&root, p, inner);
        solve_lower(&root, p, both);
    }
    Ok((inner, both))
}

/// Logarithm of the likelihood of lines, each by its own covariance, but for a constant (Whittle).
///
/// # Errors
/// As [`whitening`].
pub fn whittle(covariance: &[C64], lines: &[C64], p: usize) -> Result<f64> {
    check_len("covariance of lines", covariance.len(), lines.len() * p)?;
    let (mut root, mut white) = (vec![ZERO; p * p], vec![ZERO; p]);
    let mut sum = 0.0;
    let each = covariance.chunks_exact((p * p).max(1)).zip(lines.chunks_exact(p.max(1)));
    for (k, (covariance, line)) in each.enumerate() {
        go_on_at(k)?;
        root.copy_from_slice(covariance);
        white.copy_from_slice(line);
        cholesky(&mut root, p)?;
        solve_lower(&root, p, &mut white);
        sum -= white.iter().map(C64::norm_sqr).sum::<f64>();
        sum -= (0..p).map(|i| 2.0 * root[i * p + i].re.ln()).sum::<f64>();
    }
    Ok(sum)
}

/// The inverse in place, by elimination with the largest pivot of each column.
fn invert(a: &mut [C64], n: usize, swaps: &mut Vec<usize>) -> Result<()> {
    swaps.clear();
    for k in 0..n {
        let size = |i: &usize| a[i * n + k].norm_sqr();
        let pivot = (k..n).max_by(|i, j| size(i).total_cmp(&size(j))).unwrap_or(k);
        swaps.push(pivot);
        (0..n).for_each(|j| a.swap(k * n + j, pivot * n + j));
        let over = a[k * n + k].inv();
        if !over.is_finite() {
            return Err(Error::Singular { what: "a matrix of a line" });
        }
        a[k * n + k] = C64::from(1.0);
        a[k * n..(k + 1) * n].iter_mut().for_each(|x| *x *= over);
        for i in (0..n).filter(|i| *i != k) {
            let factor = std::mem::replace(&mut a[i * n + k], ZERO);
            for j in 0..n {
                let own = a[k * n + j];
                a[i * n + j] -= factor * own;
            }
        }
    }
    for (k, pivot) in swaps.iter().enumerate().rev() {
        (0..n).for_each(|i| a.swap(i * n + k, i * n + pivot));
    }
    Ok(())
}

/// Inverses of lines x n x n.
///
/// # Errors
/// [`Error::Singular`].
pub fn inverses(matrices: &[C64], n: usize) -> Result<Vec<C64>> {
    let (mut found, mut swaps) = (matrices.to_vec(), Vec::with_capacity(n));
    for (k, own) in found.chunks_exact_mut((n * n).max(1)).enumerate() {
        go_on_at(k)?;
        invert(own, n, &mut swaps)?;
    }
    Ok(found)
}

/// Every line times the matrix of its own: lines x n.
///
/// # Errors
/// [`Error::Shape`].
pub fn through(matrices: &[C64], lines: &[C64], n: usize) -> Result<Vec<C64>> {
    check_len("matrices of lines", matrices.len(), lines.len() * n)?;
    let each = matrices.chunks_exact((n * n).max(1)).zip(lines.chunks_exact(n.max(1)));
    let row = |row: &[C64], line: &[C64]| row.iter().zip(line).fold(ZERO, |sum, (a, b)| sum + a * b);
    Ok(each.flat_map(|(own, line)| own.chunks_exact(n).map(move |own| row(own, line))).collect())
}

/// The way back through a loop from its first `channels` outputs to the noise at the inputs `from`, which acts on as
/// many outputs: lines x channels x channels. Outputs beyond those have noise of their own besides.
///
/// # Errors
/// As [`ClosedLoop::transfer`]; [`Error::Singular`].
pub fn way_back(system: &ClosedLoop, theta: &[f64], w: &[C64], from: &[usize], channels: usize) -> Result<Vec<C64>> {
    let (ny, nu, n) = (system.outputs(), system.inputs(), from.len());
    if channels > ny || n > channels || from.iter().any(|a| *a >= nu) {
        let (found, expected) = (format!("{channels} of {n}"), format!("at most {ny} of {nu}"));
        return Err(Error::Shape { what: "channels of noise", found, expected });
    }
    let transfer = system.transfer(theta, w)?;
    let mut found = vec![ZERO; w.len() * channels * channels];
    let (mut inverse, mut swaps) = (vec![ZERO; n * n], Vec::with_capacity(n));
    let lines = transfer.chunks_exact((ny * nu).max(1)).zip(found.chunks_exact_mut((channels * channels).max(1)));
    for (k, (transfer, found)) in lines.enumerate() {
        go_on_at(k)?;
        let way = |o: usize, k: usize| transfer[o * nu + from[k]];
        inverse.iter_mut().enumerate().for_each(|(k, x)| *x = way(k / n, k % n));
        invert(&mut inverse, n, &mut swaps)?;
        for o in 0..channels {
            let row = &mut found[o * channels..(o + 1) * channels];
            if o < n {
                row[..n].copy_from_slice(&inverse[o * n..(o + 1) * n]);
                continue;
            }
            for (k, own) in inverse.chunks_exact(n.max(1)).enumerate() {
                row.iter_mut().zip(own).for_each(|(x, y)| *x -= way(o, k) * y);
            }
            row[o] = C64::from(1.0);
        }
    }
    Ok(found)
}
