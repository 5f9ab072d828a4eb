//! A nonlinear loop under way: states, derivatives, and the buffers of a step. Nothing is allocated per sample.

use crate::error::{Error, Result};
use crate::model::Controller;
use crate::nonlinear::control::Control;
use crate::nonlinear::plant::Plant;
use crate::nonlinear::scheme::{Layout, Scheme};
use crate::product::{LANES, Vector, dispatch, fma, load, store};

/// A loop at one parameter set and one number of substeps, with its present state.
///
/// All states come in rows: the value, then its derivative by each free parameter.
#[derive(Debug, Clone)]
pub struct Run {
    plant: Plant,
    layout: Layout,
    /// The pieces of a controller sample, or of a sample of the record where there is no digital controller.
    segments: Vec<Segment>,
    substeps: usize,
    control: Option<Control>,
    buffers: Buffers,
}

/// A stretch of time over which the command is held.
#[derive(Debug, Clone)]
struct Segment {
    scheme: Scheme,
    /// The command that acts, in controller samples before the newest.
    age: usize,
}

#[derive(Debug, Clone)]
struct Buffers {
    /// Rows of the step, and those of the step before, whose x is the present state.
    step: Vec<f64>,
    last: Vec<f64>,
    /// What the command brings to the rows of the step.
    held: Vec<f64>,
    /// w of the blocks, in rows.
    w: Vec<f64>,
    /// dw/dz of each block.
    slopes: Vec<[f64; 2]>,
    by_coefficient: Vec<f64>,
    /// z at the ports of free gains, at the four stages; and what the command brings to it.
    read: Vec<f64>,
    held_read: Vec<f64>,
}

impl Run {
    /// At rest, with `substeps` for each stretch of time over which the command is held.
    ///
    /// # Errors
    /// [`Error::Block`] where there are no substeps, and as [`Scheme::new`].
    pub fn new(plant: Plant, controller: Option<&Controller>, dt: f64, substeps: usize) -> Result<Self> {
        if substeps == 0 {
            return Err(Error::Block { what: "a nonlinear loop needs at least one substep" });
        }
        let segment = |length: f64, age: usize| -> Result<Segment> {
            Ok(Segment { scheme: Scheme::new(&plant, length / substeps as f64)?, age })
        };
        let segments = match controller {
            None => vec![segment(dt, 0)?],
            Some(k) => {
                let (step, whole, fraction) = (dt / k.steps as f64, k.delay.floor() as usize, k.delay.fract());
                let late = segment(step * (1.0 - fraction), whole)?;
                if fraction > 0.0 { vec![segment(step * fraction, whole + 1)?, late] } else { vec![late] }
            }
        };
        let layout = Layout::new(plant.a.nrows(), plant.c_y.nrows(), plant.c_z.nrows(), plant.gains.len());
        let (rows, blocks) = (plant.rows, plant.blocks.len());
        let coefficients = plant.blocks.iter().map(|b| b.coefficients).max().unwrap_or(0);
        let buffers = Buffers {
            step: vec![0.0; rows * layout.width],
            last: vec![0.0; rows * layout.width],
            held: vec![0.0; rows * layout.width],
            w: vec![0.0; rows * blocks],
            slopes: vec![[0.0; 2]; blocks],
            by_coefficient: vec![0.0; coefficients],
            read: vec![0.0; 4 * layout.read],
            held_read: vec![0.0; 4 * layout.read],
        };
        let control = controller.map(|k| Control::new(k, rows));
        Ok(Self { plant, layout, segments, substeps, control, buffers })
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        self.buffers.last.fill(0.0);
        self.buffers.held.fill(0.0);
        self.buffers.held_read.fill(0.0);
        if let Some(control) = &mut self.control {
            control.reset();
        }
    }

    /// One sample: `y` becomes the outputs of this instant, each followed by its derivatives; `u` is held.
    pub fn sample(&mut self, u: &[f64], y: &mut [f64]) {
        sample(self, u, y);
    }
}

