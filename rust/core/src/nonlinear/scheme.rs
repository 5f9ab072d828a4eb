//! One step of the exponential Runge-Kutta method of order four of Krogstad (2005), as sums of rows.
//!
//! `x' = A x + B (u + w(z))`, u constant over the step h. With `P_j = h phi_j(h A) B` and `Q_j` those of half the step,
//! and w at the four stages called w0, wa, wb, wc:
//!
//! ```text
//! xa = e^(hA/2) x + Q_1 u + Q_1 w0
//! xb = e^(hA/2) x + Q_1 u + (Q_1 - 2 Q_2) w0 + 2 Q_2 wa
//! xc = e^(hA) x   + P_1 u + (P_1 - 2 P_2) w0 + 2 P_2 wb
//! x+ = e^(hA) x   + P_1 u + (P_1 - 3 P_2 + 4 P_3) w0 + (2 P_2 - 4 P_3) (wa + wb) + (4 P_3 - P_2) wc
//! ```
//!
//! Of the stages only the signals `z = C x + D (u + w)` are needed. A row of the step is `[z0 | y | za | zb | zc | x+]`,
//! each part filled up to whole vectors. It starts from x and u; each stage adds what its w brings to what follows.

use nalgebra::DMatrix;

use crate::error::Result;
use crate::nonlinear::phi::Phi;
use crate::nonlinear::plant::Plant;
use crate::product::LANES;

/// A matrix to the right of a row, row by row; its columns are those of the row that it is added to.
pub type Weights = Vec<f64>;

/// The step of one length.
#[derive(Debug, Clone)]
pub struct Scheme {
    /// x to the row of the step.
    pub start: Weights,
    /// u to the row of the step.
    pub held: Weights,
    /// w of the blocks at each stage to what follows the stage's z.
    pub blocks: [Weights; 4],
    /// w at the ports of gains at each stage to the stage's z and what follows.
    pub gains: [Weights; 4],
    /// x to z at the ports of free gains, at the four stages.
    pub read_start: Weights,
    /// u to the same.
    pub held_read: Weights,
    /// w of the blocks at each stage to z at the ports of gains, at this stage and those that follow.
    pub read: [Weights; 4],
}

/// Where the parts of a row of the step stand.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// z at each stage.
    pub signals: [usize; 4],
    /// What follows z of each stage.
    pub after: [usize; 4],
    pub y: usize,
    pub x: usize,
    pub width: usize,
    /// Width of z at the ports of gains at one stage.
    pub read: usize,
}

impl Layout {
    pub fn new(states: usize, outputs: usize, signals: usize, gains: usize) -> Self {
        let [x, y, z] = [states, outputs, signals].map(|count| count.next_multiple_of(LANES));
        let places = [0, z + y, 2 * z + y, 3 * z + y];
        Self {
            signals: places,
            after: [z, 2 * z + y, 3 * z + y, 4 * z + y],
            y: z,
            x: 4 * z + y,
            width: 4 * z + y + x,
            read: gains.next_multiple_of(LANES),
        }
    }
}

impl Scheme {
    /// # Errors
    /// As [`Phi::new`].
    pub fn new(plant: &Plant, h: f64) -> Result<Self> {
        let Plant { a, b, c_y, c_z, c_g, d_y, d_z, d_g, .. } = plant;
        let whole = Phi::new(a, b, h)?;
        let half = Phi::new(a, b, 0.5 * h)?;
        let ([p1, p2, p3], [q1, q2, _]) = (&whole.b, &half.b);
        let middle = p2 * 2.0 - p3 * 4.0;
        let none = DMatrix::zeros(b.nrows(), b.ncols());
        // what w of each stage brings to xa, xb, xc, x+
        let reach = [
            [q1.clone(), q1 - q2 * 2.0, p1 - p2 * 2.0, p1 - p2 * 3.0 + p3 * 4.0],
            [none.clone(), q2 * 2.0, none.clone(), middle.clone()],
            [none.clone(), none.clone(), p2 * 2.0, middle],
            [none.clone(), none.clone(), none, p3 * 4.0 - p2],
        ];
        let pick = |m: &DMatrix<f64>, (first, count)| m.columns(first, count).into_owned();
        let stage = |s: usize, ports, own: bool| {
            let mut parts = if own { vec![pick(d_z, ports)] } else { Vec::new() };
            if s == 0 {
                parts.push(pick(d_y, ports));
            }
            parts.extend(reach[s][s..3].iter().map(|x| c_z * pick(x, ports)));
            parts.push(pick(&reach[s][3], ports));
            stack(&parts)
        };
        let read = |s: usize, ports| {
            let later = reach[s][s..3].iter().map(|x| c_g * pick(x, ports));
            stack(&[pick(d_g, ports)].into_iter().chain(later).collect::<Vec<_>>())
        };
        let (e, half_e) = (&whole.exp, &half.exp);
        let u = plant.excitations();
        // what x and u bring to the signals of the four stages
        let by_x = |c: &DMatrix<f64>| {
            let early = c * half_e;
            [c.clone(), early.clone(), early, c * e]
        };
        let by_u = |c: &DMatrix<f64>, d: &DMatrix<f64>| {
            let d = pick(d, u);
            let early = c * pick(q1, u) + &d;
            [d.clone(), early.clone(), early, c * pick(p1, u) + d]
        };
        let row = |[z0, za, zb, zc]: [DMatrix<f64>; 4], y, x| stack(&[z0, y, za, zb, zc, x]);
        let stages = [0, 1, 2, 3];
        Ok(Self {
            start: row(by_x(c_z), c_y.clone(), e.clone()),
            held: row(by_u(c_z, d_z), pick(d_y, u), pick(p1, u)),
            blocks: stages.map(|s| stage(s, plant.block_ports(), false)),
            gains: stages.map(|s| stage(s, plant.gain_ports(), true)),
            read_start: stack(&by_x(c_g)),
            held_read: stack(&by_u(c_g, d_g)),
            read: stages.map(|s| read(s, plant.block_ports())),
        })
    }
}

/// The parts above each other, each filled up to whole vectors; column by column that is what a row is multiplied by.
fn stack(parts: &[DMatrix<f64>]) -> Weights {
    let heights = parts.iter().map(|p| p.nrows().next_multiple_of(LANES));
    let mut out = DMatrix::zeros(heights.clone().sum(), parts[0].ncols());
    let mut at = 0;
    for (part, height) in parts.iter().zip(heights) {
        out.rows_mut(at, part.nrows()).copy_from(part);
        at += height;
    }
    out.as_slice().to_vec()
}
