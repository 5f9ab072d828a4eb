//! A loop on lines of the spectrum: what the discrete Fourier transform of any stretch of a record must be.
//!
//! With held inputs, `x[k+1] = A x[k] + B u[k]`, `z[k] = C x[k] + D u[k]`, the transform over N samples obeys, whether
//! they repeat or not and whatever came before,
//!
//! ```text
//! Z(l) = (C (w I - A)^-1 B + D) U(l) + w C (w I - A)^-1 d,    w = exp(2 pi i l / N),    d = (x[0] - x[N]) / sqrt(N),
//! ```
//!
//! Z and U being sums over `exp(-2 pi i l k / N)`, over the root of N. The transient d is unknown, real, one number a
//! state. The cost goes with the lines, not with the samples. Of signals times `r^-k`, r > 1, it holds on the circle of
//! radius r: every pole is then damped by ln r more, and only those beyond that circle count as unstable.
//!
//! Of an output that is recorded late by whole samples all of this is multiplied by `w^-m`, as if the record were a
//! circle; what it holds of the time before the first sample, or behind the last one, is of no stretch that is known:
//! so many numbers of d more, each of one sample.

mod dense;
mod modal;
mod triangular;

use nalgebra::Complex;

use crate::closed_loop::ClosedLoop;
use crate::discretise::discretise;
use crate::eigen::eigenvalues;
use crate::error::{Error, Result, check_len};
use crate::linear::stable;
use crate::modal::Modal;
use crate::reading::shifts;
use crate::split::Part;
use crate::stop::go_on;

type C64 = Complex<f64>;

/// Lines that are worked on at a time.
pub(crate) const BLOCK: usize = 48;
/// Lines whose transfer matrices of one part are held at a time.
const AT_A_TIME: usize = 100 * BLOCK;

/// The response of a loop on lines.
#[derive(Debug, Clone)]
pub struct LineResponse {
    /// Lines x outputs, transient included.
    pub response: Vec<C64>,
    /// Lines x outputs x `free`: derivatives, those of the transient with `d` held included.
    pub slopes: Vec<C64>,
    /// Lines x outputs x states: what a unit of each number of `d` adds; empty where it was not asked for.
    pub basis: Vec<C64>,
}

/// What a part does on a block of lines.
#[derive(Debug, Default)]
pub(crate) struct Block {
    /// Lines x `stride`: outputs x `[value, slopes..]`, real parts, and from `half` on imaginary ones.
    pub columns: Vec<f64>,
    pub stride: usize,
    pub half: usize,
    /// What a part weights to get there.
    rows: Vec<f64>,
    with_basis: bool,
    /// Lines x outputs x states, real parts, then imaginary parts; see [`OnLines::of_loop`]. Empty if not asked for.
    pub basis: [Vec<f64>; 2],
}

impl Block {
    pub fn new(with_basis: bool) -> Self {
        Self { with_basis, ..Self::default() }
    }
}

/// A part of a loop at one parameter set.
pub(crate) struct OnLines<'a> {
    way: Way,
    pub inputs: &'a [usize],
    pub outputs: &'a [usize],
    /// Positions in the caller's `free` of the parameters that act on this part.
    pub free: Vec<usize>,
    /// Whole samples by which the outputs are recorded late; empty where none is.
    shifts: Vec<isize>,
    /// The outputs, and samples counted around the circle, that are not known from the stretch.
    unknown: Vec<(usize, isize)>,
}

enum Way {
    Modal(Box<modal::Poles>),
    Dense(Box<dense::Dense>),
}

/// Refuses poles that are not within a circle about zero; the unit circle is that of stability.
fn within(radius: f64, mu: &[C64], dt: f64) -> Result<()> {
    let scaled: Vec<C64> = mu.iter().map(|mu| mu.unscale(radius)).collect();
    stable(&scaled, dt)
}

/// Of the circle that points lie on or outside of: 1 for lines, more for those of a signal that was damped.
pub(crate) fn radius(w: &[C64]) -> f64 {
    w.iter().map(|w| w.norm()).reduce(f64::min).unwrap_or(1.0).max(1.0)
}

