//! The loop over samples: a bank of first- and second-order sections, and one small matrix product per block.
//!
//! A *cell* is a complex pair of poles or two real ones; its state is a pair (re, im). All cells advance side by
//! side (structure of arrays), their states of a block of samples form a matrix, and every output column is a
//! linear combination of them.

use crate::error::Result;
use crate::instructions::dispatch;
use crate::product::{LANES, Panels, ROW_MULTIPLE, Vector, fma, load, product, store};
use crate::stop::go_on;

/// Samples per block: the states of a block stay in the first-level cache.
pub const BLOCK: usize = 5 * ROW_MULTIPLE;

/// A 2 x 2 section per lane, four lanes to a vector: `[m11, m12, m21, m22]`.
#[derive(Debug, Clone, Default)]
pub struct Sections {
    vectors: Vec<[Vector; 4]>,
    lanes: usize,
}

impl Sections {
    /// Appends the section of one more lane.
    pub fn push(&mut self, m: [f64; 4]) {
        let lane = self.lanes % LANES;
        if lane == 0 {
            self.vectors.push([[0.0; LANES]; 4]);
        }
        let last = self.vectors.last_mut().expect("just pushed");
        for (vector, m) in last.iter_mut().zip(m) {
            vector[lane] = m;
        }
        self.lanes += 1;
    }

    /// Fills up to whole vectors with lanes that stay zero.
    pub fn pad(&mut self) {
        self.lanes = self.padded();
    }

    /// Number of lanes in whole vectors.
    pub fn padded(&self) -> usize {
        self.vectors.len() * LANES
    }
}

/// First bank p: `p+ = m p + f u`. Second bank q, driven by the first: `q+ = m q + n p`.
///
/// A row of the basis is `[p_re | p_im | q_re | q_im | u]`, a row of the output is that row times `weights`.
#[derive(Debug, Clone, Default)]
pub struct Kernel {
    pub inputs: usize,
    pub p: Sections,
    /// Forcing of the first bank: input a drives lane l with `[re, im]` at `a * p.padded() + l` (in vectors of lanes).
    pub force: Sections,
    pub q: Sections,
    /// Drive of the second bank: for each input, a section per lane of q, applied to as many lanes of p.
    pub drive: Sections,
    /// Lanes of the first bank per input.
    pub lanes: usize,
    /// True where the input itself is part of the basis.
    pub feedthrough: bool,
    pub columns: usize,
    /// Basis length x columns, row by row.
    pub weights: Vec<f64>,
}

impl Kernel {
    /// Length of a row of the basis.
    pub fn basis(&self) -> usize {
        2 * (self.p.padded() + self.q.padded()) + if self.feedthrough { self.inputs } else { 0 }
    }

    /// Leaves out the columns that do not count.
    pub fn keep(&mut self, counts: impl Fn(usize) -> bool) {
        let columns = self.columns;
        self.columns = (0..columns).filter(|column| counts(*column)).count();
        let weights = self.weights.iter().enumerate();
        self.weights = weights.filter(|(i, _)| counts(i % columns)).map(|(_, weight)| *weight).collect();
    }

    /// Runs over `u` (samples x inputs, row by row) from rest and hands each block of output rows to `sink`.
    ///
    /// `sink(first_sample, samples, block, stride)`; column c of sample k stands at `block[k * stride + c]`.
    ///
    /// # Errors
    /// [`crate::Error::Stopped`].
    pub fn run(&self, u: &[f64], sink: &mut impl FnMut(usize, usize, &[f64], usize)) -> Result<()> {
        let depth = self.basis();
        let weights = Panels::new(depth, self.columns, &self.weights);
        let mut basis = vec![0.0; (BLOCK + 1) * depth];
        let mut out = vec![0.0; BLOCK * weights.stride];
        for (i, block) in u.chunks(BLOCK * self.inputs).enumerate() {
            go_on()?;
            let count = block.len() / self.inputs;
            advance(self, &mut basis, block);
            product(&basis, count, &weights, &mut out);
            sink(i * BLOCK, count, &out, weights.stride);
            basis.copy_within(count * depth..(count + 1) * depth, 0);
        }
        Ok(())
    }
}

/// Fills one row of the basis per sample, and the states of the row after the last.
fn advance(kernel: &Kernel, basis: &mut [f64], u: &[f64]) {
    dispatch!(advance_any, (kernel: &Kernel, basis: &mut [f64], u: &[f64]));
}

#[inline(always)]
fn advance_any<const FMA: bool>(kernel: &Kernel, basis: &mut [f64], u: &[f64]) {
    let (depth, lp, lq) = (kernel.basis(), kernel.p.padded(), kernel.q.padded());
    if kernel.feedthrough {
        for (row, u) in basis.chunks_exact_mut(depth).zip(u.chunks_exact(kernel.inputs)) {
            row[2 * (lp + lq)..].copy_from_slice(u);
        }
    }
    bank::<FMA, _>(&kernel.p, [0, lp], depth, basis, u, &Forced(kernel));
    bank::<FMA, _>(&kernel.q, [2 * lp, 2 * lp + lq], depth, basis, u, &Driven(kernel));
}

