//! Lines of a loop in modal form: sums over its poles.
//!
//! With `f_i = 1 / (w - mu_i)`, `s_i = w f_i d_i` and `p_i = f_i b_i u + s_i`,
//! `z = sum_i c_i p_i + D u` and `dz = sum_i (dc_i p_i + c_i f_i (db_i u + dmu_i p_i)) + dD u`.

use nalgebra::Complex;

use super::Block;
use crate::modal::{Modal, Residues};
use crate::product::{Panels, ROW_MULTIPLE, product};

type C64 = Complex<f64>;

/// Poles in the order of the transient's numbers, and the weights of what is summed.
pub struct Poles {
    value: Residues,
    /// Upper and lower pole of every pair, which has two numbers of the transient; then real ones, which have one.
    pairs: Vec<(usize, usize)>,
    reals: Vec<usize>,
    /// `[f_i u_a.., s_i.., f_i p_i.., u_a..]`, real parts and then imaginary ones, to columns, likewise.
    weights: Panels,
    depth: usize,
    has_slopes: bool,
}

impl Poles {
    pub fn new(modal: Modal) -> Self {
        let Modal { value, slopes } = modal;
        let (n, nu, ny, np) = (value.mu.len(), value.b.ncols(), value.c.nrows(), slopes.len());
        let columns = ny * (1 + np);
        let depth = n * (nu + 2) + nu;
        let mut weights = vec![0.0; 2 * depth * 2 * columns];
        let mut put = |row: usize, column: usize, x: C64| {
            let (own, other) = (row * 2 * columns, (depth + row) * 2 * columns);
            weights[own + column] = x.re;
            weights[own + columns + column] = x.im;
            weights[other + column] = -x.im;
            weights[other + columns + column] = x.re;
        };
        for o in 0..ny {
            let first = o * (1 + np);
            for i in 0..n {
                let c = value.c[(o, i)];
                put(n * nu + i, first, c);
                for a in 0..nu {
                    put(i * nu + a, first, c * value.b[(i, a)]);
                }
                for (j, s) in slopes.iter().enumerate() {
                    let column = first + 1 + j;
                    put(n * nu + i, column, s.c[(o, i)]);
                    put(n * (nu + 1) + i, column, c * s.mu[i]);
                    for a in 0..nu {
                        put(i * nu + a, column, s.c[(o, i)] * value.b[(i, a)] + c * s.b[(i, a)]);
                    }
                }
            }
            for a in 0..nu {
                put(n * (nu + 2) + a, first, C64::from(value.d[(o, a)]));
                for (j, s) in slopes.iter().enumerate() {
                    put(n * (nu + 2) + a, first + 1 + j, C64::from(s.d[(o, a)]));
                }
            }
        }
        let weights = Panels::new(2 * depth, 2 * columns, &weights);
        let mu = &value.mu;
        let lower = |i: usize| {
            let far = |j: &usize| (mu[*j] - mu[i].conj()).norm();
            let lower = (0..n).filter(|j| mu[*j].im < 0.0);
            lower.min_by(|a, b| far(a).total_cmp(&far(b))).expect("complex poles come as pairs")
        };
        let pairs = (0..n).filter(|i| mu[*i].im > 0.0).map(|i| (i, lower(i))).collect();
        let reals = (0..n).filter(|i| value.mu[*i].im == 0.0).collect();
        Self { value, pairs, reals, weights, depth, has_slopes: np > 0 }
    }

    /// Numbers of the transient.
    pub fn states(&self) -> usize {
        2 * self.pairs.len() + self.reals.len()
    }

    /// The transient of every pole from its real numbers: `d_i = x + i y` of a pair, conjugate for the lower pole.
    fn by_pole(&self, d: &[f64]) -> Vec<C64> {
        let mu = &self.value.mu;
        let mut own = vec![C64::from(0.0); mu.len()];
        if d.is_empty() {
            return own;
        }
        for (k, (upper, lower)) in self.pairs.iter().enumerate() {
            own[*upper] = C64::new(d[2 * k], d[2 * k + 1]);
            own[*lower] = own[*upper].conj();
        }
        for (k, i) in self.reals.iter().enumerate() {
            own[*i] = C64::from(d[2 * self.pairs.len() + k]);
        }
        own
    }

