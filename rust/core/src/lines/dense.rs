//! Lines of a loop whose poles are too clustered for a modal form: elimination in Hessenberg form, line by line.
//!
//! With `M = w I - A`, `x = M^-1 (B u + w d)` and `Y = C M^-1`: `z = C x + D u`, `dz = Y (dA x + dB u) + dC x + dD u`,
//! and the basis of the transient is `w Y`.

use nalgebra::{Complex, DMatrix, DVector};

use super::Block;
use crate::discretise::Discrete;
use crate::error::{Error, Result};
use crate::lft::balancing;

type C64 = Complex<f64>;

/// A loop whose A is zero below its first subdiagonal.
pub struct Hessenberg {
    value: Discrete,
    slopes: Vec<Discrete>,
}

impl Hessenberg {
    pub fn new(mut value: Discrete, mut slopes: Vec<Discrete>) -> Self {
        let t = balancing(&value.a);
        let n = t.len();
        value.rescale(&t);
        slopes.iter_mut().for_each(|slope| slope.rescale(&t));
        if n > 1 {
            let (q, h) = value.a.clone().hessenberg().unpack();
            let turn = |m: &mut Discrete| {
                m.a = q.tr_mul(&m.a) * &q;
                m.b = q.tr_mul(&m.b);
                m.c = &m.c * &q;
            };
            slopes.iter_mut().for_each(turn);
            turn(&mut value);
            value.a = h;
        }
        Self { value, slopes }
    }

    pub fn states(&self) -> usize {
        self.value.a.nrows()
    }

    pub fn run(&self, w: &[C64], u: &[C64], d: &[f64], block: &mut Block) {
        let Discrete { a, b, c, d: through } = &self.value;
        let (n, nu, ny, np) = (a.nrows(), b.ncols(), c.nrows(), self.slopes.len());
        let half = ny * (1 + np);
        block.stride = 2 * half;
        block.columns.clear();
        block.columns.resize(w.len() * block.stride, 0.0);
        block.basis.iter_mut().for_each(|part| {
            part.clear();
            part.resize(w.len() * ny * n, 0.0);
        });
        for (l, (w, u)) in w.iter().zip(u.chunks_exact(nu)).enumerate() {
            let u = DVector::from_column_slice(u);
            let eliminated = Eliminated::new(a, *w);
            let mut x = times(b, &u);
            d.iter().enumerate().for_each(|(i, d)| x[i] += w * d);
            eliminated.solve(x.as_mut_slice());
            let mut y = c.transpose().map(C64::from);
            y.column_iter_mut().for_each(|mut row| eliminated.solve_transposed(row.as_mut_slice()));
            let z = times(c, &x) + times(through, &u);
            let row = &mut block.columns[l * block.stride..][..block.stride];
            let mut put = |k: usize, x: C64| (row[k], row[half + k]) = (x.re, x.im);
            (0..ny).for_each(|o| put(o * (1 + np), z[o]));
            for (j, s) in self.slopes.iter().enumerate() {
                let forced = times(&s.a, &x) + times(&s.b, &u);
                let dz = y.tr_mul(&forced) + times(&s.c, &x) + times(&s.d, &u);
                (0..ny).for_each(|o| put(o * (1 + np) + 1 + j, dz[o]));
            }
            for o in 0..ny {
                for i in 0..n {
                    let t = w * y[(i, o)];
                    let at = (l * ny + o) * n + i;
                    (block.basis[0][at], block.basis[1][at]) = (t.re, t.im);
                }
            }
        }
    }

    /// Outputs x inputs at a point, row by row.
    pub fn transfer(&self, w: C64) -> Vec<C64> {
        let Discrete { a, b, c, d } = &self.value;
        let eliminated = Eliminated::new(a, w);
        let mut x = b.map(C64::from);
        x.column_iter_mut().for_each(|mut column| eliminated.solve(column.as_mut_slice()));
        let g = c.map(C64::from) * x + d.map(C64::from);
        g.transpose().as_slice().to_vec()
    }

    /// `C A^k e`, see [`crate::ClosedLoop::free_response`].
    pub fn free_response(&self, d: &[f64], length: usize, samples: usize) -> Result<Vec<f64>> {
        let Discrete { a, c, .. } = &self.value;
        let n = a.nrows();
        let (mut over, mut power, mut left) = (DMatrix::identity(n, n), a.clone(), length);
        while left > 0 {
            if left % 2 == 1 {
                over = &over * &power;
            }
            power = &power * &power;
            left /= 2;
        }
        let open = (DMatrix::identity(n, n) - over).lu();
        let start = DVector::from_column_slice(d) * (length as f64).sqrt();
        let mut x = open.solve(&start).ok_or(Error::Singular { what: "a transient that never decays" })?;
        let mut y = Vec::with_capacity(samples * c.nrows());
        for _ in 0..samples {
            y.extend((c * &x).iter());
            x = a * x;
        }
        Ok(y)
    }
}

fn times(m: &DMatrix<f64>, x: &DVector<C64>) -> DVector<C64> {
    let (re, im) = (x.map(|x| x.re), x.map(|x| x.im));
    (m * re).zip_map(&(m * im), C64::new)
}

/// `P (w I - H) = L U` with exchanges of neighbouring rows only.
struct Eliminated {
    /// U, column by column.
    upper: DMatrix<C64>,
    factors: Vec<C64>,
    exchanged: Vec<bool>,
}

impl Eliminated {
    fn new(h: &DMatrix<f64>, w: C64) -> Self {
        let n = h.nrows();
        let mut m = h.map(|x| C64::from(-x));
        (0..n).for_each(|i| m[(i, i)] += w);
        let (mut factors, mut exchanged) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for k in 0..n.saturating_sub(1) {
            let exchange = m[(k + 1, k)].norm_sqr() > m[(k, k)].norm_sqr();
            if exchange {
                (k..n).for_each(|j| m.swap((k, j), (k + 1, j)));
            }
            let factor = if m[(k, k)] == C64::from(0.0) { C64::from(0.0) } else { m[(k + 1, k)] / m[(k, k)] };
            for j in k..n {
                let above = m[(k, j)];
                m[(k + 1, j)] -= factor * above;
            }
            factors.push(factor);
            exchanged.push(exchange);
        }
        Self { upper: m, factors, exchanged }
    }

    fn solve(&self, x: &mut [C64]) {
        for (k, (factor, exchanged)) in self.factors.iter().zip(&self.exchanged).enumerate() {
            if *exchanged {
                x.swap(k, k + 1);
            }
            let above = x[k];
            x[k + 1] -= factor * above;
        }
        for j in (0..x.len()).rev() {
            x[j] /= self.upper[(j, j)];
            let own = x[j];
            for (x, u) in x[..j].iter_mut().zip(self.upper.column(j).iter()) {
                *x -= u * own;
            }
        }
    }

    /// Solves `(w I - H)^T y = c`.
    fn solve_transposed(&self, y: &mut [C64]) {
        for j in 0..y.len() {
            let column = self.upper.column(j);
            let sum: C64 = column.iter().zip(&y[..j]).map(|(u, y)| u * y).sum();
            y[j] = (y[j] - sum) / column[j];
        }
        for (k, (factor, exchanged)) in self.factors.iter().zip(&self.exchanged).enumerate().rev() {
            let below = y[k + 1];
            y[k] -= factor * below;
            if *exchanged {
                y.swap(k, k + 1);
            }
        }
    }
}