impl<'a> OnLines<'a> {
    /// # Errors
    /// [`Error::Unstable`] where a pole is not within the circle of the points; else as [`ClosedLoop::poles`].
    fn new(part: &'a Part, theta: &[f64], free: &[usize], radius: f64, values_only: bool) -> Result<Self> {
        let acts = |parameter: usize| part.model.parameters().any(|p| p == parameter);
        let own: Vec<usize> = (0..free.len()).filter(|j| acts(free[*j])).collect();
        let parameters: Vec<usize> = own.iter().map(|j| free[*j]).collect();
        if !part.model.lft.blocks.is_empty() && !own.is_empty() {
            return Err(Error::Singular { what: "a nonlinear loop has no derivatives on lines" });
        }
        let way = match Modal::new(&part.model, theta, &parameters, values_only)? {
            Some(modal) => {
                within(radius, &modal.value.mu, part.model.dt)?;
                Way::Modal(Box::new(modal::Poles::new(&modal)))
            }
            None => {
                let (value, slopes) = discretise(&part.model, theta, &parameters)?;
                within(radius, &eigenvalues(&value.a)?, part.model.dt)?;
                Way::Dense(Box::new(dense::Dense::new(value, slopes)?))
            }
        };
        let shifts = shifts(&part.model, theta)?;
        let shifts = if shifts.iter().any(|m| *m != 0) { shifts } else { Vec::new() };
        let unknown =
            shifts.iter().enumerate().flat_map(|(o, m)| (0.min(*m)..0.max(*m)).map(move |k| (o, k))).collect();
        Ok(Self { way, inputs: &part.inputs, outputs: &part.outputs, free: own, shifts, unknown })
    }

    /// Numbers of a transient: its states, then samples of outputs that are late.
    pub fn states(&self) -> usize {
        self.own_states() + self.unknown.len()
    }

    fn own_states(&self) -> usize {
        match &self.way {
            Way::Modal(poles) => poles.states(),
            Way::Dense(dense) => dense.states(),
        }
    }

    /// Takes what [`OnLines::run`] found of a transient, a row of the basis or a combination, to the numbers of `d`.
    pub fn of_loop(&self, x: &mut [f64]) {
        if let Way::Dense(dense) = &self.way {
            dense.of_loop(&mut x[..self.own_states()]);
        }
    }

    /// Lines x outputs x inputs of this part.
    fn transfer(&self, w: &[C64]) -> Result<Vec<C64>> {
        let mut found = match &self.way {
            Way::Modal(poles) => poles.transfer(w)?,
            Way::Dense(dense) => dense.transfer(w)?,
        };
        let inputs = self.inputs.len();
        for (l, o, turn) in self.turns(w) {
            let from = (l * self.outputs.len() + o) * inputs;
            found[from..from + inputs].iter_mut().for_each(|g| *g *= turn);
        }
        Ok(found)
    }

    /// At most [`BLOCK`] points `w` with the inputs of the whole loop there; `d` is this part's own.
    pub fn run(&self, w: &[C64], u: &[C64], inputs: usize, d: &[f64], block: &mut Block) {
        let own: Vec<C64> = u.chunks_exact(inputs).flat_map(|u| self.inputs.iter().map(|i| u[*i])).collect();
        let (free, samples) = if d.is_empty() { (d, d) } else { d.split_at(self.own_states()) };
        match &self.way {
            Way::Modal(poles) => poles.run(w, &own, free, block),
            Way::Dense(dense) => dense.run(w, &own, free, block),
        }
        if !self.unknown.is_empty() {
            self.delay(w, samples, block);
        }
    }

