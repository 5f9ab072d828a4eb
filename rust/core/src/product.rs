//! A small dense matrix product held in registers.

use crate::instructions::dispatch;

/// Lanes of the vectors that the code is written in.
pub const LANES: usize = 4;
/// Four numbers that fit one vector register.
pub type Vector = [f64; LANES];
/// Columns that are kept in registers.
const PANEL: usize = 12;
/// Rows are processed in groups whose sizes (3, 4, 6) divide this number.
pub const ROW_MULTIPLE: usize = 12;

/// The right-hand factor of a product, packed by panels of columns; columns are filled up to whole vectors.
#[derive(Debug, Clone)]
pub struct Panels {
    depth: usize,
    pub stride: usize,
    packed: Vec<f64>,
}

impl Panels {
    /// Packs a matrix given row by row.
    pub fn new(depth: usize, columns: usize, matrix: &[f64]) -> Self {
        let stride = columns.next_multiple_of(LANES);
        let mut packed = Vec::with_capacity(depth * stride);
        for (first, width) in panel_widths(stride) {
            for row in matrix.chunks_exact(columns.max(1)).take(depth) {
                packed.extend((first..first + width).map(|c| row.get(c).copied().unwrap_or(0.0)));
            }
        }
        Self { depth, stride, packed }
    }
}

/// `out[rows x stride] = left[rows x depth] right`; `left` has its rows filled up to [`ROW_MULTIPLE`].
pub fn product(left: &[f64], rows: usize, right: &Panels, out: &mut [f64]) {
    dispatch!(product_any, (left: &[f64], rows: usize, right: &Panels, out: &mut [f64]));
}

#[inline(always)]
fn product_any<const FMA: bool>(left: &[f64], rows: usize, right: &Panels, out: &mut [f64]) {
    let mut panels = &right.packed[..];
    for (at, width) in panel_widths(right.stride) {
        let (panel, rest) = panels.split_at(right.depth * width);
        panels = rest;
        match width {
            12 => tiles::<FMA, 3, 3>(left, rows, right, panel, at, out),
            8 => tiles::<FMA, 4, 2>(left, rows, right, panel, at, out),
            _ => tiles::<FMA, 6, 1>(left, rows, right, panel, at, out),
        }
    }
}

fn panel_widths(stride: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..stride).step_by(PANEL).map(move |at| (at, PANEL.min(stride - at)))
}

/// One panel: R rows by V vectors of columns at a time stay in registers.
#[inline(always)]
fn tiles<const FMA: bool, const R: usize, const V: usize>(
    left: &[f64],
    rows: usize,
    right: &Panels,
    panel: &[f64],
    at: usize,
    out: &mut [f64],
) {
    let (depth, stride) = (right.depth, right.stride);
    for row in (0..rows).step_by(R) {
        let lines: [&[f64]; R] = std::array::from_fn(|r| &left[(row + r) * depth..][..depth]);
        let mut sum = [[[0.0; LANES]; V]; R];
        for (l, weights) in panel.chunks_exact(V * LANES).take(depth).enumerate() {
            let weights: [Vector; V] = std::array::from_fn(|v| load(weights, v * LANES));
            for r in 0..R {
                for v in 0..V {
                    sum[r][v] = fma::<FMA>([lines[r][l]; LANES], weights[v], sum[r][v]);
                }
            }
        }
        for (r, sum) in sum.iter().enumerate() {
            out[(row + r) * stride + at..][..V * LANES].copy_from_slice(sum.as_flattened());
        }
    }
}

/// `sum[stride x stride] += rows' rows`, upper part (and whatever shares a tile with it).
pub fn add_gram(rows: &[f64], stride: usize, sum: &mut [f64]) {
    dispatch!(add_gram_any, (rows: &[f64], stride: usize, sum: &mut [f64]));
}

#[inline(always)]
fn add_gram_any<const FMA: bool>(rows: &[f64], stride: usize, sum: &mut [f64]) {
    for i in (0..stride).step_by(LANES) {
        let mut j = i;
        while j < stride {
            if stride - j >= 2 * LANES {
                gram_tile::<FMA, 2>(rows, stride, i, j, sum);
                j += 2 * LANES;
            } else {
                gram_tile::<FMA, 1>(rows, stride, i, j, sum);
                j += LANES;
            }
        }
    }
}

#[inline(always)]
fn gram_tile<const FMA: bool, const V: usize>(rows: &[f64], stride: usize, i: usize, j: usize, sum: &mut [f64]) {
    let mut tile = [[[0.0; LANES]; V]; LANES];
    for row in rows.chunks_exact(stride) {
        let left = load(row, i);
        let right: [Vector; V] = std::array::from_fn(|v| load(row, j + v * LANES));
        for r in 0..LANES {
            for v in 0..V {
                tile[r][v] = fma::<FMA>([left[r]; LANES], right[v], tile[r][v]);
            }
        }
    }
    for (r, tile) in tile.iter().enumerate() {
        for (sum, tile) in sum[(i + r) * stride + j..].iter_mut().zip(tile.as_flattened()) {
            *sum += tile;
        }
    }
}

/// `sum[stride] += weights' rows`.
pub fn add_weighted(rows: &[f64], stride: usize, weights: &[f64], sum: &mut [f64]) {
    dispatch!(add_weighted_any, (rows: &[f64], stride: usize, weights: &[f64], sum: &mut [f64]));
}

#[inline(always)]
fn add_weighted_any<const FMA: bool>(rows: &[f64], stride: usize, weights: &[f64], sum: &mut [f64]) {
    for at in (0..stride).step_by(LANES) {
        let mut total = load(sum, at);
        for (row, weight) in rows.chunks_exact(stride).zip(weights) {
            total = fma::<FMA>(load(row, at), [*weight; LANES], total);
        }
        store(sum, at, total);
    }
}

#[inline(always)]
pub fn load(row: &[f64], at: usize) -> Vector {
    row[at..at + LANES].try_into().expect("LANES values")
}

#[inline(always)]
pub fn store(row: &mut [f64], at: usize, v: Vector) {
    row[at..at + LANES].copy_from_slice(&v);
}

#[inline(always)]
pub fn fma<const FMA: bool>(a: Vector, b: Vector, c: Vector) -> Vector {
    // not by way of `fused`: called from a closure it is slower
    std::array::from_fn(|l| if FMA { a[l].mul_add(b[l], c[l]) } else { a[l] * b[l] + c[l] })
}

/// The same of single numbers.
#[inline(always)]
pub fn fused<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}
