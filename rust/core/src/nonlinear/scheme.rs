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
//! each part filled up to whole vectors. It starts from x and u; each stage adds what its w brings to the signals that
//! follow, and at the end w of all stages goes to x+.

use nalgebra::DMatrix;

use crate::error::Result;
use crate::nonlinear::phi::Phi;
use crate::nonlinear::plant::Plant;
use crate::nonlinear::rows::Weights;
use crate::product::LANES;

/// The step of one length.
#[derive(Debug, Clone)]
pub struct Scheme {
    /// x to the row of the step.
    pub start: Weights,
    /// Commands, and the further inputs, to the row of the step.
    pub commands: Weights,
    pub further: Weights,
    /// w of the blocks at each stage to z of the stages that it reaches, that of the first stage also to y.
    pub blocks: [Weights; 4],
    /// w of the blocks at all stages to x+.
    pub blocks_end: Weights,
    /// w at the ports of gains at each stage to z of that stage, and like that of the blocks.
    pub gains: [Weights; 4],
    pub gains_end: [Weights; 4],
    /// x to z at the ports of free gains, at the four stages.
    pub read_start: Weights,
    /// Commands, and the further inputs, to the same.
    pub read_commands: Weights,
    pub read_further: Weights,
    /// w of the blocks at each stage to z at the ports of gains, at this stage and those that it reaches.
    pub read: [Weights; 4],
}

/// Where the parts of a row of the step stand.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// z at each stage.
    pub signals: [usize; 4],
    /// Begin and end of what w of each stage reaches, x+ aside.
    pub reached: [(usize, usize); 4],
    /// y follows z of the first stage.
    pub y: usize,
    pub y_end: usize,
    pub x: usize,
    pub width: usize,
    /// Width of z at the ports of gains at one stage.
    pub read: usize,
}

impl Layout {
    pub fn new(states: usize, outputs: usize, signals: usize, gains: usize) -> Self {
        let [x, y, z] = [states, outputs, signals].map(|count| count.next_multiple_of(LANES));
        let (y_end, end) = (z + y, 4 * z + y);
        let signals = [0, y_end, y_end + z, y_end + 2 * z];
        Self {
            signals,
            reached: [(z, end), (signals[2], signals[3]), (signals[3], end), (end, end)],
            y: z,
            y_end,
            x: end,
            width: end + x,
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
        // what w of each stage brings to the stages that it reaches, which follow it, and to x+
        let reach = [vec![q1.clone(), q1 - q2 * 2.0, p1 - p2 * 2.0], vec![q2 * 2.0], vec![p2 * 2.0], vec![]];
        let end = [p1 - p2 * 3.0 + p3 * 4.0, middle.clone(), middle, p3 * 4.0 - p2];
        let pick = |m: &DMatrix<f64>, (first, count)| m.columns(first, count).into_owned();
        let later = |s: usize, c: &DMatrix<f64>, ports| -> Vec<DMatrix<f64>> {
            reach[s].iter().map(|x| c * pick(x, ports)).collect()
        };
        let with_y = |s: usize, ports| {
            let y = (s == 0).then(|| pick(d_y, ports));
            y.into_iter().chain(later(s, c_z, ports))
        };
        let (blocks, gains) = (plant.block_ports(), plant.gain_ports());
        let of_blocks = |s: usize| Weights::new(blocks.1, &with_y(s, blocks).collect::<Vec<_>>());
        let of_gains = |s: usize| {
            let parts: Vec<_> = [pick(d_z, gains)].into_iter().chain(with_y(s, gains)).collect();
            Weights::new(gains.1, &parts)
        };
        let read = |s: usize| {
            let parts: Vec<_> = [pick(d_g, blocks)].into_iter().chain(later(s, c_g, blocks)).collect();
            Weights::new(blocks.1, &parts)
        };
        let mut all_blocks = DMatrix::zeros(a.nrows(), 4 * blocks.1);
        for (s, end) in end.iter().enumerate() {
            all_blocks.columns_mut(s * blocks.1, blocks.1).copy_from(&pick(end, blocks));
        }
        let (e, half_e) = (&whole.exp, &half.exp);
        // what x and u bring to the signals of the four stages
        let by_x = |c: &DMatrix<f64>| {
            let early = c * half_e;
            [c.clone(), early.clone(), early, c * e]
        };
        let by_u = |c: &DMatrix<f64>, d: &DMatrix<f64>, u| {
            let d = pick(d, u);
            let early = c * pick(q1, u) + &d;
            [d.clone(), early.clone(), early, c * pick(p1, u) + d]
        };
        let row = |depth, [z0, za, zb, zc]: [DMatrix<f64>; 4], y, x| Weights::new(depth, &[z0, y, za, zb, zc, x]);
        let held = |u: (usize, usize)| row(u.1, by_u(c_z, d_z, u), pick(d_y, u), pick(p1, u));
        let held_read = |u: (usize, usize)| Weights::new(u.1, &by_u(c_g, d_g, u));
        let stages = [0, 1, 2, 3];
        Ok(Self {
            start: row(a.nrows(), by_x(c_z), c_y.clone(), e.clone()),
            commands: held(plant.commands()),
            further: held(plant.further()),
            blocks: stages.map(of_blocks),
            blocks_end: Weights::new(4 * blocks.1, &[all_blocks]),
            gains: stages.map(of_gains),
            gains_end: stages.map(|s| Weights::new(gains.1, &[pick(&end[s], gains)])),
            read_start: Weights::new(a.nrows(), &by_x(c_g)),
            read_commands: held_read(plant.commands()),
            read_further: held_read(plant.further()),
            read: stages.map(read),
        })
    }
}
