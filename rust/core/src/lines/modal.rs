//! Lines of a loop in modal form: sums over its poles.
//!
//! With `f_i = 1 / (w - mu_i)` and `p_i = f_i (b_i u + w d_i)`, `z = sum_i c_i p_i + D u` and `dz = sum_i (dc_i p_i + c_i f_i (db_i u + dmu_i p_i)) + dD u`.
//!
//! The poles of a pair have conjugate weights k: what they add of any g is `k g+ + k* g-`, in real weights
//! `Re k (g+ + g-) + Im k i (g+ - g-)`.

use nalgebra::Complex;

use super::{BLOCK, Block};
use crate::error::Result;
use crate::instructions::dispatch;
use crate::modal::{Modal, Residues};
use crate::product::{Panels, ROW_MULTIPLE, product};
use crate::stop::go_on;

type C64 = Complex<f64>;

/// Part of its first square at which what a pole adds to a free response is rounding.
const GONE: f64 = 1e-44;

/// Poles in the order of the upper ones of pairs, real ones, and the lower ones of pairs.
pub struct Poles {
    value: Residues,
    pairs: usize,
    reals: usize,
    mu: Split,
    /// Inputs after each other, each with the numbers of all poles.
    b: Split,
    /// Outputs after each other, each with the numbers of the upper and of the real poles.
    c: Split,
    /// `[p, u_a.., f p, f u_a..]`, each in the terms of the heading, to outputs x `[value, slopes..]`; without slopes
    /// the first two.
    weights: Panels,
    depth: usize,
    has_slopes: bool,
}

/// Real and imaginary parts of complex numbers.
#[derive(Default)]
struct Split {
    re: Vec<f64>,
    im: Vec<f64>,
}

impl FromIterator<C64> for Split {
    fn from_iter<I: IntoIterator<Item = C64>>(numbers: I) -> Self {
        let (re, im) = numbers.into_iter().map(|x| (x.re, x.im)).unzip();
        Self { re, im }
    }
}

/// `value` and `slopes` with the poles in another order.
fn reordered(of: &Residues, order: &[usize]) -> Residues {
    let mu = order.iter().map(|i| of.mu[*i]).collect();
    Residues { mu, b: of.b.select_rows(order), c: of.c.select_columns(order), d: of.d.clone() }
}

/// Gives the largest weight of every pole no phase, nor its derivatives, so that a transient changes smoothly with the
/// parameters; the lower poles of pairs follow the upper ones.
fn turn(value: &mut Residues, slopes: &mut [Residues], pairs: usize) {
    let (ny, own) = (value.c.nrows(), value.mu.len() - pairs);
    for i in 0..own {
        let size = |o: &usize| value.c[(*o, i)].norm() * (ny + o) as f64; // of two that are alike always the same one
        let Some(largest) = (0..ny).max_by(|a, b| size(a).total_cmp(&size(b))) else { return };
        let norm = value.c[(largest, i)].norm();
        if norm == 0.0 {
            continue;
        }
        let phase = value.c[(largest, i)].unscale(norm);
        let lower = (i < pairs).then_some((own + i, phase.conj()));
        for (i, phase) in [(i, phase)].into_iter().chain(lower) {
            for part in slopes.iter_mut().chain([&mut *value]) {
                part.c.column_mut(i).iter_mut().for_each(|c| *c *= phase.conj());
                part.b.row_mut(i).iter_mut().for_each(|b| *b *= phase);
            }
            for slope in slopes.iter_mut() {
                let rate = C64::new(0.0, slope.c[(largest, i)].im / norm);
                slope.c.column_mut(i).iter_mut().zip(&value.c.column(i)).for_each(|(x, c)| *x -= rate * c);
                slope.b.row_mut(i).iter_mut().zip(&value.b.row(i)).for_each(|(x, b)| *x += rate * b);
            }
        }
    }
}

/// The weight of one pole, or of the pair whose upper one it is, among rows of sums, differences and real poles.
fn weigh(weights: &mut [f64], pairs: usize, i: usize, place: impl Fn(usize) -> usize, x: C64) {
    if i < pairs {
        weights[place(i)] = x.re;
        weights[place(pairs + i)] = x.im;
    } else {
        weights[place(pairs + i)] = x.re;
    }
}

