//! Small loops with a known difficulty.

use ambid_core::{ClosedLoop, Controller, Gain, Lft, Model};
use nalgebra::DMatrix;

/// A loop, and parameters at which it is stable.
pub struct Problem {
    pub model: Model,
    pub theta: Vec<f64>,
}

impl Problem {
    /// All parameters.
    pub fn free(&self) -> Vec<usize> {
        (0..self.theta.len()).collect()
    }

    /// The same plant sampled every `dt`, under a digital proportional controller.
    pub fn under_digital(self, dt: f64, gain: f64, delay: f64) -> Self {
        let m = self.model.lft.inputs();
        let empty = DMatrix::zeros;
        let law = Controller::new(empty(0, 0), empty(0, m), empty(m, 0), DMatrix::identity(m, m) * gain);
        let controller = Controller { delay, ..law };
        let model = Model::new(self.model.lft, dt, Some(controller)).expect("consistent");
        Self { model, theta: self.theta }
    }

    pub fn system(&self) -> ClosedLoop {
        ClosedLoop::new(self.model.clone(), self.theta.len()).expect("consistent")
    }
}

/// `x_i' = (input_i - x_i) / theta_i`; `feeds[i]` lists the states that feed lag i, the excitation where it is empty.
///
/// The sum of the states in `read` is the only output.
pub fn lags(theta: &[f64], feeds: &[&[usize]], read: &[usize]) -> Problem {
    let n = theta.len();
    let b = DMatrix::from_fn(n, 1 + n, |i, j| f64::from(u8::from(j == 1 + i)));
    let mut c = DMatrix::zeros(1 + n, n);
    let mut d = DMatrix::zeros(1 + n, 1 + n);
    read.iter().for_each(|i| c[(0, *i)] = 1.0);
    for (i, feeds) in feeds.iter().enumerate() {
        c[(1 + i, i)] = -1.0;
        feeds.iter().for_each(|j| c[(1 + i, *j)] = 1.0);
        if feeds.is_empty() {
            d[(1 + i, 0)] = 1.0;
        }
    }
    let gains = (0..n).map(|parameter| Gain { parameter, scale: 1.0, power: -1 }).collect();
    let lft = Lft::new(DMatrix::zeros(n, n), b, c, d, gains).expect("consistent");
    Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta: theta.to_vec() }
}

/// Two oscillators of frequencies `theta` with damping ratio `zeta`; each is pushed by `push` times the other's
/// displacement (row: receiver), and by an excitation of its own. Both displacements are read.
pub fn oscillators(theta: [f64; 2], zeta: f64, push: [[f64; 2]; 2]) -> Problem {
    // states s_0, v_0, s_1, v_1; s' = omega v, v' = -omega s - 2 zeta omega v + push + excitation
    let mut a = DMatrix::zeros(4, 4);
    let mut b = DMatrix::zeros(4, 6);
    let mut c = DMatrix::zeros(6, 4);
    let mut gains = Vec::new();
    for i in 0..2 {
        let (s, v) = (2 * i, 2 * i + 1);
        b[(v, i)] = 1.0;
        b[(s, 2 + s)] = 1.0;
        b[(v, 2 + v)] = 1.0;
        c[(i, s)] = 1.0;
        c[(2 + s, v)] = 1.0;
        c[(2 + v, s)] = -1.0;
        c[(2 + v, v)] = -2.0 * zeta;
        gains.extend([Gain { parameter: i, scale: 1.0, power: 1 }; 2]);
        for j in 0..2 {
            a[(v, 2 * j)] += push[i][j];
        }
    }
    let lft = Lft::new(a, b, c, DMatrix::zeros(6, 6), gains).expect("consistent");
    Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta: theta.to_vec() }
}