    /// What outputs that are late by whole samples make of a block: [`OnLines::run`] without them gave it.
    fn delay(&self, w: &[C64], samples: &[f64], block: &mut Block) {
        let Block { columns, stride, half, basis: [re, im], .. } = block;
        let (width, n, ny) = (1 + self.free.len(), self.own_states(), self.outputs.len());
        let has_basis = block.with_basis;
        for (l, o, turn) in self.turns(w) {
            let (real, imaginary) = columns[l * *stride..(l + 1) * *stride].split_at_mut(*half);
            let own = o * width..(o + 1) * width;
            multiply(&mut real[own.clone()], &mut imaginary[own], turn);
            if has_basis {
                let own = (l * ny + o) * n..(l * ny + o + 1) * n;
                multiply(&mut re[own.clone()], &mut im[own], turn);
            }
        }
        let sample = |l: usize, k: isize| w[l].powi(-k as i32);
        for (number, (o, k)) in samples.iter().zip(&self.unknown) {
            for (l, columns) in columns.chunks_exact_mut(*stride).enumerate().take(w.len()) {
                columns[o * width] += number * sample(l, *k).re;
                columns[*half + o * width] += number * sample(l, *k).im;
            }
        }
        if has_basis {
            let beside = |from: &[f64], part: fn(C64) -> f64| -> Vec<f64> {
                let row = |at: usize| {
                    let own =
                        move |(o, k): &(usize, isize)| if *o == at % ny { part(sample(at / ny, *k)) } else { 0.0 };
                    from[at * n..(at + 1) * n].iter().copied().chain(self.unknown.iter().map(own))
                };
                (0..w.len() * ny).flat_map(row).collect()
            };
            (*re, *im) = (beside(re, |x| x.re), beside(im, |x| x.im));
        }
    }

    /// By what every line and output that is late by whole samples is multiplied.
    fn turns(&self, w: &[C64]) -> impl Iterator<Item = (usize, usize, C64)> {
        let late = self.shifts.iter().enumerate().filter(|(_, m)| **m != 0);
        late.flat_map(move |(o, m)| w.iter().enumerate().map(move |(l, w)| (l, o, w.powi(-*m as i32))))
    }
}

/// Multiplies complex numbers, real and imaginary parts apart.
fn multiply(re: &mut [f64], im: &mut [f64], by: C64) {
    for (re, im) in re.iter_mut().zip(im) {
        (*re, *im) = (*re * by.re - *im * by.im, *re * by.im + *im * by.re);
    }
}