impl Poles {
    pub fn new(modal: &Modal) -> Self {
        let mu = &modal.value.mu;
        let (n, np) = (mu.len(), modal.slopes.len());
        let those = |of: fn(f64) -> bool| (0..n).filter(move |i| of(mu[*i].im));
        let mut upper: Vec<usize> = those(|im| im > 0.0).collect();
        let mut real: Vec<usize> = those(|im| im == 0.0).collect();
        upper.sort_by(|i, j| mu[*i].im.total_cmp(&mu[*j].im));
        real.sort_by(|i, j| mu[*i].re.total_cmp(&mu[*j].re));
        let lower = |i: &usize| {
            let far = |j: &usize| (mu[*j] - mu[*i].conj()).norm();
            those(|im| im < 0.0).min_by(|a, b| far(a).total_cmp(&far(b))).expect("complex poles come as pairs")
        };
        let order: Vec<usize> = upper.iter().copied().chain(real).chain(upper.iter().map(lower)).collect();
        let mut value = reordered(&modal.value, &order);
        let mut all: Vec<Residues> = modal.slopes.iter().map(|slope| reordered(slope, &order)).collect();
        turn(&mut value, &mut all, upper.len());
        let (pairs, own) = (upper.len(), n - upper.len());
        let (nu, ny) = (value.b.ncols(), value.c.nrows());
        let columns = ny * (1 + np);
        let depth = n + nu + if np > 0 { n * (1 + nu) } else { 0 };
        let mut weights = vec![0.0; depth * columns];
        for o in 0..ny {
            let first = o * (1 + np);
            // of what stands at `from` on: sums and differences of pairs, then real poles
            let mut put = |from: usize, i: usize, column: usize, x: C64| {
                weigh(&mut weights[from * columns..], pairs, i, |row| row * columns + column, x);
            };
            for i in 0..own {
                let c = value.c[(o, i)];
                put(0, i, first, c);
                for (j, s) in all.iter().enumerate() {
                    let column = first + 1 + j;
                    put(0, i, column, s.c[(o, i)]);
                    put(n + nu, i, column, c * s.mu[i]);
                    (0..nu).for_each(|a| put(n * (2 + a) + nu, i, column, c * s.b[(i, a)]));
                }
            }
            for a in 0..nu {
                let row = (n + a) * columns;
                weights[row + first] = value.d[(o, a)];
                all.iter().enumerate().for_each(|(j, s)| weights[row + first + 1 + j] = s.d[(o, a)]);
            }
        }
        Self {
            pairs,
            reals: own - pairs,
            mu: value.mu.iter().copied().collect(),
            b: value.b.iter().copied().collect(),
            c: (0..ny * own).map(|k| value.c[(k / own, k % own)]).collect(),
            weights: Panels::new(depth, columns, &weights),
            value,
            depth,
            has_slopes: np > 0,
        }
    }

    /// Numbers of the transient: of pairs the real parts, then the imaginary ones; then those of real poles.
    pub fn states(&self) -> usize {
        2 * self.pairs + self.reals
    }

    /// The transient of every pole from its real numbers: `d_i = x + i y` of a pair, conjugate for the lower pole.
    fn by_pole(&self, d: &[f64]) -> Split {
        if d.is_empty() {
            return Split::zero(self.states());
        }
        let pairs = self.pairs;
        let upper = (0..pairs).map(|k| C64::new(d[k], d[pairs + k]));
        let reals = d[2 * pairs..].iter().map(|d| C64::from(*d));
        upper.clone().chain(reals).chain(upper.map(|d| d.conj())).collect()
    }

    pub fn run(&self, w: &[C64], u: &[C64], d: &[f64], block: &mut Block) {
        let (n, nu, ny) = (self.states(), self.value.b.ncols(), self.value.c.nrows());
        let d = self.by_pole(d);
        let padded = (2 * w.len()).next_multiple_of(ROW_MULTIPLE);
        block.rows.clear();
        block.rows.resize(padded * self.depth, 0.0);
        let basis = if block.with_basis { ny * n } else { 0 };
        block.basis.iter_mut().for_each(|part| part.resize(w.len() * basis, 0.0));
        let mut terms = Terms { f: Split::zero(n), p: Split::zero(n), g: Split::zero(n) };
        for (l, (w, u)) in w.iter().zip(u.chunks_exact(nu.max(1))).enumerate() {
            let row = &mut block.rows[2 * l * self.depth..][..2 * self.depth];
            let [re, im] = &mut block.basis;
            let own = l * basis..(l + 1) * basis;
            line(self, *w, u, &d, &mut terms, row, [&mut re[own.clone()], &mut im[own]]);
        }
        block.half = self.weights.stride;
        block.stride = 2 * block.half;
        block.columns.resize(padded * block.half, 0.0);
        product(&block.rows, padded, &self.weights, &mut block.columns);
    }

