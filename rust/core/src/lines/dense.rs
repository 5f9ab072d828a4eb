//! Lines of a loop whose poles are too clustered for a modal form: elimination in Schur form, a group of lines at a time.
//!
//! With `M = w I - A`, `x = M^-1 (B u + w d)` and `Y = C M^-1`: `z = C x + D u`, `dz = Y (dA x + dB u) + dC x + dD u`,
//! and the basis of the transient is `w Y`. A transient has the states of the loop: other than those of the Schur
//! form they change smoothly with the parameters, so that it is near that of other parameters.

use nalgebra::linalg::Schur;
use nalgebra::{Complex, DMatrix, DVector};

use super::Block;
use super::triangular::{GROUP, Triangular};
use crate::discretise::Discrete;
use crate::eigen::{NOT_CONVERGED, reflected, reflection};
use crate::error::{Error, Result};
use crate::instructions::dispatch;
use crate::lft::balancing;
use crate::product::{LANES, Panels, Vector, fma, load, product, store};
use crate::stop::go_on;

type C64 = Complex<f64>;

/// Iterations per state after which a Schur form is given up, as LAPACK does.
const ITERATIONS: usize = 30;
/// How many roundings of the diagonal count as zero beside it: what does not converge with one does so with a few.
const LOOSE: [f64; 4] = [1.0, 8.0, 64.0, 512.0];

/// Orthogonal states, as columns, and the matrix in them; `None` where its poles do not converge.
fn schur(a: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let found = |loose: &f64| Schur::try_new(a.clone(), loose * f64::EPSILON, ITERATIONS * a.nrows());
    LOOSE.iter().find_map(found).map(Schur::unpack)
}

/// A loop in states in which its A is triangular but for blocks of two on the diagonal.
pub struct Dense {
    value: Discrete,
    /// These states times it are the (balanced) ones of the loop.
    q: DMatrix<f64>,
    left: Triangular,
    right: Triangular,
    parameters: usize,
    /// `[x | u]` to `[0, dA_j x + dB_j u ..]` of every state, then `[C x + D u, dC_j x + dD_j u ..]` of every output;
    /// each takes `width` columns. Without parameters there is nothing of the states.
    forcing: Panels,
    width: usize,
}

impl Dense {
    /// # Errors
    /// [`Error::Singular`] where the poles do not converge.
    pub fn new(mut value: Discrete, mut slopes: Vec<Discrete>) -> Result<Self> {
        let t = balancing(&value.a);
        value.rescale(&t);
        slopes.iter_mut().for_each(|slope| slope.rescale(&t));
        let (n, nu, ny) = (t.len(), value.b.ncols(), value.c.nrows());
        let mut q = DMatrix::identity(n, n);
        if n > 1 {
            let (turned, a) = schur(&value.a)
                .or_else(|| {
                    let (turned, a) = schur(&reflected(&value.a))?;
                    Some((reflection(n) * turned, a))
                })
                .ok_or(Error::Singular { what: NOT_CONVERGED })?;
            q = turned;
            let turn = |m: &mut Discrete| {
                m.a = q.tr_mul(&m.a) * &q;
                m.b = q.tr_mul(&m.b);
                m.c = &m.c * &q;
            };
            slopes.iter_mut().for_each(turn);
            turn(&mut value);
            value.a = a;
        }
        let width = (1 + slopes.len()).next_multiple_of(LANES);
        let states = if slopes.is_empty() { 0 } else { n };
        let columns = (states + ny) * width;
        let mut forcing = vec![0.0; (n + nu) * columns];
        let mut put = |j: usize, of: &Discrete, from: usize| {
            let all = of.stacked();
            for (i, row) in all.row_iter().enumerate().skip(from) {
                let at = (i + states - n) * width + j;
                row.iter().enumerate().for_each(|(k, x)| forcing[k * columns + at] = *x);
            }
        };
        put(0, &value, n);
        slopes.iter().enumerate().for_each(|(j, slope)| put(1 + j, slope, 0));
        let forcing = Panels::new(n + nu, columns, &forcing);
        let (left, right) = (Triangular::new(&value.a), Triangular::reversed(&value.a));
        Ok(Self { value, q, left, right, parameters: slopes.len(), forcing, width })
    }

    pub fn states(&self) -> usize {
        self.value.a.nrows()
    }

    /// At most [`GROUP`] points, filled up with one that is no pole.
    fn group(w: &[C64]) -> [C64; GROUP] {
        std::array::from_fn(|l| w.get(l).copied().unwrap_or(C64::from(2.0)))
    }