impl ClosedLoop {
    /// Every part on lines, with the derivatives by those of `free` that act on it.
    ///
    /// Transients are given in states that depend on the way which is taken: not where there are `values_only`.
    pub(crate) fn on_lines(
        &self,
        theta: &[f64],
        free: &[usize],
        radius: f64,
        values_only: bool,
    ) -> Result<Vec<OnLines<'_>>> {
        self.check(theta, free)?;
        let parts = self.each_part().iter().filter(|p| !p.inputs.is_empty());
        parts.map(|part| OnLines::new(part, theta, free, radius, values_only)).collect()
    }

    /// The response at points `w` of the unit circle to inputs `u` (lines x inputs) and a transient `d`.
    ///
    /// `d` has a number per state, or none at all for no transient. Nonlinear blocks are linearised at rest; then
    /// `free` must be empty.
    ///
    /// # Errors
    /// [`Error::Unstable`], [`Error::Shape`], and as [`ClosedLoop::poles`].
    pub fn lines(
        &self,
        theta: &[f64],
        free: &[usize],
        w: &[C64],
        u: &[C64],
        d: &[f64],
        with_basis: bool,
    ) -> Result<LineResponse> {
        let (ny, np, inputs) = (self.outputs(), free.len(), self.inputs());
        check_len("inputs on lines", u.len(), w.len() * inputs)?;
        let parts = self.on_lines(theta, free, radius(w), free.is_empty() && d.is_empty() && !with_basis)?;
        let states: usize = parts.iter().map(OnLines::states).sum();
        if !d.is_empty() {
            check_len("transient", d.len(), states)?;
        }
        let zero = C64::from(0.0);
        let mut found = LineResponse {
            response: vec![zero; w.len() * ny],
            slopes: vec![zero; w.len() * ny * np],
            basis: vec![zero; if with_basis { w.len() * ny * states } else { 0 }],
        };
        let (mut at, mut block) = (0, Block::new(with_basis));
        for part in &parts {
            let (n, own) = (part.states(), part.outputs.len());
            let d = if d.is_empty() { d } else { &d[at..at + n] };
            for (b, (w, u)) in w.chunks(BLOCK).zip(u.chunks(BLOCK * inputs.max(1))).enumerate() {
                go_on()?;
                part.run(w, u, inputs, d, &mut block);
                for l in 0..w.len() {
                    let row = &block.columns[l * block.stride..];
                    for (i, o) in part.outputs.iter().enumerate() {
                        let place = (b * BLOCK + l) * ny + o;
                        let number = |k: usize| C64::new(row[k], row[block.half + k]);
                        let first = i * (1 + part.free.len());
                        found.response[place] = number(first);
                        for (j, free) in part.free.iter().enumerate() {
                            found.slopes[place * np + free] = number(first + 1 + j);
                        }
                        if with_basis {
                            let from = (l * own + i) * n..(l * own + i + 1) * n;
                            let mut sides = [&block.basis[0], &block.basis[1]].map(|side| side[from.clone()].to_vec());
                            sides.iter_mut().for_each(|side| part.of_loop(side));
                            let to = &mut found.basis[place * states + at..][..n];
                            let sides = sides[0].iter().zip(&sides[1]);
                            to.iter_mut().zip(sides).for_each(|(to, (re, im))| *to = C64::new(*re, *im));
                        }
                    }
                }
            }
            at += n;
        }
        Ok(found)
    }

    /// The transfer matrix at points `w` of the unit circle: lines x outputs x inputs.
    ///
    /// # Errors
    /// As [`ClosedLoop::lines`].
    pub fn transfer(&self, theta: &[f64], w: &[C64]) -> Result<Vec<C64>> {
        let (ny, nu) = (self.outputs(), self.inputs());
        let mut found = vec![C64::from(0.0); w.len() * ny * nu];
        for part in self.on_lines(theta, &[], radius(w), true)? {
            let inner = part.outputs.len() * part.inputs.len();
            for (w, found) in w.chunks(AT_A_TIME).zip(found.chunks_mut(AT_A_TIME * ny * nu)) {
                let own = part.transfer(w)?;
                for (own, found) in own.chunks_exact(inner).zip(found.chunks_exact_mut(ny * nu)) {
                    for (i, o) in part.outputs.iter().enumerate() {
                        let row = &own[i * part.inputs.len()..];
                        part.inputs.iter().zip(row).for_each(|(a, own)| found[o * nu + a] = *own);
                    }
                }
            }
        }
        Ok(found)
    }

    /// What the transient `d` of `length` samples adds in time: the free response from the first sample on.
    ///
    /// With `e = (I - A^length)^-1 d sqrt(length)`, it is `C A^k e`; the rest is the periodic response to the inputs of
    /// those samples. Samples x outputs, row by row.
    ///
    /// # Errors
    /// As [`ClosedLoop::lines`].
    pub fn free_response(&self, theta: &[f64], d: &[f64], length: usize, samples: usize) -> Result<Vec<f64>> {
        let ny = self.outputs();
        let parts = self.on_lines(theta, &[], 1.0, false)?;
        check_len("transient", d.len(), parts.iter().map(OnLines::states).sum())?;
        let mut y = vec![0.0; samples * ny];
        let mut at = 0;
        for part in &parts {
            let (own, unknown) = d[at..at + part.states()].split_at(part.own_states());
            at += part.states();
            // on lines the stretch is a circle, and so is what is late by whole samples
            let samples = if part.shifts.is_empty() { samples } else { samples.max(length) };
            let free = match &part.way {
                Way::Modal(poles) => poles.free_response(own, length, samples)?,
                Way::Dense(dense) => dense.free_response(own, length, samples)?,
            };
            let (own, late) = (part.outputs.len(), |o: usize| part.shifts.get(o).copied().unwrap_or(0));
            for (k, y) in y.chunks_exact_mut(ny).enumerate() {
                for (i, o) in part.outputs.iter().enumerate() {
                    let k = if late(i) == 0 { k } else { (k as isize - late(i)).rem_euclid(length as isize) as usize };
                    y[*o] = free[k * own + i];
                }
            }
            for (number, (i, k)) in unknown.iter().zip(&part.unknown) {
                let k = k.rem_euclid(length as isize) as usize;
                if let Some(y) = y.get_mut(k * ny + part.outputs[*i]) {
                    *y += number * (length as f64).sqrt();
                }
            }
        }
        Ok(y)
    }
}
