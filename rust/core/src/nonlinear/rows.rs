//! A few rows times a matrix to their right: the value and its derivatives share the weights that are loaded.

use nalgebra::DMatrix;

use crate::instructions::dispatch;
use crate::product::{LANES, Vector, fma, load, store};

/// A matrix to the right of rows, row by row, its columns filled up to whole vectors.
#[derive(Debug, Clone)]
pub struct Weights {
    depth: usize,
    pub columns: usize,
    values: Vec<f64>,
}

impl Weights {
    /// The transposes of `parts`, which have `depth` columns, beside each other, each filled up to whole vectors.
    pub fn new(depth: usize, parts: &[DMatrix<f64>]) -> Self {
        let heights = parts.iter().map(|p| p.nrows().next_multiple_of(LANES));
        let columns = heights.clone().sum();
        let mut stacked = DMatrix::zeros(columns, depth);
        let mut at = 0;
        for (part, height) in parts.iter().zip(heights) {
            stacked.rows_mut(at, part.nrows()).copy_from(part);
            at += height;
        }
        Self { depth, columns, values: stacked.as_slice().to_vec() }
    }

    /// What meets the place `i` of a row.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.columns..][..self.columns]
    }
}

/// Rows that stand a stride apart.
type Rows<'a> = (&'a [f64], usize);
type RowsMut<'a> = (&'a mut [f64], usize);

/// `out[row] += left[row] weights` in the first `columns` of so many rows.
///
/// Chooses its instructions itself: made part of each of its many callers it takes minutes to compile.
pub fn accumulate(rows: usize, left: Rows, weights: &Weights, out: RowsMut, columns: usize) {
    dispatch!(accumulate_any, (rows: usize, left: Rows, weights: &Weights, out: RowsMut, columns: usize));
}

#[inline(always)]
fn accumulate_any<const FMA: bool>(
    rows: usize,
    (left, left_stride): Rows,
    weights: &Weights,
    (out, stride): RowsMut,
    columns: usize,
) {
    let mut row = 0;
    while row < rows {
        let left = (&left[row * left_stride..], left_stride);
        let out = (&mut out[row * stride..], stride);
        row += match rows - row {
            1 => band::<FMA, 1, 4>(left, weights, out, columns),
            2 | 3 => band::<FMA, 2, 4>(left, weights, out, columns),
            _ => band::<FMA, 4, 2>(left, weights, out, columns),
        };
    }
}

/// `out += factor row`, both in whole vectors.
#[inline(always)]
pub fn add<const FMA: bool>(factor: f64, row: &[f64], out: &mut [f64]) {
    for (out, row) in out.chunks_exact_mut(LANES).zip(row.chunks_exact(LANES)) {
        store(out, 0, fma::<FMA>([factor; LANES], load(row, 0), load(out, 0)));
    }
}

/// The first R rows, which is returned; V vectors of columns at a time stay in registers.
#[inline(always)]
fn band<const FMA: bool, const R: usize, const V: usize>(
    (left, left_stride): (&[f64], usize),
    weights: &Weights,
    (out, stride): (&mut [f64], usize),
    columns: usize,
) -> usize {
    // loops, here and below: what is called in closures is not compiled for FMA
    let mut lines = [&left[..0]; R];
    for (r, line) in lines.iter_mut().enumerate() {
        *line = &left[r * left_stride..][..weights.depth];
    }
    let mut at = 0;
    while columns - at >= V * LANES {
        tile::<FMA, R, V>(lines, weights, (out, stride), at);
        at += V * LANES;
    }
    match (columns - at) / LANES {
        3 => tile::<FMA, R, 3>(lines, weights, (out, stride), at),
        2 => tile::<FMA, R, 2>(lines, weights, (out, stride), at),
        1 => tile::<FMA, R, 1>(lines, weights, (out, stride), at),
        _ => {}
    }
    R
}

#[inline(always)]
fn tile<const FMA: bool, const R: usize, const V: usize>(
    left: [&[f64]; R],
    weights: &Weights,
    (out, stride): (&mut [f64], usize),
    at: usize,
) {
    let mut sum = [[[0.0; LANES]; V]; R];
    for (r, sum) in sum.iter_mut().enumerate() {
        for (v, sum) in sum.iter_mut().enumerate() {
            *sum = load(out, r * stride + at + v * LANES);
        }
    }
    let (mut i, mut place) = (0, at);
    while i < weights.depth {
        let row = &weights.values[place..place + V * LANES];
        let mut meets: [Vector; V] = [[0.0; LANES]; V];
        for (v, meets) in meets.iter_mut().enumerate() {
            *meets = load(row, v * LANES);
        }
        for r in 0..R {
            for v in 0..V {
                sum[r][v] = fma::<FMA>([left[r][i]; LANES], meets[v], sum[r][v]);
            }
        }
        (i, place) = (i + 1, place + weights.columns);
    }
    for (r, sum) in sum.into_iter().enumerate() {
        for (v, sum) in sum.into_iter().enumerate() {
            store(out, r * stride + at + v * LANES, sum);
        }
    }
}
