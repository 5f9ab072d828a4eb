//! A rotor on two radial magnetic bearings under analog PID: 24 states, nine parameters, four axes.
//!
//! Axes are `A_zeta, A_eta, B_zeta, B_eta`; the parameters `K_i` of each axis, `K_s` of each axis, and `tau_e`.

use ambid_core::{Block, Coefficient, Controller, Curve, Gain, Law, Lft, Model};
use nalgebra::DMatrix;

use super::loops::Problem;

/// Mode shapes (mass-normalised) of translation, tilt and first bending at bearings A and B.
const SHAPES: [[f64; 2]; 3] = [[0.18, 0.18], [-0.35, 0.42], [0.12, 0.15]];
const BENDING: f64 = 2.0 * std::f64::consts::PI * 553.8;
const BENDING_DAMPING: f64 = 0.004;

// PID in A/m, A/(m s), A s/m, and the lag of its derivative in s
const PROPORTIONAL: f64 = 28_000.0;
const INTEGRAL: f64 = 200_000.0;
const DERIVATIVE: f64 = 60.0;
const FILTER: f64 = 1e-4;

/// States of a plane: three modes, their velocities, then per axis a current, an integral and a derivative filter.
const PLANE: usize = 12;
const AXES: usize = 4;

/// The machine, sampled at 10 kHz; outputs are the displacements and the current commands of the four axes.
///
/// `gyroscopic` couples the tilts of the two planes, in rad/s; at zero the planes do not act on each other. Nominal
/// values differ from axis to axis by `spread`; at zero the planes are alike and every pole is double.
pub fn machine(gyroscopic: f64, spread: f64) -> Problem {
    let (inputs, outputs, gains) = (AXES, 2 * AXES, 3 * AXES);
    let mut a = DMatrix::zeros(2 * PLANE, 2 * PLANE);
    let mut b = DMatrix::zeros(2 * PLANE, inputs + gains);
    let mut c = DMatrix::zeros(outputs + gains, 2 * PLANE);
    let mut d = DMatrix::zeros(outputs + gains, inputs + gains);
    let (force_current, force_displacement, lag) = (0, AXES, 2 * AXES);
    for plane in 0..2 {
        let mode = PLANE * plane;
        for q in 0..3 {
            a[(mode + q, mode + 3 + q)] = 1.0;
        }
        a[(mode + 5, mode + 2)] = -BENDING * BENDING;
        a[(mode + 5, mode + 5)] = -2.0 * BENDING_DAMPING * BENDING;
        let other_tilt = PLANE * (1 - plane) + 4;
        a[(mode + 4, other_tilt)] = if plane == 0 { -gyroscopic } else { gyroscopic };
        for bearing in 0..2 {
            let axis = 2 * bearing + plane;
            let [current, integral, filter] = [0, 1, 2].map(|s| mode + 6 + 3 * bearing + s);
            let (command, w) = (AXES + axis, |port: usize| inputs + port + axis);
            for (q, shape) in SHAPES.iter().enumerate() {
                let y = shape[bearing];
                b[(mode + 3 + q, w(force_current))] = y;
                b[(mode + 3 + q, w(force_displacement))] = y;
                c[(axis, mode + q)] = y;
                c[(outputs + force_displacement + axis, mode + q)] = y;
                c[(command, mode + q)] = -(PROPORTIONAL + DERIVATIVE / FILTER) * y;
                a[(integral, mode + q)] = y;
                a[(filter, mode + q)] = y / FILTER;
            }
            a[(filter, filter)] = -1.0 / FILTER;
            c[(command, integral)] = -INTEGRAL;
            c[(command, filter)] = DERIVATIVE / FILTER;
            d[(command, axis)] = 1.0;
            c[(outputs + force_current + axis, current)] = 1.0;
            // current' = (command - current) / tau_e
            b[(current, w(lag))] = 1.0;
            let port = outputs + lag + axis;
            c.set_row(port, &c.row(command).into_owned());
            c[(port, current)] = -1.0;
            d[(port, axis)] = 1.0;
        }
    }
    let entry = |port: usize| match port / AXES {
        2 => Gain { parameter: 2 * AXES, scale: 1.0, power: -1 },
        _ => Gain { parameter: port, scale: 1.0, power: 1 },
    };
    let vary = |axis: usize| 1.0 + spread * axis as f64;
    let mut theta: Vec<f64> = (0..AXES).map(|i| [180.0, 180.0, 240.0, 240.0][i] * vary(i)).collect();
    theta.extend((0..AXES).map(|i| [2.2e6, 2.2e6, 2.9e6, 2.9e6][i] * vary(i)));
    theta.push(4e-4);
    let lft = Lft::new(a, b, c, d, (0..gains).map(entry).collect()).expect("consistent");
    Problem { model: Model::new(lft, 1e-4, None).expect("consistent"), theta }
}