fn sample(run: &mut Run, u: &[f64], y: &mut [f64]) {
    dispatch!(sample_any, (run: &mut Run, u: &[f64], y: &mut [f64]));
}

#[inline(always)]
fn sample_any<const FMA: bool>(run: &mut Run, u: &[f64], y: &mut [f64]) {
    if run.plant.rows > 1 { advance::<FMA, true>(run, u, y) } else { advance::<FMA, false>(run, u, y) }
}

#[inline(always)]
fn advance<const FMA: bool, const SLOPES: bool>(run: &mut Run, u: &[f64], y: &mut [f64]) {
    let Run { plant, layout, segments, substeps, control, buffers } = run;
    let rows = plant.rows;
    let mut fresh = true;
    for _ in 0..control.as_ref().map_or(1, Control::steps) {
        if let Some(control) = control {
            // the displacements that the controller reads do not follow the command that acts
            start::<FMA, SLOPES>(plant, layout, buffers, &segments[0].scheme);
            stage::<FMA, SLOPES>(plant, layout, buffers, &segments[0].scheme, 0);
            control.update(u, &buffers.step[layout.y..], layout.width);
        }
        for Segment { scheme, age } in segments.iter() {
            match control {
                Some(control) => {
                    (0..rows).for_each(|row| hold::<FMA>(layout, buffers, scheme, row, control.command(*age, row)))
                }
                None => hold::<FMA>(layout, buffers, scheme, 0, u),
            }
            for _ in 0..*substeps {
                start::<FMA, SLOPES>(plant, layout, buffers, scheme);
                for s in 0..4 {
                    stage::<FMA, SLOPES>(plant, layout, buffers, scheme, s);
                }
                if fresh {
                    for (row, step) in buffers.step.chunks_exact(layout.width).enumerate() {
                        for (y, value) in y.chunks_exact_mut(rows).zip(&step[layout.y..]) {
                            y[row] = *value;
                        }
                    }
                    fresh = false;
                }
                std::mem::swap(&mut buffers.step, &mut buffers.last);
            }
        }
    }
    if let Some(control) = control {
        y.iter_mut().step_by(rows).zip(control.noise(u)).for_each(|(y, noise)| *y += noise);
    }
}

/// What the command of one row brings to the steps while it is held.
#[inline(always)]
fn hold<const FMA: bool>(layout: &Layout, buffers: &mut Buffers, scheme: &Scheme, row: usize, command: &[f64]) {
    let held = &mut buffers.held[row * layout.width..(row + 1) * layout.width];
    held.fill(0.0);
    accumulate::<FMA>(command, &scheme.held, held);
    if row == 0 {
        buffers.held_read.fill(0.0);
        accumulate::<FMA>(command, &scheme.held_read, &mut buffers.held_read);
    }
}

/// What follows from the state and the command alone.
#[inline(always)]
fn start<const FMA: bool, const SLOPES: bool>(plant: &Plant, layout: &Layout, buffers: &mut Buffers, scheme: &Scheme) {
    let Buffers { step, last, held, read, held_read, .. } = buffers;
    let (states, width) = (plant.a.nrows(), layout.width);
    for row in 0..plant.rows {
        let own = row * width..(row + 1) * width;
        let x = &last[own.start + layout.x..][..states];
        accumulate_from::<FMA>(&held[own.clone()], x, &scheme.start, &mut step[own]);
    }
    if SLOPES {
        accumulate_from::<FMA>(held_read, &last[layout.x..][..states], &scheme.read_start, read);
    }
}