/// What drives a bank: adds the drive of vector `v` to `sum`. Not a closure, since those are not compiled for FMA.
trait Drive {
    fn inputs(&self) -> usize;
    fn add<const FMA: bool>(&self, row: &[f64], u: &[f64], v: usize, sum: (Vector, Vector)) -> (Vector, Vector);
}

/// The first bank, driven by the inputs.
struct Forced<'a>(&'a Kernel);

impl Drive for Forced<'_> {
    #[inline(always)]
    fn inputs(&self) -> usize {
        self.0.inputs
    }

    #[inline(always)]
    fn add<const FMA: bool>(&self, _: &[f64], u: &[f64], v: usize, sum: (Vector, Vector)) -> (Vector, Vector) {
        let (mut re, mut im) = sum;
        let (force, vectors) = (&self.0.force.vectors[..], self.0.p.vectors.len());
        for (a, u) in u.iter().enumerate() {
            let force = &force[a * vectors + v];
            re = fma::<FMA>(force[0], [*u; LANES], re);
            im = fma::<FMA>(force[1], [*u; LANES], im);
        }
        (re, im)
    }
}

/// The second bank, driven by the states of the first.
struct Driven<'a>(&'a Kernel);

impl Drive for Driven<'_> {
    #[inline(always)]
    fn inputs(&self) -> usize {
        self.0.inputs
    }

    #[inline(always)]
    fn add<const FMA: bool>(&self, row: &[f64], u: &[f64], v: usize, mut sum: (Vector, Vector)) -> (Vector, Vector) {
        let (lp, lanes, vectors) = (self.0.p.padded(), self.0.lanes, self.0.q.vectors.len());
        for a in 0..u.len() {
            let drive = &self.0.drive.vectors[a * vectors + v];
            // may read past the lanes of this input: there the drive is zero
            let at = a * lanes + v * LANES;
            sum = apply::<FMA>(drive, load(row, at), load(row, lp + at), sum);
        }
        sum
    }
}

/// Advances one bank over a block, up to three vectors at a time so that their latencies overlap.
///
/// `at` are the places of the real and imaginary parts in a row of the basis.
#[inline(always)]
fn bank<const FMA: bool, D: Drive>(
    sections: &Sections,
    at: [usize; 2],
    depth: usize,
    basis: &mut [f64],
    u: &[f64],
    drive: &D,
) {
    for (group, m) in sections.vectors.chunks(3).enumerate() {
        let first = 3 * group;
        match m.len() {
            3 => vectors::<FMA, 3, D>(m, at.map(|at| at + first * LANES), depth, basis, u, (first, drive)),
            2 => vectors::<FMA, 2, D>(m, at.map(|at| at + first * LANES), depth, basis, u, (first, drive)),
            _ => vectors::<FMA, 1, D>(m, at.map(|at| at + first * LANES), depth, basis, u, (first, drive)),
        }
    }
}

#[inline(always)]
fn vectors<const FMA: bool, const G: usize, D: Drive>(
    sections: &[[Vector; 4]],
    at: [usize; 2],
    depth: usize,
    basis: &mut [f64],
    u: &[f64],
    (first, drive): (usize, &D),
) {
    let places: [[usize; 2]; G] = std::array::from_fn(|g| at.map(|at| at + g * LANES));
    let m: [[Vector; 4]; G] = std::array::from_fn(|g| sections[g]);
    let mut state: [(Vector, Vector); G] = places.map(|[re, im]| (load(basis, re), load(basis, im)));
    let mut rows = basis.chunks_exact_mut(depth);
    for u in u.chunks_exact(drive.inputs()) {
        let row = rows.next().expect("a row per sample and one more");
        for g in 0..G {
            store(row, places[g][0], state[g].0);
            store(row, places[g][1], state[g].1);
            let driven = drive.add::<FMA>(row, u, first + g, ([0.0; LANES], [0.0; LANES]));
            state[g] = apply::<FMA>(&m[g], state[g].0, state[g].1, driven);
        }
    }
    let row = rows.next().expect("a row per sample and one more");
    for ([re, im], state) in places.into_iter().zip(state) {
        store(row, re, state.0);
        store(row, im, state.1);
    }
}

#[inline(always)]
fn apply<const FMA: bool>(m: &[Vector; 4], x: Vector, y: Vector, (re, im): (Vector, Vector)) -> (Vector, Vector) {
    let re = fma::<FMA>(m[0], x, fma::<FMA>(m[1], y, re));
    let im = fma::<FMA>(m[3], y, fma::<FMA>(m[2], x, im));
    (re, im)
}
