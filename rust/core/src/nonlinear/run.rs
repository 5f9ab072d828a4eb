//! A nonlinear loop under way: states, derivatives, and the buffers of a step. Nothing is allocated per sample.

use crate::block::SIGNALS;
use crate::error::{Error, Result};
use crate::instructions::dispatch;
use crate::model::Controller;
use crate::nonlinear::control::Control;
use crate::nonlinear::plant::Plant;
use crate::nonlinear::rows::{accumulate, add};
use crate::nonlinear::scheme::{Layout, Scheme};
use crate::nonlinear::segments::{Read, Segment, cut};
use crate::product::fused;
use crate::reading::Group;

/// A loop at one parameter set and one number of substeps, with its present state.
///
/// All states come in rows: the value, then its derivative by each free parameter.
#[derive(Debug, Clone)]
pub struct Run {
    plant: Plant,
    layout: Layout,
    /// The pieces of a controller sample, or of a sample of the record where there is no digital controller.
    segments: Vec<Segment>,
    control: Option<Control>,
    /// Outputs that are not read at the sample itself.
    late: Vec<usize>,
    buffers: Buffers,
}

#[derive(Debug, Clone)]
struct Buffers {
    /// Rows of the step, and those of the step before, whose x is the present state.
    step: Vec<f64>,
    last: Vec<f64>,
    /// What the inputs bring to the rows of the step.
    held: Vec<f64>,
    /// w of the blocks at the four stages, in rows.
    w: Vec<f64>,
    /// dw/dz of each block.
    slopes: Vec<[f64; SIGNALS]>,
    by_coefficient: Vec<f64>,
    /// z at the ports of free gains, at the four stages; and what the inputs bring to it.
    read: Vec<f64>,
    held_read: Vec<f64>,
    /// Commands, and w of the blocks, before a command arrives less those after.
    change: Vec<f64>,
    /// Derivative of the state by time, and the rows of the step before while they are moved along it.
    rates: Vec<f64>,
    kept: Vec<f64>,
}