/// The blocks at one stage, and what they bring to the stages that follow.
#[inline(always)]
fn stage<const FMA: bool, const SLOPES: bool>(
    plant: &Plant,
    layout: &Layout,
    buffers: &mut Buffers,
    scheme: &Scheme,
    s: usize,
) {
    let Buffers { step, w, slopes, by_coefficient, read, .. } = buffers;
    let (width, blocks) = (layout.width, plant.blocks.len());
    let (signals, after) = (layout.signals[s], layout.after[s]);
    if SLOPES {
        w[blocks..].fill(0.0);
    }
    for block in &plant.blocks {
        let first = signals + block.first;
        let z = [step[first], if block.inputs > 1 { step[first + 1] } else { 0.0 }];
        let (value, slope) = block.element.evaluate::<FMA, SLOPES>(z, &mut by_coefficient[..block.coefficients]);
        w[block.place] = value;
        if SLOPES {
            slopes[block.place] = slope;
            for (row, place) in &block.free {
                w[row * blocks + block.place] += by_coefficient[*place];
            }
        }
        for (z, factor) in &block.feeds {
            step[signals + z] += factor * value;
        }
    }
    accumulate::<FMA>(&w[..blocks], &scheme.blocks[s], &mut step[after..width]);
    if !SLOPES {
        return;
    }
    accumulate::<FMA>(&w[..blocks], &scheme.read[s], &mut read[s * layout.read..]);
    for (k, gain) in plant.gains.iter().enumerate() {
        let forced = gain.slope * read[s * layout.read + k];
        let target = &mut step[gain.row * width + signals..(gain.row + 1) * width];
        accumulate::<FMA>(&[forced], &scheme.gains[s][k * target.len()..], target);
    }
    for row in 1..plant.rows {
        let step = &mut step[row * width..(row + 1) * width];
        let w = &mut w[row * blocks..(row + 1) * blocks];
        for block in &plant.blocks {
            let slope = &slopes[block.place];
            for (i, slope) in slope.iter().enumerate().take(block.inputs) {
                w[block.place] += slope * step[signals + block.first + i];
            }
            for (z, factor) in &block.feeds {
                step[signals + z] += factor * w[block.place];
            }
        }
        accumulate::<FMA>(w, &scheme.blocks[s], &mut step[after..]);
    }
}

/// `out += left weights`; the length of `out` is a multiple of the lanes.
#[inline(always)]
fn accumulate<const FMA: bool>(left: &[f64], weights: &[f64], out: &mut [f64]) {
    let columns = out.len();
    let mut at = 0;
    while columns - at >= 4 * LANES {
        store_all(out, at, tile::<FMA, 4>(load_all(out, at), left, weights, columns, at));
        at += 4 * LANES;
    }
    if columns - at >= 2 * LANES {
        store_all(out, at, tile::<FMA, 2>(load_all(out, at), left, weights, columns, at));
        at += 2 * LANES;
    }
    if columns > at {
        store_all(out, at, tile::<FMA, 1>(load_all(out, at), left, weights, columns, at));
    }
}

/// `out = from + left weights`, the same otherwise.
#[inline(always)]
fn accumulate_from<const FMA: bool>(from: &[f64], left: &[f64], weights: &[f64], out: &mut [f64]) {
    let columns = out.len();
    let mut at = 0;
    while columns - at >= 4 * LANES {
        store_all(out, at, tile::<FMA, 4>(load_all(from, at), left, weights, columns, at));
        at += 4 * LANES;
    }
    while columns > at {
        store_all(out, at, tile::<FMA, 1>(load_all(from, at), left, weights, columns, at));
        at += LANES;
    }
}

#[inline(always)]
fn tile<const FMA: bool, const V: usize>(
    mut sum: [Vector; V],
    left: &[f64],
    weights: &[f64],
    columns: usize,
    mut at: usize,
) -> [Vector; V] {
    for left in left {
        let row = &weights[at..at + V * LANES];
        for (v, sum) in sum.iter_mut().enumerate() {
            *sum = fma::<FMA>([*left; LANES], load(row, v * LANES), *sum);
        }
        at += columns;
    }
    sum
}

#[inline(always)]
fn load_all<const V: usize>(row: &[f64], at: usize) -> [Vector; V] {
    std::array::from_fn(|v| load(row, at + v * LANES))
}

#[inline(always)]
fn store_all<const V: usize>(row: &mut [f64], at: usize, all: [Vector; V]) {
    for (v, one) in all.into_iter().enumerate() {
        store(row, at + v * LANES, one);
    }
}
