//! Solutions of `y (w I - T) = r` for a real T that is zero below the blocks on its diagonal, on a group of lines.

use nalgebra::{Complex, DMatrix};

use crate::instructions::dispatch;
use crate::product::{LANES, Vector, fma, load, store};

type C64 = Complex<f64>;

/// Lines that are worked on side by side.
pub const GROUP: usize = 12;
/// Vectors that are summed up side by side.
const TILE: usize = 6;

/// A block-triangular matrix, to be met from the left.
pub struct Triangular {
    n: usize,
    /// Column by column.
    t: Vec<f64>,
    /// First states of the blocks of one or two.
    blocks: Vec<usize>,
}

impl Triangular {
    /// `t` is zero below its first subdiagonal, where no two neighbours are other than zero.
    pub fn new(t: &DMatrix<f64>) -> Self {
        let n = t.nrows();
        let (mut blocks, mut next) = (Vec::with_capacity(n), 0);
        while next < n {
            blocks.push(next);
            next += if next + 1 < n && t[(next + 1, next)] != 0.0 { 2 } else { 1 };
        }
        Self { n, t: t.as_slice().to_vec(), blocks }
    }

    /// The same for `(w I - T) x = r`: `x` and `r` have their states in reverse.
    pub fn reversed(t: &DMatrix<f64>) -> Self {
        let n = t.nrows();
        Self::new(&DMatrix::from_fn(n, n, |i, j| t[(n - 1 - j, n - 1 - i)]))
    }

    /// Puts y in the place of r: states x right-hand sides x `[real, imaginary]` x [`GROUP`] lines.
    pub fn solve(&self, w: &[C64; GROUP], sides: usize, r: &mut [f64]) {
        solve(self, w, sides, r);
    }
}

fn solve(of: &Triangular, w: &[C64; GROUP], sides: usize, r: &mut [f64]) {
    dispatch!(solve_any, (of: &Triangular, w: &[C64; GROUP], sides: usize, r: &mut [f64]));
}

#[inline(always)]
fn solve_any<const FMA: bool>(of: &Triangular, w: &[C64; GROUP], sides: usize, r: &mut [f64]) {
    let (n, width) = (of.n, sides * 2 * GROUP);
    for (k, first) in of.blocks.iter().enumerate() {
        let (first, end) = (*first, of.blocks.get(k + 1).copied().unwrap_or(n));
        let (solved, own) = r.split_at_mut(first * width);
        for (column, own) in of.t[first * n..end * n].chunks_exact(n).zip(own.chunks_exact_mut(width)) {
            for at in (0..width).step_by(TILE * LANES) {
                let mut sum: [Vector; TILE] = std::array::from_fn(|v| load(own, at + v * LANES));
                for (t, y) in column[..first].iter().zip(solved.chunks_exact(width)) {
                    for (v, sum) in sum.iter_mut().enumerate() {
                        *sum = fma::<FMA>([*t; LANES], load(y, at + v * LANES), *sum);
                    }
                }
                sum.iter().enumerate().for_each(|(v, sum)| store(own, at + v * LANES, *sum));
            }
        }
        let t = |i: usize, j: usize| of.t[(first + j) * n + first + i];
        if end == first + 1 {
            let inverse = w.map(|w| (w - t(0, 0)).inv());
            for side in own[..width].chunks_exact_mut(2 * GROUP) {
                let (re, im) = side.split_at_mut(GROUP);
                for l in 0..GROUP {
                    (re[l], im[l]) = times(inverse[l], (re[l], im[l]));
                }
            }
            continue;
        }
        // [y0 y1] (w I - [a b; c d]) = [r0 r1]
        let (a, b, c, d) = (t(0, 0), t(0, 1), t(1, 0), t(1, 1));
        let inverse = w.map(|w| ((w - a) * (w - d) - b * c).inv());
        let (to_first, to_second) = (w.map(|w| w - d), w.map(|w| w - a));
        let (zeroth, other) = own[..2 * width].split_at_mut(width);
        for (r0, r1) in zeroth.chunks_exact_mut(2 * GROUP).zip(other.chunks_exact_mut(2 * GROUP)) {
            for l in 0..GROUP {
                let (x, y) = ((r0[l], r0[GROUP + l]), (r1[l], r1[GROUP + l]));
                let (own, its) = (times(to_first[l], x), times(to_second[l], y));
                (r0[l], r0[GROUP + l]) = times(inverse[l], (own.0 + c * y.0, own.1 + c * y.1));
                (r1[l], r1[GROUP + l]) = times(inverse[l], (its.0 + b * x.0, its.1 + b * x.1));
            }
        }
    }
}

#[inline(always)]
fn times(z: C64, (re, im): (f64, f64)) -> (f64, f64) {
    (z.re * re - z.im * im, z.re * im + z.im * re)
}