impl Run {
    /// At rest, with `substeps` for each stretch of time over which the command is held.
    ///
    /// # Errors
    /// [`Error::Block`] where there are no substeps, and as [`Scheme::new`].
    pub fn new(
        plant: Plant,
        controller: Option<&Controller>,
        free: &[usize],
        dt: f64,
        substeps: usize,
        late: &[Group],
    ) -> Result<Self> {
        if substeps == 0 {
            return Err(Error::Block { what: "a nonlinear loop needs at least one substep" });
        }
        let lengths = match controller {
            None => vec![(dt, 0, false)],
            Some(k) => {
                let (step, (whole, fraction, in_two)) = (dt / k.steps as f64, k.split_delay());
                let late = (step * (1.0 - fraction), whole, in_two);
                if in_two { vec![(step * fraction, whole + 1, false), late] } else { vec![late] }
            }
        };
        let segments = cut(&plant, &lengths, controller.map_or(1, |k| k.steps), late, substeps)?;
        let layout = Layout::new(plant.a.nrows(), plant.c_y.nrows(), plant.c_z.nrows(), plant.gains.len());
        let (rows, blocks) = (plant.rows, plant.blocks.len());
        let coefficients = plant.blocks.iter().map(|b| b.coefficients).max().unwrap_or(0);
        let buffers = Buffers {
            step: vec![0.0; rows * layout.width],
            last: vec![0.0; rows * layout.width],
            held: vec![0.0; rows * layout.width],
            w: vec![0.0; rows * 4 * blocks],
            slopes: vec![[0.0; SIGNALS]; blocks],
            by_coefficient: vec![0.0; coefficients],
            read: vec![0.0; 4 * layout.read],
            held_read: vec![0.0; 4 * layout.read],
            change: vec![0.0; plant.driven + blocks],
            rates: vec![0.0; plant.a.nrows()],
            kept: vec![0.0; rows * layout.width],
        };
        let control = controller.map(|k| Control::new(k, free));
        let late = late.iter().flat_map(|group| group.outputs.clone()).collect();
        Ok(Self { plant, layout, segments, control, late, buffers })
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

    /// From a state of the loop linearised at rest on: that of the plant, of the controller, then the commands before.
    pub fn place(&mut self, state: &[f64]) {
        let (plant, rest) = state.split_at(self.plant.sizes.len());
        let own = self.buffers.last[self.layout.x..].iter_mut();
        own.zip(plant.iter().zip(&self.plant.sizes)).for_each(|(own, (x, size))| *own = x / size);
        if let Some(control) = &mut self.control {
            control.place(rest);
        }
    }

    /// One sample: `y` becomes the outputs of this instant, each followed by its derivatives; `u` is held.
    pub fn sample(&mut self, u: &[f64], y: &mut [f64]) {
        sample(self, u, y);
    }

    /// The outputs of this instant, of a run without derivatives, were `u` held from now on; time stands still.
    pub fn outputs(&mut self, u: &[f64], y: &mut [f64]) {
        if self.late.is_empty() { outputs(self, u, y) } else { self.clone().sample(u, y) }
    }
}

fn outputs(run: &mut Run, u: &[f64], y: &mut [f64]) {
    dispatch!(outputs_any, (run: &mut Run, u: &[f64], y: &mut [f64]));
}

/// As [`advance`] until the first stage of the first step.
#[inline(always)]
fn outputs_any<const FMA: bool>(run: &mut Run, u: &[f64], y: &mut [f64]) {
    let Run { plant, layout, segments, control, buffers, .. } = run;
    let (excitation, further) = u.split_at(plant.driven);
    let Segment { scheme, age, .. } = &segments[0];
    at_once::<FMA, false>(plant, layout, buffers, scheme, &[], further);
    if let Some(control) = control {
        control.compute([excitation, further], &buffers.step[layout.y..], layout.width);
        at_once::<FMA, false>(plant, layout, buffers, scheme, control.coming(*age), further);
    }
    y.copy_from_slice(&buffers.step[layout.y..][..y.len()]);
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
    let Run { plant, layout, segments, control, late, buffers } = run;
    let (rows, whole) = (plant.rows, layout.width);
    let (excitation, further) = u.split_at(plant.driven);
    let mut fresh = true;
    for step in 0..control.as_ref().map_or(1, |control| control.steps) {
        if let Some(control) = control {
            // what the controller reads follows the further inputs at once, but no command
            let scheme = &segments[0].scheme;
            at_once::<FMA, SLOPES>(plant, layout, buffers, scheme, &[], further);
            control.update([excitation, further], &buffers.step[layout.y..], whole);
        }
        for Segment { scheme, steps, age, arrives, reads } in segments.iter() {
            let commands = control.as_ref().map_or(&[][..], |control| control.command(*age));
            if let (Some(row), Some(control), true) = (plant.late, control.as_ref(), arrives) {
                let earlier = control.command(age + 1);
                arrive::<FMA, SLOPES>(plant, layout, buffers, scheme, row, [earlier, commands], further);
            }
            for read in reads.iter().filter(|read| read.after == step) {
                look::<FMA, SLOPES>(plant, layout, buffers, scheme, read, [commands, further], y);
            }
            hold::<SLOPES>(plant, layout, buffers, scheme, commands, further);
            for _ in 0..*steps {
                start::<SLOPES>(plant, layout, buffers, scheme, whole);
                for s in 0..4 {
                    stage::<FMA, SLOPES>(plant, layout, buffers, scheme, s, whole);
                }
                finish::<SLOPES>(plant, layout, buffers, scheme);
                if fresh {
                    for (row, step) in buffers.step.chunks_exact(whole).enumerate() {
                        for (o, (y, value)) in y.chunks_exact_mut(rows).zip(&step[layout.y..]).enumerate() {
                            if !late.contains(&o) {
                                y[row] = *value;
                            }
                        }
                    }
                    fresh = false;
                }
                std::mem::swap(&mut buffers.step, &mut buffers.last);
            }
        }
    }
}

/// Without derivatives the compiler knows that there is one row.
#[inline(always)]
fn rows<const SLOPES: bool>(plant: &Plant) -> usize {
    if SLOPES { plant.rows } else { 1 }
}

/// What follows inputs at once: w of the blocks at the first stage, and y.
#[inline(always)]
fn at_once<const FMA: bool, const SLOPES: bool>(
    plant: &Plant,
    layout: &Layout,
    buffers: &mut Buffers,
    scheme: &Scheme,
    commands: &[f64],
    further: &[f64],
) {
    hold::<SLOPES>(plant, layout, buffers, scheme, commands, further);
    start::<SLOPES>(plant, layout, buffers, scheme, layout.y_end);
    stage::<FMA, SLOPES>(plant, layout, buffers, scheme, 0, layout.y_end);
}

/// What the inputs bring to the steps while they are held; the further ones do not depend on parameters.
#[inline(always)]
fn hold<const SLOPES: bool>(
    plant: &Plant,
    layout: &Layout,
    buffers: &mut Buffers,
    scheme: &Scheme,
    commands: &[f64],
    further: &[f64],
) {
    let Buffers { held, held_read, .. } = buffers;
    let (driven, width) = (plant.driven, layout.width);
    let all = if commands.is_empty() { 0 } else { rows::<SLOPES>(plant) };
    held[..all.max(1) * width].fill(0.0);
    accumulate(all, (commands, driven), &scheme.commands, (held, width), width);
    accumulate(1, (further, 0), &scheme.further, (held, width), width);
    if SLOPES {
        let reads = 4 * layout.read;
        held_read.fill(0.0);
        accumulate(all.min(1), (commands, 0), &scheme.read_commands, (held_read, reads), reads);
        accumulate(1, (further, 0), &scheme.read_further, (held_read, reads), reads);
    }
}

/// A command arrives. By its delay the state changes as `x'` with the command before less `x'` with the new one.
#[inline(always)]
fn arrive<const FMA: bool, const SLOPES: bool>(
    plant: &Plant,
    layout: &Layout,
    buffers: &mut Buffers,
    scheme: &Scheme,
    row: usize,
    commands: [&[f64]; 2],
    further: &[f64],
) {
    let (driven, blocks) = (plant.driven, plant.blocks.len());
    for (sign, commands) in [1.0, -1.0].into_iter().zip(commands) {
        at_once::<FMA, SLOPES>(plant, layout, buffers, scheme, commands, further);
        let acting = commands[..driven].iter().chain(&buffers.w[..blocks]);
        buffers.change.iter_mut().zip(acting).for_each(|(change, acting)| *change += sign * acting);
    }
    let x = &mut buffers.last[row * layout.width + layout.x..];
    let columns = (0..driven).chain(plant.inputs..plant.inputs + blocks);
    for (change, column) in buffers.change.iter_mut().zip(columns) {
        for (x, b) in x.iter_mut().zip(plant.b.column(column).iter()) {
            *x += b * *change;
        }
        *change = 0.0;
    }
}

/// Reads outputs at this instant. By its own time the state changes as `x'`.
#[inline(always)]
fn look<const FMA: bool, const SLOPES: bool>(
    plant: &Plant,
    layout: &Layout,
    buffers: &mut Buffers,
    scheme: &Scheme,
    read: &Read,
    [commands, further]: [&[f64]; 2],
    y: &mut [f64],
) {
    at_once::<FMA, SLOPES>(plant, layout, buffers, scheme, commands, further);
    let (width, blocks) = (layout.width, plant.blocks.len());
    if SLOPES && read.slopes.iter().any(|slope| *slope != 0.0) {
        let Buffers { last, kept, rates, w, .. } = buffers;
        kept.copy_from_slice(last);
        let x = &kept[layout.x..][..rates.len()];
        let inputs = commands[..plant.driven].iter().chain(further).chain(&w[..blocks]);
        let columns = plant.a.column_iter().zip(x).chain(plant.b.column_iter().zip(inputs));
        rates.fill(0.0);
        for (column, factor) in columns {
            rates.iter_mut().zip(column.iter()).for_each(|(rate, by)| *rate += by * factor);
        }
        for (slope, row) in read.slopes.iter().zip(last.chunks_exact_mut(width).skip(1)) {
            row[layout.x..].iter_mut().zip(&*rates).for_each(|(x, rate)| *x += slope * rate);
        }
        at_once::<FMA, SLOPES>(plant, layout, buffers, scheme, commands, further);
        std::mem::swap(&mut buffers.last, &mut buffers.kept);
    }
    for (row, step) in buffers.step.chunks_exact(width).enumerate() {
        read.outputs.iter().for_each(|o| y[o * plant.rows + row] = step[layout.y + o]);
    }
}

/// What follows from the state and the inputs alone, in the first `columns` of the step.
#[inline(always)]
fn start<const SLOPES: bool>(plant: &Plant, layout: &Layout, buffers: &mut Buffers, scheme: &Scheme, columns: usize) {
    let Buffers { step, last, w, held, read, held_read, .. } = buffers;
    let width = layout.width;
    step.copy_from_slice(held);
    accumulate(rows::<SLOPES>(plant), (&last[layout.x..], width), &scheme.start, (step, width), columns);
    if SLOPES {
        w.fill(0.0);
        let all = 4 * layout.read;
        read.copy_from_slice(held_read);
        accumulate(1, (&last[layout.x..], width), &scheme.read_start, (read, all), all);
    }
}

/// The blocks at one stage, and what they bring to the stages that follow, in the first `columns` of the step.
#[inline(always)]
fn stage<const FMA: bool, const SLOPES: bool>(
    plant: &Plant,
    layout: &Layout,
    buffers: &mut Buffers,
    scheme: &Scheme,
    s: usize,
    columns: usize,
) {
    let Buffers { step, w, slopes, by_coefficient, read, .. } = buffers;
    let (width, signals, (from, to)) = (layout.width, layout.signals[s], layout.reached[s]);
    let (to, blocks) = (to.min(columns), plant.blocks.len());
    let w_width = 4 * blocks;
    let w = &mut w[s * blocks..];
    for block in &plant.blocks {
        let first = signals + block.first;
        let mut z = [0.0; SIGNALS];
        z[..block.inputs].copy_from_slice(&step[first..first + block.inputs]);
        let (value, slope) = block.element.evaluate::<FMA, SLOPES>(z, &mut by_coefficient[..block.coefficients]);
        w[block.place] = value;
        if SLOPES {
            slopes[block.place] = slope;
            for (row, place) in &block.free {
                w[row * w_width + block.place] += by_coefficient[*place];
            }
        }
        for (z, factor) in &block.feeds {
            step[signals + z] += factor * value;
        }
    }
    if SLOPES {
        let read = &mut read[s * layout.read..];
        let later = scheme.read[s].columns;
        accumulate(1, (w, w_width), &scheme.read[s], (read, later), later);
        for (k, gain) in plant.gains.iter().enumerate() {
            let forced = gain.slope * read[k];
            let step = &mut step[gain.row * width..][..columns];
            add::<FMA>(forced, scheme.gains[s].row(k), &mut step[signals..]);
            add::<FMA>(forced, scheme.gains_end[s].row(k), &mut step[layout.x.min(columns)..]);
        }
        for row in 1..plant.rows {
            let step = &mut step[row * width..][..width];
            let w = &mut w[row * w_width..][..blocks];
            for block in &plant.blocks {
                let z = &step[signals + block.first..][..block.inputs];
                let mut sum = w[block.place];
                for (slope, z) in slopes[block.place].iter().zip(z) {
                    sum = fused::<FMA>(*slope, *z, sum);
                }
                w[block.place] = sum;
                for (z, factor) in &block.feeds {
                    step[signals + z] += factor * sum;
                }
            }
        }
    }
    accumulate(rows::<SLOPES>(plant), (w, w_width), &scheme.blocks[s], (&mut step[from..], width), to - from);
}

/// What the blocks bring to the state after the step.
#[inline(always)]
fn finish<const SLOPES: bool>(plant: &Plant, layout: &Layout, buffers: &mut Buffers, scheme: &Scheme) {
    let Buffers { step, w, .. } = buffers;
    let Layout { x, width, .. } = *layout;
    let all = 4 * plant.blocks.len();
    accumulate(rows::<SLOPES>(plant), (w, all), &scheme.blocks_end, (&mut step[x..], width), width - x);
}