    pub fn run(&self, w: &[C64], u: &[C64], d: &[f64], block: &mut Block) {
        let Residues { mu, b, c, .. } = &self.value;
        let (n, nu, ny, states) = (mu.len(), b.ncols(), c.nrows(), self.states());
        let d = self.by_pole(d);
        let padded = w.len().next_multiple_of(ROW_MULTIPLE);
        let width = 2 * self.depth;
        let mut rows = vec![0.0; padded * width];
        block.basis.iter_mut().for_each(|part| {
            part.clear();
            part.resize(w.len() * ny * states, 0.0);
        });
        let mut f = vec![C64::from(0.0); n];
        for (l, (w, u)) in w.iter().zip(u.chunks_exact(nu)).enumerate() {
            let row = &mut rows[l * width..(l + 1) * width];
            let mut set = |at: usize, x: C64| (row[at], row[self.depth + at]) = (x.re, x.im);
            for i in 0..n {
                f[i] = (w - mu[i]).inv();
                let s = w * f[i] * d[i];
                let mut p = s;
                for (a, u) in u.iter().enumerate() {
                    let fu = f[i] * u;
                    p += b[(i, a)] * fu;
                    set(i * nu + a, fu);
                }
                set(n * nu + i, s);
                if self.has_slopes {
                    set(n * (nu + 1) + i, f[i] * p);
                }
            }
            u.iter().enumerate().for_each(|(a, u)| set(n * (nu + 2) + a, *u));
            let [re, im] = &mut block.basis;
            let wf = |i: usize| w * f[i];
            let upper: Vec<(C64, C64)> = self.pairs.iter().map(|(i, j)| (wf(*i), wf(*j))).collect();
            for o in 0..ny {
                let own = (l * ny + o) * states..(l * ny + o + 1) * states;
                let (re, im) = (&mut re[own.clone()], &mut im[own]);
                for (k, ((i, _), (upper, lower))) in self.pairs.iter().zip(&upper).enumerate() {
                    let (upper, lower) = (c[(o, *i)] * upper, c[(o, *i)].conj() * lower);
                    (re[2 * k], im[2 * k]) = (upper.re + lower.re, upper.im + lower.im);
                    (re[2 * k + 1], im[2 * k + 1]) = (lower.im - upper.im, upper.re - lower.re);
                }
                for (k, i) in self.reals.iter().enumerate() {
                    let x = c[(o, *i)] * wf(*i);
                    (re[2 * self.pairs.len() + k], im[2 * self.pairs.len() + k]) = (x.re, x.im);
                }
            }
        }
        block.stride = self.weights.stride;
        block.columns.resize(padded * block.stride, 0.0);
        product(&rows, w.len(), &self.weights, &mut block.columns);
    }

    /// Outputs x inputs at a point, row by row.
    pub fn transfer(&self, w: C64) -> Vec<C64> {
        let Residues { mu, b, c, d } = &self.value;
        let (ny, nu) = d.shape();
        let mut g: Vec<C64> = (0..ny * nu).map(|k| C64::from(d[(k / nu, k % nu)])).collect();
        for (i, mu) in mu.iter().enumerate() {
            let f = (w - mu).inv();
            for a in 0..nu {
                let fb = f * b[(i, a)];
                (0..ny).for_each(|o| g[o * nu + a] += c[(o, i)] * fb);
            }
        }
        g
    }

    /// `C A^k e`, see [`crate::ClosedLoop::free_response`].
    pub fn free_response(&self, d: &[f64], length: usize, samples: usize) -> Vec<f64> {
        let Residues { mu, c, .. } = &self.value;
        let (ny, root) = (c.nrows(), (length as f64).sqrt());
        let d = self.by_pole(d);
        let mut y = vec![0.0; samples * ny];
        let upper = self.pairs.iter().map(|(i, _)| (*i, 2.0)).chain(self.reals.iter().map(|i| (*i, 1.0)));
        for (i, count) in upper {
            let mut e = d[i] * root * count / (C64::from(1.0) - mu[i].powu(length.min(1 << 30) as u32));
            for y in y.chunks_exact_mut(ny) {
                (0..ny).for_each(|o| y[o] += c[(o, i)].re * e.re - c[(o, i)].im * e.im);
                e *= mu[i];
                if e.norm_sqr() < f64::MIN_POSITIVE {
                    break;
                }
            }
        }
        y
    }
}
