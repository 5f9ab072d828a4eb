//! The stretches of a sample over which all inputs are held, and what is read between them.

use crate::error::Result;
use crate::nonlinear::plant::Plant;
use crate::nonlinear::scheme::Scheme;
use crate::reading::Group;

/// Part of a step that a stretch may be longer than so many of them.
const ROUNDING: f64 = 1e-9;

/// A stretch of time over which all inputs are held.
#[derive(Debug, Clone)]
pub struct Segment {
    /// That of each of its steps.
    pub scheme: Scheme,
    pub steps: usize,
    /// The command that acts, in controller samples before the newest.
    pub age: usize,
    /// Whether that command arrives as it begins.
    pub arrives: bool,
    /// What is read as it begins.
    pub reads: Vec<Read>,
}

/// Outputs that are read within a sample of the record.
#[derive(Debug, Clone)]
pub struct Read {
    /// Controller samples after the sample of the record.
    pub after: usize,
    pub outputs: Vec<usize>,
    /// By how much later they are read, by each free parameter.
    pub slopes: Vec<f64>,
}

/// Cuts segments, each of a length, an age and whether its command arrives, where something is read.
///
/// No step is longer than a segment over `substeps`.
pub fn cut(
    plant: &Plant,
    lengths: &[(f64, usize, bool)],
    steps: usize,
    late: &[Group],
    substeps: usize,
) -> Result<Vec<Segment>> {
    let step: f64 = lengths.iter().map(|(length, ..)| length).sum();
    let after = |phase: f64| (phase / step).floor().min(steps as f64 - 1.0);
    let mut places: Vec<(f64, &Group)> =
        late.iter().map(|g| (g.instant.phase - after(g.instant.phase) * step, g)).collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut segments, mut begin, mut left) = (Vec::new(), 0.0, places.as_slice());
    for (i, (length, age, arrives)) in lengths.iter().enumerate() {
        let (end, is_last) = (begin + length, i + 1 == lengths.len());
        let count = left.iter().take_while(|(at, _)| is_last || *at < end).count();
        let (own, rest) = left.split_at(count);
        let bounds: Vec<f64> = [begin].into_iter().chain(own.iter().map(|(at, _)| at.clamp(begin, end))).collect();
        let (mut arrives, mut reads) = (*arrives, Vec::new());
        for (k, at) in bounds.iter().enumerate() {
            if let Some((_, Group { instant, outputs })) = own.get(k.wrapping_sub(1)) {
                let (after, slopes) = (after(instant.phase) as usize, instant.slopes.clone());
                reads.push(Read { after, outputs: outputs.clone(), slopes });
            }
            let next = bounds.get(k + 1);
            if next == Some(at) {
                continue; // nothing happens in no time
            }
            let own = next.unwrap_or(&end) - at;
            let steps = (own / length * substeps as f64 - ROUNDING).ceil().max(1.0);
            let scheme = Scheme::new(plant, own / steps)?;
            let reads = std::mem::take(&mut reads);
            segments.push(Segment { scheme, steps: steps as usize, age: *age, arrives, reads });
            arrives = false;
        }
        (begin, left) = (end, rest);
    }
    Ok(segments)
}