    /// `Y` on a group of lines: states x outputs x `[real, imaginary]` x lines.
    fn left(&self, w: &[C64; GROUP], y: &mut [f64]) {
        let c = &self.value.c;
        for (place, y) in y.chunks_exact_mut(2 * GROUP).enumerate() {
            y[..GROUP].fill(c[(place % c.nrows(), place / c.nrows())]);
            y[GROUP..].fill(0.0);
        }
        self.left.solve(w, c.nrows(), y);
    }

    /// Takes a transient, or a row of the basis, from the states of the Schur form to those of the loop.
    pub fn of_loop(&self, x: &mut [f64]) {
        let turned = &self.q * DVector::from_column_slice(x);
        x.copy_from_slice(turned.as_slice());
    }

    /// A transient in the states of the Schur form.
    fn turned(&self, d: &[f64]) -> Vec<f64> {
        if d.is_empty() { vec![] } else { self.q.tr_mul(&DVector::from_column_slice(d)).as_slice().to_vec() }
    }

    pub fn run(&self, w: &[C64], u: &[C64], d: &[f64], block: &mut Block) {
        let Discrete { a, b, c, .. } = &self.value;
        let (n, nu, ny, np) = (a.nrows(), b.ncols(), c.nrows(), self.parameters);
        let (half, width) = (ny * (1 + np), self.width);
        (block.half, block.stride) = (half, 2 * half);
        block.columns.resize(w.len() * block.stride, 0.0);
        let basis = if block.with_basis { w.len() * ny * n } else { 0 };
        block.basis.iter_mut().for_each(|part| part.resize(basis, 0.0));
        let d = self.turned(d);
        let depth = n + nu;
        let mut y = vec![0.0; n * ny * 2 * GROUP];
        let mut x = vec![0.0; n * 2 * GROUP];
        let mut rows = vec![0.0; 2 * GROUP * depth];
        let mut forced = vec![0.0; 2 * GROUP * self.forcing.stride];
        let mut sums = vec![0.0; GROUP * ny * 2 * width];
        let sizes = Sizes { states: if np == 0 { 0 } else { n }, outputs: ny, width };
        for (g, (w, u)) in w.chunks(GROUP).zip(u.chunks(GROUP * nu)).enumerate() {
            let points = Self::group(w);
            if np > 0 || basis > 0 {
                self.left(&points, &mut y);
            }
            for (i, x) in x.chunks_exact_mut(2 * GROUP).enumerate() {
                let state = n - 1 - i;
                for (l, w) in w.iter().enumerate() {
                    let own = d.get(state).map_or(C64::from(0.0), |d| w * d);
                    let forced = (0..nu).fold(own, |sum, j| sum + u[l * nu + j] * b[(state, j)]);
                    (x[l], x[GROUP + l]) = (forced.re, forced.im);
                }
            }
            self.right.solve(&points, 1, &mut x);
            for l in 0..w.len() {
                for (side, row) in [l, GROUP + l].into_iter().enumerate() {
                    let row = &mut rows[row * depth..(row + 1) * depth];
                    (0..n).for_each(|i| row[i] = x[(2 * (n - 1 - i) + side) * GROUP + l]);
                    let u = &u[l * nu..(l + 1) * nu];
                    (0..nu).for_each(|j| row[n + j] = if side == 0 { u[j].re } else { u[j].im });
                }
            }
            product(&rows, 2 * GROUP, &self.forcing, &mut forced);
            contract(&y, &forced, &sizes, &mut sums);
            for (l, w) in w.iter().enumerate() {
                let line = g * GROUP + l;
                let row = &mut block.columns[line * block.stride..][..block.stride];
                for (o, sums) in sums[l * ny * 2 * width..].chunks_exact(2 * width).take(ny).enumerate() {
                    row[o * (1 + np)..][..1 + np].copy_from_slice(&sums[..1 + np]);
                    row[half + o * (1 + np)..][..1 + np].copy_from_slice(&sums[width..][..1 + np]);
                    if basis == 0 {
                        continue;
                    }
                    let at = (line * ny + o) * n;
                    let [re, im] = &mut block.basis;
                    let own = re[at..at + n].iter_mut().zip(&mut im[at..at + n]);
                    for ((re, im), y) in own.zip(y.chunks_exact(2 * ny * GROUP)) {
                        let (y_re, y_im) = (y[2 * o * GROUP + l], y[(2 * o + 1) * GROUP + l]);
                        *re = w.re * y_re - w.im * y_im;
                        *im = w.re * y_im + w.im * y_re;
                    }
                }
            }
        }
    }

