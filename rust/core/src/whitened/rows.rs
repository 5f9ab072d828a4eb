//! Whitened rows `[T | dz | r]` of lines, a few lines at a time.

use std::ops::Range;

use super::{C64, LineData};
use crate::error::Result;
use crate::instructions::dispatch;
use crate::lines::{BLOCK, Block, OnLines};
use crate::product::{LANES, Vector, fma, load, store};
use crate::stop::go_on;

/// Lines whose whitened rows stay in the first-level cache.
const TOGETHER: usize = 4;

/// Stretches of lines that threads work on at the most, and lines of one at the least.
const STRETCHES: usize = 32;
const STRETCH: usize = 4 * BLOCK;

/// How many of so many lines one thread works on; what all find is put together in the order of the lines.
pub fn stretch(lines: usize) -> usize {
    STRETCH.max(lines.div_ceil(STRETCHES).next_multiple_of(BLOCK))
}

/// Where everything stands in a row `[T | dz | r]`.
pub struct Layout {
    channels: usize,
    pub states: usize,
    parameters: usize,
    pub size: usize,
    pub stride: usize,
    stretches: Vec<Stretch>,
}

impl Layout {
    pub fn new(parts: &[OnLines], parameters: usize, channels: usize, transients: bool) -> Self {
        let states = if transients { parts.iter().map(OnLines::states).sum() } else { 0 };
        let size = states + parameters + 1;
        let stride = size.next_multiple_of(LANES);
        // vectors of columns, by the channels of the parts whose transients stand in them
        let mut stretches: Vec<Stretch> = Vec::new();
        for columns in (0..stride).step_by(LANES).map(|at| at..at + LANES) {
            let mut at = 0;
            let mut own: Vec<usize> = Vec::new();
            for part in parts.iter().filter(|_| transients) {
                let stands = at < columns.end && at + part.states() > columns.start;
                own.extend(part.outputs.iter().filter(|o| stands && **o < channels));
                at += part.states();
            }
            let channels = if columns.end > states { (0..channels).collect() } else { own };
            match stretches.last_mut().filter(|last| last.channels == channels) {
                Some(last) => last.columns.end = columns.end,
                None => stretches.push(Stretch { columns, channels }),
            }
        }
        Self { channels, states, parameters, size, stride, stretches }
    }

    /// Hands the whitened rows of some of the lines, a few at a time, to `sink`, with the first of these few.
    ///
    /// # Errors
    /// [`crate::Error::Stopped`].
    pub fn walk(
        &self,
        parts: &[OnLines],
        data: &LineData,
        some: Range<usize>,
        inputs: usize,
        d: &[f64],
        sink: &mut impl FnMut(usize, &[f64]),
    ) -> Result<()> {
        let (p, stride) = (self.channels, self.stride);
        let mut blocks: Vec<Block> = parts.iter().map(|_| Block::new(self.states > 0)).collect();
        let mut raw = vec![0.0; 2 * p * stride];
        let mut white = vec![0.0; TOGETHER * 2 * p * stride];
        for first in some.clone().step_by(BLOCK) {
            go_on()?;
            let lines = first..(first + BLOCK).min(some.end);
            let u = &data.u[first * inputs..lines.end * inputs];
            let mut at = 0;
            for (part, block) in parts.iter().zip(&mut blocks) {
                let n = part.states();
                let own = if d.is_empty() { d } else { &d[at..at + n] };
                part.run(&data.w[lines.clone()], u, inputs, own, block);
                at += n;
            }
            for together in lines.clone().step_by(TOGETHER) {
                let count = TOGETHER.min(lines.end - together);
                for (line, white) in (together..together + count).zip(white.chunks_exact_mut(2 * p * stride)) {
                    raw.fill(0.0);
                    self.lay_out(parts, &blocks, line - first, &mut raw);
                    for (c, z) in data.z[line * p..(line + 1) * p].iter().enumerate() {
                        raw[2 * c * stride + self.size - 1] -= z.re;
                        raw[(2 * c + 1) * stride + self.size - 1] -= z.im;
                    }
                    whiten(&data.whitening[line * p * p..(line + 1) * p * p], &raw, &self.stretches, stride, white);
                }
                sink(together, &white[..count * 2 * p * stride]);
            }
        }
        Ok(())
    }