/// The machine under a digital PID at twice the rate of the record, its delay a tenth parameter.
///
/// Outputs are the displacements of the four axes.
pub fn digital(gyroscopic: f64, delay: f64) -> Problem {
    let Problem { model, mut theta } = machine(gyroscopic, 0.02);
    let lft = &model.lft;
    let plant: Vec<usize> = (0..2 * PLANE).filter(|i| !matches!(i % PLANE, 7 | 8 | 10 | 11)).collect();
    let rows: Vec<usize> = (0..AXES).chain(2 * AXES..5 * AXES).collect();
    let a = lft.a.select_rows(&plant).select_columns(&plant);
    let (b, d) = (lft.b.select_rows(&plant), lft.d.select_rows(&rows));
    let mut c = lft.c.select_rows(&rows).select_columns(&plant);
    // the amplifiers get the command itself
    for port in 3 * AXES..4 * AXES {
        (0..plant.len()).filter(|i| plant[*i] % PLANE < 6).for_each(|i| c[(port, i)] = 0.0);
    }
    let dt = model.dt;
    let (step, empty) = (dt / 2.0, DMatrix::zeros(2 * AXES, 2 * AXES));
    let held = (-step / FILTER).exp();
    let mut law = Controller::new(
        empty,
        DMatrix::zeros(2 * AXES, AXES),
        DMatrix::zeros(AXES, 2 * AXES),
        DMatrix::identity(AXES, AXES) * (PROPORTIONAL + DERIVATIVE / FILTER),
    );
    for axis in 0..AXES {
        let (integral, filter) = (2 * axis, 2 * axis + 1);
        (law.a[(integral, integral)], law.b[(integral, axis)]) = (1.0, step);
        (law.a[(filter, filter)], law.b[(filter, axis)]) = (held, 1.0 - held);
        (law.c[(axis, integral)], law.c[(axis, filter)]) = (INTEGRAL, -DERIVATIVE / FILTER);
    }
    let controller = Controller { steps: 2, late: Some(theta.len()), ..law };
    theta.push(delay * step);
    let lft = Lft::new(a, b, c, d, lft.gains.clone()).expect("consistent");
    Problem { model: Model::new(lft, dt, Some(controller)).expect("consistent"), theta }
}

/// The machine with a force law on its first `axes` axes; the strength is one more parameter.
pub fn saturating(gyroscopic: f64, axes: usize, substeps: Option<usize>) -> Problem {
    let Problem { model, mut theta } = machine(gyroscopic, 0.02);
    let lft = &model.lft;
    let (nu, ny, strength) = (lft.inputs(), lft.outputs(), theta.len());
    let mut b = lft.b.clone().resize_horizontally(lft.b.ncols() + axes, 0.0);
    let mut c = lft.c.clone().resize_vertically(lft.c.nrows() + 2 * axes, 0.0);
    for axis in 0..axes {
        // ports of the machine: K_i of the four axes, then K_s
        b.set_column(lft.b.ncols() + axis, &lft.b.column(nu + axis));
        c.set_row(lft.c.nrows() + 2 * axis, &lft.c.row(ny + axis));
        c.set_row(lft.c.nrows() + 2 * axis + 1, &lft.c.row(ny + 4 + axis));
    }
    let mut d = DMatrix::zeros(c.nrows(), b.ncols());
    d.view_mut((0, 0), lft.d.shape()).copy_from(&lft.d);
    let block = |axis: usize| {
        let parameter = Coefficient::Parameter;
        let coefficients = vec![parameter(axis), parameter(4 + axis), parameter(strength), Coefficient::Constant(0.4)];
        Block::new(Law::Force { curve: Curve::Tanh, single: false, bias: 6.0, held: 0.0, level: 1.0 }, coefficients)
            .expect("allowed")
    };
    let lft = Lft::with_blocks(lft.a.clone(), b, c, d, lft.gains.clone(), (0..axes).map(block).collect());
    theta.push(1.0);
    let model = Model { substeps, ..Model::new(lft.expect("consistent"), model.dt, None).expect("consistent") };
    Problem { model, theta }
}