    /// Lines x outputs x inputs.
    pub fn transfer(&self, w: &[C64]) -> Result<Vec<C64>> {
        let Discrete { b, c, d, .. } = &self.value;
        let (n, nu, ny) = (self.states(), b.ncols(), c.nrows());
        let mut y = vec![0.0; n * ny * 2 * GROUP];
        let mut g = Vec::with_capacity(w.len() * ny * nu);
        for w in w.chunks(GROUP) {
            go_on()?;
            self.left(&Self::group(w), &mut y);
            for (l, o, a) in (0..w.len() * ny * nu).map(|k| (k / nu / ny, k / nu % ny, k % nu)) {
                let y = |i: usize| C64::new(y[2 * (i * ny + o) * GROUP + l], y[(2 * (i * ny + o) + 1) * GROUP + l]);
                g.push((0..n).fold(C64::from(d[(o, a)]), |sum, i| sum + y(i) * b[(i, a)]));
            }
        }
        Ok(g)
    }

    /// `C A^k e`, see [`crate::ClosedLoop::free_response`].
    pub fn free_response(&self, d: &[f64], length: usize, samples: usize) -> Result<Vec<f64>> {
        let Discrete { a, c, .. } = &self.value;
        let n = a.nrows();
        if n == 0 {
            return Ok(vec![0.0; samples * c.nrows()]);
        }
        let (mut over, mut power, mut left) = (DMatrix::identity(n, n), a.clone(), length);
        while left > 0 {
            if left % 2 == 1 {
                over = &over * &power;
            }
            power = &power * &power;
            left /= 2;
        }
        let open = (DMatrix::identity(n, n) - over).lu();
        let start = DVector::from_vec(self.turned(d)) * (length as f64).sqrt();
        let mut x = open.solve(&start).ok_or(Error::Singular { what: "a transient that never decays" })?;
        let mut y = Vec::with_capacity(samples * c.nrows());
        for _ in 0..samples {
            go_on()?;
            y.extend((c * &x).iter());
            x = a * x;
        }
        Ok(y)
    }
}

/// Sizes of what [`contract`] sums over.
struct Sizes {
    states: usize,
    outputs: usize,
    width: usize,
}

/// On a group of lines, `sum_i Y_oi F_i + F_o` over those states that `forced` has, F_o standing behind them.
///
/// `y` is states x outputs x `[real, imaginary]` x lines; `forced` is `[real, imaginary]` x lines x states and outputs
/// x `width`; `sums` is lines x outputs x `[real, imaginary]` x `width`.
fn contract(y: &[f64], forced: &[f64], sizes: &Sizes, sums: &mut [f64]) {
    dispatch!(contract_any, (y: &[f64], forced: &[f64], sizes: &Sizes, sums: &mut [f64]));
}

/// Outputs that are summed up side by side.
const TOGETHER: usize = 4;

#[inline(always)]
fn contract_any<const FMA: bool>(y: &[f64], forced: &[f64], sizes: &Sizes, sums: &mut [f64]) {
    let Sizes { states, outputs, width } = *sizes;
    let (re, im) = forced.split_at(forced.len() / 2);
    let stride = (states + outputs) * width;
    let lines = re.chunks_exact(stride).zip(im.chunks_exact(stride)).zip(sums.chunks_exact_mut(outputs * 2 * width));
    for (l, ((re, im), sums)) in lines.enumerate() {
        for at in (0..width).step_by(LANES) {
            for first in (0..outputs).step_by(TOGETHER) {
                let all: [usize; TOGETHER] = std::array::from_fn(|k| (first + k).min(outputs - 1));
                let mut sum: [[Vector; 2]; TOGETHER] =
                    all.map(|o| [re, im].map(|part| load(part, (states + o) * width + at)));
                let states = re.chunks_exact(width).zip(im.chunks_exact(width)).take(states);
                for ((re, im), y) in states.zip(y.chunks_exact(outputs * 2 * GROUP)) {
                    let (re, im) = (load(re, at), load(im, at));
                    for (o, sum) in all.iter().zip(&mut sum) {
                        let (y_re, y_im) = (y[2 * o * GROUP + l], y[(2 * o + 1) * GROUP + l]);
                        sum[0] = fma::<FMA>([y_re; LANES], re, fma::<FMA>([-y_im; LANES], im, sum[0]));
                        sum[1] = fma::<FMA>([y_re; LANES], im, fma::<FMA>([y_im; LANES], re, sum[1]));
                    }
                }
                for (o, sum) in all.iter().zip(sum) {
                    store(sums, 2 * o * width + at, sum[0]);
                    store(sums, (2 * o + 1) * width + at, sum[1]);
                }
            }
        }
    }
}
