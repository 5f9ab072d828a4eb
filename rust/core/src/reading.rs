//! Outputs that are recorded late or early, by any time.
//!
//! What is read `d` seconds late at sample k is what the plant does at `t_k - d`: `shift` samples before, and then
//! `phase` seconds later, `d = shift dt - phase` with `0 <= phase < dt`. The phase is part of C and D of the sampled
//! loop, exactly; the shift is a phase on lines and a displacement of rows in time.

use crate::error::{Error, Result};
use crate::model::Model;

/// Samples by which an output may be read late or early.
const MOST_SAMPLES: f64 = 1000.0;

/// An output that is read late by `scale theta[parameter]` seconds; early where that is negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Late {
    /// Index of the output; several delays of one add up.
    pub output: usize,
    /// Index into the parameter vector.
    pub parameter: usize,
    /// Constant factor.
    pub scale: f64,
}

/// When an output is read, relative to the sample that it is recorded as.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Instant {
    /// Whole samples by which it is late.
    pub shift: isize,
    /// Seconds after the sample `shift` before, less than a sample.
    pub phase: f64,
    /// Derivatives of the phase by each free parameter.
    pub slopes: Vec<f64>,
}

impl Instant {
    /// Whether it is that of a sample, whatever the free parameters do.
    pub fn is_at_sample(&self) -> bool {
        self.phase == 0.0 && self.slopes.iter().all(|slope| *slope == 0.0)
    }
}

/// Outputs that are read at one instant, which is no sample or depends on a parameter.
pub(crate) struct Group {
    pub instant: Instant,
    pub outputs: Vec<usize>,
}

/// The instants of outputs that are late, with derivatives by `free`.
///
/// # Errors
/// [`Error::Singular`] where one is late or early by [`MOST_SAMPLES`] or more.
pub(crate) fn groups(model: &Model, theta: &[f64], free: &[usize]) -> Result<Vec<Group>> {
    let mut found: Vec<Group> = Vec::new();
    for output in (0..model.outputs()).filter(|o| model.late.iter().any(|late| late.output == *o)) {
        let own = || model.late.iter().filter(|late| late.output == output);
        let samples = own().map(|late| late.scale * theta[late.parameter]).sum::<f64>() / model.dt;
        if samples.is_nan() || samples.abs() >= MOST_SAMPLES {
            return Err(Error::Singular { what: "an output is read late or early by 1000 samples and more" });
        }
        let slope = |p: &usize| -own().filter(|late| late.parameter == *p).map(|late| late.scale).sum::<f64>();
        let (shift, slopes) = (samples.ceil(), free.iter().map(slope).collect());
        let instant = Instant { shift: shift as isize, phase: (shift - samples) * model.dt, slopes };
        match found.iter_mut().find(|group| group.instant == instant) {
            Some(group) => group.outputs.push(output),
            None => found.push(Group { instant, outputs: vec![output] }),
        }
    }
    Ok(found)
}

/// Whole samples by which each output is late.
///
/// # Errors
/// As [`groups`].
pub(crate) fn shifts(model: &Model, theta: &[f64]) -> Result<Vec<isize>> {
    let mut found = vec![0; model.outputs()];
    for Group { instant, outputs } in groups(model, theta, &[])? {
        outputs.iter().for_each(|o| found[*o] = instant.shift);
    }
    Ok(found)
}

/// Samples by which the earliest, and the latest, of outputs is shifted, at least 0.
pub(crate) fn reach(shifts: &[isize]) -> (usize, usize) {
    let most = |of: &dyn Fn(isize) -> isize| shifts.iter().map(|m| of(*m)).max().unwrap_or(0).max(0).unsigned_abs();
    (most(&|m| -m), most(&|m| m))
}

/// Rows of `cells` numbers an output, each output displaced by its own shift; before the first row there is rest.
pub(crate) struct Shifted<'a> {
    shifts: &'a [isize],
    cells: usize,
    lead: usize,
    lag: usize,
    /// The rows that are still needed, the last `lead + lag` of them.
    kept: Vec<f64>,
    /// Rows handed on.
    done: usize,
}

impl<'a> Shifted<'a> {
    pub fn new(shifts: &'a [isize], cells: usize) -> Self {
        let (lead, lag) = reach(shifts);
        Self { shifts, cells, lead, lag, kept: vec![0.0; lag * shifts.len() * cells], done: 0 }
    }

    /// The same inputs with as many rows of zeros more as the earliest output looks ahead.
    pub fn extended(&self, u: &[f64], inputs: usize) -> Vec<f64> {
        [u, &vec![0.0; self.lead * inputs]].concat()
    }

    /// Takes rows as they come, and hands on those that are complete.
    pub fn take(
        &mut self,
        count: usize,
        block: &[f64],
        stride: usize,
        sink: &mut impl FnMut(usize, usize, &[f64], usize),
    ) {
        let (cells, columns) = (self.cells, self.shifts.len() * self.cells);
        block.chunks_exact(stride).take(count).for_each(|row| self.kept.extend(&row[..columns]));
        let ready = (self.kept.len() / columns.max(1)).saturating_sub(self.lead + self.lag);
        if ready == 0 {
            return;
        }
        let mut out = vec![0.0; ready * columns];
        for (k, row) in out.chunks_exact_mut(columns).enumerate() {
            for (o, (shift, own)) in self.shifts.iter().zip(row.chunks_exact_mut(cells)).enumerate() {
                let from = (k + self.lag).wrapping_add_signed(-shift);
                own.copy_from_slice(&self.kept[from * columns + o * cells..][..cells]);
            }
        }
        self.kept.drain(..ready * columns);
        sink(self.done, ready, &out, columns);
        self.done += ready;
    }
}

/// Rows of a response, `width` columns an output, whose last `period` repeat, displaced by the shift of each output:
/// that period.
pub(crate) fn last_period(y: &[f64], width: usize, shifts: &[isize], period: usize) -> Vec<f64> {
    let columns = shifts.len() * width;
    let first = y.len() / columns.max(1) - period;
    let place = |k: usize, shift: isize| first + (k as isize - shift).rem_euclid(period.max(1) as isize).unsigned_abs();
    let of = |k: usize, o: usize, m: isize| &y[place(k, m) * columns + o * width..][..width];
    (0..period).flat_map(|k| shifts.iter().enumerate().flat_map(move |(o, m)| of(k, o, *m))).copied().collect()
}