    /// One line before whitening and without what was measured.
    fn lay_out(&self, parts: &[OnLines], blocks: &[Block], line: usize, raw: &mut [f64]) {
        let mut at = 0;
        for (part, block) in parts.iter().zip(blocks) {
            let (n, np) = (part.states(), part.free.len());
            let columns = &block.columns[line * block.stride..];
            for (i, channel) in part.outputs.iter().enumerate().filter(|(_, channel)| **channel < self.channels) {
                for (side, basis) in block.basis.iter().enumerate() {
                    let row = &mut raw[(2 * channel + side) * self.stride..][..self.stride];
                    if self.states > 0 {
                        let from = (line * part.outputs.len() + i) * n;
                        row[at..at + n].copy_from_slice(&basis[from..from + n]);
                    }
                    let own = &columns[side * block.half + i * (1 + np)..];
                    part.free.iter().enumerate().for_each(|(j, free)| row[self.states + free] = own[1 + j]);
                    row[self.states + self.parameters] = own[0];
                }
            }
            at += n;
        }
    }
}

/// Columns of a stretch in which the same channels are other than zero.
struct Stretch {
    columns: Range<usize>,
    channels: Vec<usize>,
}

/// Vectors of columns that are whitened together.
const WIDE: usize = 2;

/// `white = W raw`, real and imaginary parts of every channel below each other.
fn whiten(w: &[C64], raw: &[f64], stretches: &[Stretch], stride: usize, white: &mut [f64]) {
    dispatch!(whiten_any, (w: &[C64], raw: &[f64], stretches: &[Stretch], stride: usize, white: &mut [f64]));
}

#[inline(always)]
fn whiten_any<const FMA: bool>(w: &[C64], raw: &[f64], stretches: &[Stretch], stride: usize, white: &mut [f64]) {
    for Stretch { columns, channels } in stretches {
        let mut at = columns.start;
        while at + WIDE * LANES <= columns.end {
            whiten_tile::<FMA, WIDE>(w, raw, channels, stride, at, white);
            at += WIDE * LANES;
        }
        while at < columns.end {
            whiten_tile::<FMA, 1>(w, raw, channels, stride, at, white);
            at += LANES;
        }
    }
}

/// V vectors of columns from `at` on, two channels at a time.
#[inline(always)]
fn whiten_tile<const FMA: bool, const V: usize>(
    w: &[C64],
    raw: &[f64],
    channels: &[usize],
    stride: usize,
    at: usize,
    white: &mut [f64],
) {
    let p = white.len() / (2 * stride);
    for first in (0..p).step_by(2) {
        // of an odd number the last channel is its own neighbour
        let pair = [first, (first + 1).min(p - 1)];
        let mut sum = [[[[0.0; LANES]; V]; 2]; 2];
        for c in channels {
            let from = &raw[2 * c * stride..2 * (c + 1) * stride];
            let re: [Vector; V] = std::array::from_fn(|v| load(from, at + v * LANES));
            let im: [Vector; V] = std::array::from_fn(|v| load(from, stride + at + v * LANES));
            for (sum, to) in sum.iter_mut().zip(pair) {
                let w = w[to * p + c];
                for v in 0..V {
                    sum[0][v] = fma::<FMA>([w.re; LANES], re[v], fma::<FMA>([-w.im; LANES], im[v], sum[0][v]));
                    sum[1][v] = fma::<FMA>([w.re; LANES], im[v], fma::<FMA>([w.im; LANES], re[v], sum[1][v]));
                }
            }
        }
        for (sum, to) in sum.iter().zip(pair) {
            for (side, sum) in sum.iter().enumerate() {
                for (v, sum) in sum.iter().enumerate() {
                    store(white, (2 * to + side) * stride + at + v * LANES, *sum);
                }
            }
        }
    }
}
