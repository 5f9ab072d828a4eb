//! Normal equations of repeats: records of one excitation, whose response is run once for all of them.

use super::{Data, Moments, Normal};
use crate::closed_loop::ClosedLoop;
use crate::error::Result;
use crate::product::add_weighted;

impl Data {
    /// Whether another record was excited alike, and is judged on the same channels and samples.
    pub(crate) fn is_repeated_by(&self, other: &Self) -> bool {
        let judged = |data: &Self| data.weights.iter().map(|weight| *weight != 0.0).collect::<Vec<_>>();
        self.first == other.first && self.u == other.u && judged(self) == judged(other)
    }
}

/// What [`super::normal_equations`] says of each of `records`, which repeat the first one; to rounding.
///
/// # Errors
/// As there.
pub fn of_repeats(system: &ClosedLoop, theta: &[f64], free: &[usize], records: &[&Data]) -> Result<Vec<Normal>> {
    let Some(first) = records.first() else { return Ok(Vec::new()) };
    first.check(system)?;
    let (inputs, ny) = (system.inputs(), system.outputs());
    let mut found: Vec<Normal> = records.iter().map(|_| Normal::zeros(free.len(), ny)).collect();
    let mut seen = vec![false; ny];
    for part in &system.prepare_some(theta, free, |o| first.weights[o] != 0.0)? {
        let mut moments: Vec<Moments> = part.outputs.iter().map(|_| Moments::new(part.free.len())).collect();
        let stride = moments.first().map_or(0, |own| own.stride);
        // of every output and record the sum of what was measured times each row
        let mut along = vec![0.0; part.outputs.len() * records.len() * stride];
        let mut measured = Vec::new();
        part.run(&first.u, inputs, &mut |from, count, block, width| {
            let skip = first.first.saturating_sub(from).min(count);
            for (i, (o, moments)) in part.outputs.iter().zip(&mut moments).enumerate() {
                if first.weights[*o] == 0.0 {
                    continue;
                }
                moments.lay(i * moments.width, block.chunks_exact(width).take(count).skip(skip));
                moments.add(count - skip);
                let sums = along[i * records.len() * stride..].chunks_exact_mut(stride);
                for (data, sum) in records.iter().zip(sums) {
                    let own = data.z[(from + skip) * ny..].iter().skip(*o).step_by(ny).take(count - skip);
                    measured.clear();
                    measured.extend(own);
                    add_weighted(&moments.rows, stride, &measured, sum);
                }
            }
        })?;
        for (i, (o, response)) in part.outputs.iter().zip(moments).enumerate() {
            seen[*o] = true;
            let sums = along[i * records.len() * stride..].chunks_exact(stride);
            for ((data, sum), found) in records.iter().zip(sums).zip(&mut found).filter(|_| first.weights[*o] != 0.0) {
                response.less(sum, data.squares[*o]).add_to(found, *o, data.weights[*o], &part.free);
            }
        }
    }
    found.iter_mut().zip(records).for_each(|(found, data)| data.add_unseen(&seen, found));
    Ok(found)
}

impl Moments {
    /// Those of the residual: of a response less what was measured, of which `along` has the sums with each row.
    fn less(&self, along: &[f64], squares: f64) -> Self {
        let mut sum = self.sum.clone();
        sum.iter_mut().zip(along).for_each(|(sum, along)| *sum -= along);
        sum[0] += squares - along[0];
        Self { width: self.width, rows: Vec::new(), stride: self.stride, sum }
    }
}
