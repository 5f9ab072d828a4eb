//! Seeded random numbers and random stable loops.

use ambid_core::{Controller, Gain, GainError, Lft, Model};
use nalgebra::DMatrix;

use super::loops::Problem;

/// SplitMix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `from..to`.
    pub fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// One of the choices.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[(self.bits() % choices.len() as u64) as usize]
    }

    /// Entries uniform in -1..1.
    pub fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.between(-1.0, 1.0))
    }

    /// An excitation that jumps between -1 and 1 in every sample.
    pub fn signal(&mut self, length: usize) -> Vec<f64> {
        (0..length).map(|_| self.pick(&[-1.0, 1.0])).collect()
    }

    /// An analog loop of up to eight states whose closed form is stable, with feedthrough everywhere.
    pub fn analog_loop(&mut self) -> Problem {
        let (inputs, outputs) = (self.pick(&[1, 2, 3]), self.pick(&[1, 2, 3]));
        let (lft, theta) = self.plant(inputs, 0, outputs);
        Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta }
    }

    /// A stable plant with up to two inputs of its own, under a digital controller whose gain is low enough for the
    /// loop to stay stable. Some have a part of the delay as their last parameter.
    pub fn digital_loop(&mut self, delay: f64, steps: usize) -> Problem {
        loop {
            let problem = self.any_digital_loop(delay, steps);
            let poles = problem.system().poles(&problem.theta).expect("finite");
            if poles.iter().all(|p| p.re < -0.05) {
                return problem;
            }
        }
    }

    fn any_digital_loop(&mut self, delay: f64, steps: usize) -> Problem {
        let channels = self.pick(&[1, 2]);
        let (inputs, outputs) = (channels + self.pick(&[0, 1, 2]), channels + self.pick(&[0, 1, 2]));
        let (lft, mut theta) = self.plant(inputs, channels, outputs);
        let (states, share, dt) = (self.pick(&[0, 1, 3]), self.between(0.2, 1.0), 0.1);
        let late = self.pick(&[None, Some(theta.len())]);
        theta.extend(late.map(|_| share * delay * dt / steps as f64));
        let errors = self.gain_errors(&mut theta, states, channels);
        let (a, b) = (self.matrix(states, states) * 0.3, self.matrix(states, channels) * 0.3);
        let (c, d) = (self.matrix(channels, states) * 0.3, self.matrix(channels, channels) * 0.3);
        let controller = Controller {
            delay: if late.is_some() { (1.0 - share) * delay } else { delay },
            late,
            hidden: self.pick(&[0, 1]).min(outputs - 1),
            steps,
            excitation: self.matrix(channels, channels),
            errors,
            ..Controller::new(a, b, c, d)
        };
        Problem { model: Model::new(lft, dt, Some(controller)).expect("consistent"), theta }
    }

    /// None, or two that share a parameter and one of another, or of the plant's first.
    fn gain_errors(&mut self, theta: &mut Vec<f64>, states: usize, channels: usize) -> Vec<GainError> {
        if self.pick(&[false, true]) {
            return vec![];
        }
        let (first, other) = (theta.len(), self.pick(&[0, theta.len() + 1]));
        theta.extend((first..=first.max(other)).map(|_| self.between(-0.5, 0.5)));
        let error = |parameter| GainError {
            parameter,
            c: self.matrix(channels, states) * 0.3,
            d: self.matrix(channels, channels) * 0.3,
            excitation: self.matrix(channels, channels) * self.pick(&[0.0, 1.0]),
        };
        [first, first, other].map(error).into()
    }

    /// An LFT and parameters that it is stable at; the first `channels` outputs do not follow as many inputs at once.
    fn plant(&mut self, inputs: usize, channels: usize, outputs: usize) -> (Lft, Vec<f64>) {
        let (n, gains, parameters) = (2 * self.pick(&[1, 2, 3, 4]), self.pick(&[1, 2, 3, 4]), self.pick(&[1, 2, 3]));
        let theta: Vec<f64> = (0..parameters).map(|_| self.between(0.5, 2.0)).collect();
        let gains: Vec<Gain> = (0..gains)
            .map(|_| Gain {
                parameter: self.pick(&[0, 1, 2]) % parameters,
                scale: self.between(0.2, 1.0),
                power: self.pick(&[1, -1, 2]),
            })
            .collect();
        let k = gains.len();
        let b = self.matrix(n, inputs + k);
        let c = self.matrix(outputs + k, n);
        let mut d = self.matrix(outputs + k, inputs + k) * self.pick(&[0.0, 0.5]);
        // a displacement may follow a further input at once, and that through Delta too where no command gets there
        d.view_mut((0, 0), (channels, channels)).fill(0.0);
        match self.pick(&[false, true]) {
            true => d.view_mut((outputs, 0), (k, channels)).fill(0.0),
            false => d.view_mut((0, inputs), (channels, k)).fill(0.0),
        }
        // algebraic loops between the ports of Delta, far from singular
        let mut ports = d.view_mut((outputs, inputs), (k, k));
        ports *= 0.3 / k as f64;

        let delta = DMatrix::from_fn(k, k, |i, j| if i == j { gains[i].value(&theta) } else { 0.0 });
        let inverse = DMatrix::identity(k, k) - d.view((outputs, inputs), (k, k)) * &delta;
        let inverse = inverse.try_inverse().expect("diagonally dominant");
        let a = self.stable(n) - b.columns(inputs, k) * delta * inverse * c.rows(outputs, k);
        (Lft::new(a, b, c, d, gains).expect("consistent"), theta)
    }

    /// A matrix whose eigenvalues, pairs and real ones, lie well inside the left half-plane.
    fn stable(&mut self, n: usize) -> DMatrix<f64> {
        let mut a = DMatrix::zeros(n, n);
        for i in (0..n).step_by(2) {
            let (decay, other) = (self.between(-2.0, -0.1), self.between(-2.0, -0.1));
            let omega = self.pick(&[0.0, 1.0]) * self.between(0.3, 10.0);
            a[(i, i)] = decay;
            a[(i + 1, i + 1)] = if omega == 0.0 { other } else { decay };
            a[(i, i + 1)] = omega;
            a[(i + 1, i)] = -omega;
        }
        let turn = DMatrix::identity(n, n) + self.matrix(n, n) * (0.5 / n as f64);
        &turn * a * turn.clone().try_inverse().expect("diagonally dominant")
    }
}
