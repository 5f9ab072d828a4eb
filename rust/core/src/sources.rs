//! Lines of noise that several independent sources add to, each with a power that is a smooth curve over frequency.

use nalgebra::Complex;

use crate::error::{Error, Result, check_len};
use crate::noise::{cholesky, go_on_at, solve_lower};

type C64 = Complex<f64>;

const ZERO: C64 = C64::new(0.0, 0.0);
/// Splines that are not zero at a frequency: cubic ones.
pub const OVERLAP: usize = 4;
/// Logarithms of powers beyond which they are clipped.
const FARTHEST: f64 = 60.0;

/// Ways from m sources to p channels on lines, and the splines over frequency that make the logarithms of their powers.
#[derive(Debug, Clone)]
pub struct Sources {
    channels: usize,
    sources: usize,
    splines: usize,
    /// Lines x sources x channels.
    columns: Vec<C64>,
    /// Of the splines at each line.
    first: Vec<usize>,
    /// Lines x `OVERLAP`.
    weights: Vec<f64>,
}

/// How likely lines are (Whittle), but for a constant, with its slopes by the coefficients, sources x splines, and their
/// information, a square matrix.
#[derive(Debug, Clone)]
pub struct Likely {
    pub likelihood: f64,
    pub score: Vec<f64>,
    pub information: Vec<f64>,
}

/// What is computed of one line, over and over in the same place.
struct Line {
    covariance: Vec<C64>,
    /// Columns that make up the covariance, then the line, sources x channels.
    own: Vec<C64>,
}

impl Sources {
    /// Of ways, lines x channels x sources, the first spline at each line, and the values there of it and those after.
    ///
    /// # Errors
    /// [`Error::Shape`].
    pub fn new(ways: &[C64], channels: usize, first: &[usize], weights: &[f64], splines: usize) -> Result<Self> {
        let size = (channels * first.len()).max(1);
        let sources = ways.len() / size;
        check_len("ways", ways.len(), size * sources)?;
        check_len("weights of splines", weights.len(), first.len() * OVERLAP)?;
        if first.iter().any(|k| k + OVERLAP > splines) {
            return Err(Error::Shape { what: "splines", found: "more".into(), expected: format!("{splines}") });
        }
        let mut columns = vec![ZERO; ways.len()];
        let block = (channels * sources).max(1);
        for (way, own) in ways.chunks_exact(block).zip(columns.chunks_exact_mut(block)) {
            for (k, x) in own.iter_mut().enumerate() {
                *x = way[(k % channels) * sources + k / channels];
            }
        }
        Ok(Self { channels, sources, splines, columns, first: first.to_vec(), weights: weights.to_vec() })
    }

    /// Number of the lines.
    #[must_use]
    pub fn lines(&self) -> usize {
        self.first.len()
    }