    /// Lines x outputs x inputs.
    pub fn transfer(&self, w: &[C64]) -> Result<Vec<C64>> {
        let Residues { b, c, d, .. } = &self.value;
        let ((ny, nu), n) = (d.shape(), self.states());
        let columns = ny * nu;
        let mut weights = vec![0.0; n * columns];
        for (i, o, a) in (0..(self.pairs + self.reals) * columns).map(|k| (k / columns, k / nu % ny, k % nu)) {
            weigh(&mut weights, self.pairs, i, |row| row * columns + o * nu + a, c[(o, i)] * b[(i, a)]);
        }
        let weights = Panels::new(n, columns, &weights);
        let padded = (2 * BLOCK).next_multiple_of(ROW_MULTIPLE);
        let mut rows = vec![0.0; padded * n];
        let mut sums = vec![0.0; padded * weights.stride];
        let mut f = Split::zero(n);
        let mut g = Vec::with_capacity(w.len() * columns);
        for w in w.chunks(BLOCK) {
            go_on()?;
            rows.chunks_exact_mut(2 * n.max(1)).zip(w).for_each(|(row, w)| factors(self, *w, &mut f, row));
            product(&rows, padded, &weights, &mut sums);
            for sums in sums.chunks_exact(2 * weights.stride).take(w.len()) {
                let (re, im) = sums.split_at(weights.stride);
                g.extend((0..columns).map(|k| C64::new(re[k] + d[(k / nu, k % nu)], im[k])));
            }
        }
        Ok(g)
    }

    /// `C A^k e`, see [`crate::ClosedLoop::free_response`].
    pub fn free_response(&self, d: &[f64], length: usize, samples: usize) -> Result<Vec<f64>> {
        let Residues { mu, c, .. } = &self.value;
        let (ny, root) = (c.nrows(), (length as f64).sqrt());
        let d = self.by_pole(d);
        let mut y = vec![0.0; samples * ny];
        for i in 0..self.pairs + self.reals {
            go_on()?;
            let count = if i < self.pairs { 2.0 } else { 1.0 };
            let over = C64::from(1.0) - mu[i].powu(length.min(1 << 30) as u32);
            let mut e = C64::new(d.re[i], d.im[i]) * root * count / over;
            let least = e.norm_sqr() * GONE;
            for y in y.chunks_exact_mut(ny) {
                (0..ny).for_each(|o| y[o] += c[(o, i)].re * e.re - c[(o, i)].im * e.im);
                e *= mu[i];
                if e.norm_sqr() <= least {
                    break;
                }
            }
        }
        Ok(y)
    }
}

/// What one line needs of every pole, for one line after the other.
struct Terms {
    f: Split,
    p: Split,
    g: Split,
}

impl Split {
    fn zero(n: usize) -> Self {
        Self { re: vec![0.0; n], im: vec![0.0; n] }
    }
}

/// `f` of one line, and its two rows of real and imaginary parts.
fn factors(of: &Poles, w: C64, f: &mut Split, row: &mut [f64]) {
    dispatch!(factors_any, (of: &Poles, w: C64, f: &mut Split, row: &mut [f64]));
}

#[inline(always)]
fn factors_any<const FMA: bool>(of: &Poles, w: C64, f: &mut Split, row: &mut [f64]) {
    inverses(of, w, f);
    let (re, im) = row.split_at_mut(of.states());
    fold(f, of.pairs, of.pairs + of.reals, re, im);
}

/// `f = 1 / (w - mu)`.
#[inline(always)]
fn inverses(of: &Poles, w: C64, f: &mut Split) {
    let n = of.states();
    let (mu_re, mu_im, re, im) = (&of.mu.re[..n], &of.mu.im[..n], &mut f.re[..n], &mut f.im[..n]);
    for i in 0..n {
        let (x, y) = (w.re - mu_re[i], w.im - mu_im[i]);
        let inverse = 1.0 / (x * x + y * y);
        (re[i], im[i]) = (x * inverse, -y * inverse);
    }
}

/// One line: its two rows of what is weighted, real parts and then imaginary ones, and, if there is room, its basis.
fn line(of: &Poles, w: C64, u: &[C64], d: &Split, terms: &mut Terms, row: &mut [f64], basis: [&mut [f64]; 2]) {
    dispatch!(
        line_any,
        (of: &Poles, w: C64, u: &[C64], d: &Split, terms: &mut Terms, row: &mut [f64], basis: [&mut [f64]; 2])
    );
}