    /// Number of the channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of all coefficients.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        self.sources * self.splines
    }

    fn line(&self) -> Line {
        let (p, m) = (self.channels, self.sources);
        Line { covariance: vec![ZERO; p * p], own: vec![ZERO; (m + 1) * p] }
    }

    fn checked(&self, coefficients: &[f64]) -> Result<()> {
        check_len("coefficients of powers", coefficients.len(), self.coefficients())
    }

    fn weights(&self, line: usize) -> &[f64] {
        &self.weights[line * OVERLAP..(line + 1) * OVERLAP]
    }

    /// The columns with the root of their power, and the Cholesky factor of the covariance.
    fn factor(&self, line: usize, coefficients: &[f64], at: &mut Line) -> Result<()> {
        let (p, m, first) = (self.channels, self.sources, self.first[line]);
        let ways = self.columns[line * m * p..(line + 1) * m * p].chunks_exact(p);
        for ((own, way), curve) in at.own.chunks_exact_mut(p).zip(ways).zip(coefficients.chunks_exact(self.splines)) {
            let level: f64 = self.weights(line).iter().zip(&curve[first..]).map(|(w, c)| w * c).sum();
            let root = (0.5 * level.clamp(-FARTHEST, FARTHEST)).exp();
            own.iter_mut().zip(way).for_each(|(x, way)| *x = way.scale(root));
        }
        at.covariance.fill(ZERO);
        for own in at.own[..m * p].chunks_exact(p) {
            for (i, row) in at.covariance.chunks_exact_mut(p).enumerate() {
                row[..=i].iter_mut().zip(own).for_each(|(x, b)| *x += own[i] * b.conj());
            }
        }
        cholesky(&mut at.covariance, p)
    }

    /// Adds information on the coefficients, for every source and those after it.
    fn add(&self, line: usize, own: &[C64], into: &mut [f64]) {
        let (size, first, weights) = (self.coefficients(), self.first[line], self.weights(line));
        for (c, x) in own.chunks_exact(self.channels).enumerate() {
            for (d, y) in own.chunks_exact(self.channels).enumerate().skip(c) {
                let known = dot(x, y).norm_sqr();
                for (a, w) in weights.iter().enumerate() {
                    let at = (c * self.splines + first + a) * size + d * self.splines + first;
                    into[at..at + OVERLAP].iter_mut().zip(weights).for_each(|(x, v)| *x += known * w * v);
                }
            }
        }
    }

    /// Likelihood of lines, lines x channels, about coefficients.
    ///
    /// Of a line `z` with `q = z^H S^-1 z` beyond `usual`, which is hardly noise, `usual (1 + ln(q / usual))` stands in
    /// place of q.
    ///
    /// # Errors
    /// [`Error::Singular`] where a covariance is not positive definite, [`Error::Shape`].
    pub fn likely(&self, lines: &[C64], coefficients: &[f64], usual: f64) -> Result<Likely> {
        let (p, m, size) = (self.channels, self.sources, self.coefficients());
        check_len("lines of noise", lines.len(), self.lines() * p)?;
        self.checked(coefficients)?;
        let (mut likelihood, mut score, mut information) = (0.0, vec![0.0; size], vec![0.0; size * size]);
        let mut at = self.line();
        for (k, z) in lines.chunks_exact(p.max(1)).enumerate() {
            go_on_at(k)?;
            self.factor(k, coefficients, &mut at)?;
            at.own[m * p..].copy_from_slice(z);
            at.own.chunks_exact_mut(p).for_each(|own| solve_lower(&at.covariance, p, own));
            let (own, z) = at.own.split_at(m * p);
            let q = power(z);
            let (cost, weight) = if q > usual { (usual * (1.0 + (q / usual).ln()), usual / q) } else { (q, 1.0) };
            likelihood -= cost + (0..p).map(|i| 2.0 * at.covariance[i * p + i].re.ln()).sum::<f64>();
            for (c, x) in own.chunks_exact(p).enumerate() {
                let slope = weight * dot(x, z).norm_sqr() - power(x);
                let into = &mut score[c * self.splines + self.first[k]..];
                into.iter_mut().zip(self.weights(k)).for_each(|(s, w)| *s += slope * w);
            }
            self.add(k, own, &mut information);
        }
        for i in 0..size {
            for j in 0..i {
                information[i * size + j] = information[j * size + i];
            }
        }
        Ok(Likely { likelihood, score, information })
    }

    /// Information on each line times the covariance of the coefficients: the numbers that were fitted there.
    ///
    /// # Errors
    /// As [`Self::likely`].
    pub fn fitted(&self, coefficients: &[f64], variance: &[f64]) -> Result<Vec<f64>> {
        let (p, m, size) = (self.channels, self.sources, self.coefficients());
        self.checked(coefficients)?;
        check_len("variance", variance.len(), size * size)?;
        let (mut at, mut found) = (self.line(), Vec::with_capacity(self.lines()));
        for k in 0..self.lines() {
            go_on_at(k)?;
            self.factor(k, coefficients, &mut at)?;
            at.own.chunks_exact_mut(p).take(m).for_each(|own| solve_lower(&at.covariance, p, own));
            let (own, weights, mut sum) = (&at.own[..m * p], self.weights(k), 0.0);
            for (c, x) in own.chunks_exact(p).enumerate() {
                for (d, y) in own.chunks_exact(p).enumerate() {
                    let mut unsure = 0.0;
                    for (a, w) in weights.iter().enumerate() {
                        let from = (c * self.splines + self.first[k] + a) * size + d * self.splines + self.first[k];
                        unsure += w * variance[from..].iter().zip(weights).map(|(v, w)| v * w).sum::<f64>();
                    }
                    sum += dot(x, y).norm_sqr() * unsure;
                }
            }
            found.push(sum);
        }
        Ok(found)
    }

    /// Inverses of the Cholesky factors of the covariances: lines x p x p.
    ///
    /// # Errors
    /// As [`Self::likely`].
    pub fn whitening(&self, coefficients: &[f64]) -> Result<Vec<C64>> {
        let p = self.channels;
        self.checked(coefficients)?;
        let (mut at, mut found) = (self.line(), vec![ZERO; self.lines() * p * p]);
        for (k, own) in found.chunks_exact_mut((p * p).max(1)).enumerate() {
            go_on_at(k)?;
            self.factor(k, coefficients, &mut at)?;
            (0..p).for_each(|i| own[i * p + i] = C64::from(1.0));
            solve_lower(&at.covariance, p, own);
        }
        Ok(found)
    }
}

fn dot(x: &[C64], y: &[C64]) -> C64 {
    x.iter().zip(y).fold(ZERO, |sum, (a, b)| sum + a.conj() * b)
}

fn power(x: &[C64]) -> f64 {
    x.iter().map(C64::norm_sqr).sum()
}