#[inline(always)]
fn line_any<const FMA: bool>(
    of: &Poles,
    w: C64,
    u: &[C64],
    d: &Split,
    terms: &mut Terms,
    row: &mut [f64],
    basis: [&mut [f64]; 2],
) {
    let (n, pairs) = (of.states(), of.pairs);
    let own = pairs + of.reals;
    let Terms { f, p, g } = terms;
    let (row_re, row_im) = row.split_at_mut(of.depth);
    inverses(of, w, f);
    scaled(w, d, g);
    for (a, u) in u.iter().enumerate() {
        add_scaled(*u, &of.b.re[a * n..(a + 1) * n], &of.b.im[a * n..(a + 1) * n], g);
    }
    multiplied(f, g, p);
    fold(p, pairs, own, &mut row_re[..n], &mut row_im[..n]);
    if of.has_slopes {
        multiplied(f, p, g);
        let at = n + u.len();
        fold(g, pairs, own, &mut row_re[at..at + n], &mut row_im[at..at + n]);
        for (a, u) in u.iter().enumerate() {
            scaled(*u, f, g);
            let at = at + n * (1 + a);
            fold(g, pairs, own, &mut row_re[at..at + n], &mut row_im[at..at + n]);
        }
    }
    for (a, u) in u.iter().enumerate() {
        (row_re[n + a], row_im[n + a]) = (u.re, u.im);
    }
    if !basis[0].is_empty() {
        scaled(w, f, g);
        fold(g, pairs, own, &mut p.re, &mut p.im);
        weighted(of, p, basis);
    }
}

/// The basis of the transient from `w f` in the terms of the heading.
#[inline(always)]
fn weighted(of: &Poles, folded: &Split, [basis_re, basis_im]: [&mut [f64]; 2]) {
    let (n, pairs) = (of.states(), of.pairs);
    let own = pairs + of.reals;
    let outputs = of.c.re.chunks_exact(own).zip(of.c.im.chunks_exact(own));
    for ((c_re, c_im), (to_re, to_im)) in outputs.zip(basis_re.chunks_exact_mut(n).zip(basis_im.chunks_exact_mut(n))) {
        for (from, to) in [(&folded.re, to_re), (&folded.im, to_im)] {
            let (sum, difference) = (&from[..pairs], &from[pairs..2 * pairs]);
            let (real, rest) = to.split_at_mut(pairs);
            let (imaginary, reals) = rest.split_at_mut(pairs);
            let (re, im) = (&c_re[..pairs], &c_im[..pairs]);
            for k in 0..pairs {
                real[k] = re[k] * sum[k] + im[k] * difference[k];
                imaginary[k] = re[k] * difference[k] - im[k] * sum[k];
            }
            let rest = c_re[pairs..].iter().zip(&from[2 * pairs..]);
            reals.iter_mut().zip(rest).for_each(|(to, (c, from))| *to = c * from);
        }
    }
}

/// `g = z f`.
#[inline(always)]
fn scaled(z: C64, f: &Split, g: &mut Split) {
    let n = f.re.len();
    let (f_re, f_im, re, im) = (&f.re[..n], &f.im[..n], &mut g.re[..n], &mut g.im[..n]);
    for i in 0..n {
        re[i] = z.re * f_re[i] - z.im * f_im[i];
        im[i] = z.re * f_im[i] + z.im * f_re[i];
    }
}

/// `g += z b`.
#[inline(always)]
fn add_scaled(z: C64, b_re: &[f64], b_im: &[f64], g: &mut Split) {
    let n = b_re.len();
    let (b_im, re, im) = (&b_im[..n], &mut g.re[..n], &mut g.im[..n]);
    for i in 0..n {
        re[i] += z.re * b_re[i] - z.im * b_im[i];
        im[i] += z.re * b_im[i] + z.im * b_re[i];
    }
}

/// `p = f g`.
#[inline(always)]
fn multiplied(f: &Split, g: &Split, p: &mut Split) {
    let n = f.re.len();
    let (f_re, f_im, g_re, g_im) = (&f.re[..n], &f.im[..n], &g.re[..n], &g.im[..n]);
    let (re, im) = (&mut p.re[..n], &mut p.im[..n]);
    for i in 0..n {
        re[i] = f_re[i] * g_re[i] - f_im[i] * g_im[i];
        im[i] = f_re[i] * g_im[i] + f_im[i] * g_re[i];
    }
}

/// Sums and differences of pairs, then what real poles add, as in the module's heading.
#[inline(always)]
fn fold(g: &Split, pairs: usize, own: usize, re: &mut [f64], im: &mut [f64]) {
    let (up_re, up_im) = (&g.re[..pairs], &g.im[..pairs]);
    let (low_re, low_im) = (&g.re[own..own + pairs], &g.im[own..own + pairs]);
    let (sum_re, rest_re) = re.split_at_mut(pairs);
    let (sum_im, rest_im) = im.split_at_mut(pairs);
    let (turned_re, real_re) = rest_re.split_at_mut(pairs);
    let (turned_im, real_im) = rest_im.split_at_mut(pairs);
    for k in 0..pairs {
        (sum_re[k], sum_im[k]) = (up_re[k] + low_re[k], up_im[k] + low_im[k]);
        (turned_re[k], turned_im[k]) = (low_im[k] - up_im[k], up_re[k] - low_re[k]);
    }
    real_re.copy_from_slice(&g.re[pairs..own]);
    real_im.copy_from_slice(&g.im[pairs..own]);
}
