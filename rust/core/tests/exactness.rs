//! Response and sensitivities against a reference that shares no code with the core, on ordinary and awkward loops.

mod common;

use ambid_core::{Controller, Lft, Model};
use common::loops::{Problem, lags, oscillators};
use common::random::Random;
use common::{deviation, reference, slope_deviation};
use nalgebra::{DMatrix, DVector};

const SAMPLES: usize = 200;

fn assert_exact(p: &Problem, random: &mut Random, what: &str) {
    let (system, free) = (p.system(), p.free());
    let u = random.signal(SAMPLES * system.inputs());
    let (y, jacobian) = system.sensitivity(&p.theta, &free, &u).unwrap_or_else(|e| panic!("{what}: {e}"));
    let simulated = system.simulate(&p.theta, &u).expect("as before");
    let (expected, slopes) = reference::sensitivity(&p.model, &p.theta, &free, &u);
    let outputs = system.outputs();
    for y in [&y, &simulated] {
        let error = deviation(y, &expected, outputs);
        assert!(error < 1e-9, "{what}: response off by {error:.1e}");
    }
    let error = slope_deviation(&jacobian, &slopes, &expected, outputs);
    assert!(error < 1e-9, "{what}: sensitivities off by {error:.1e}");
}

#[test]
fn random_analog_loops() {
    let mut random = Random(11);
    for i in 0..60 {
        let p = random.analog_loop();
        assert_exact(&p, &mut random, &format!("loop {i}"));
    }
}

#[test]
fn random_digital_loops() {
    let mut random = Random(12);
    for delay in [0.0, 0.3, 1.0, 2.5] {
        for steps in [1, 2] {
            for i in 0..12 {
                let p = random.digital_loop(delay, steps);
                assert_exact(&p, &mut random, &format!("loop {i}, delay {delay}, {steps} steps"));
            }
        }
    }
}

/// Errors of the gains at their values are a controller that has these gains; another excitation acts.
#[test]
fn gain_errors_are_a_controller_with_other_gains() {
    let (mut random, mut erring) = (Random(17), 0);
    for (delay, steps) in [(0.0, 1), (0.3, 2), (2.5, 1)] {
        for i in 0..12 {
            let p = random.digital_loop(delay, steps);
            let mut k = p.model.controller.clone().expect("digital");
            let errors = std::mem::take(&mut k.errors);
            for error in &errors {
                let theta = p.theta[error.parameter];
                k.c += &error.c * theta;
                k.d += &error.d * theta;
                k.excitation += &error.excitation * theta;
            }
            erring += usize::from(!errors.is_empty());
            let m = k.channels();
            let acts = std::mem::replace(&mut k.excitation, DMatrix::identity(m, m));
            let model = Model::new(p.model.lft.clone(), p.model.dt, Some(k)).expect("consistent");
            let plain = Problem { model, theta: p.theta.clone() }.system();
            let mut u = random.signal(SAMPLES * plain.inputs());
            let y = p.system().simulate(&p.theta, &u).expect("stable");
            for u in u.chunks_exact_mut(plain.inputs()) {
                let acting = &acts * DVector::from_column_slice(&u[..m]);
                u[..m].copy_from_slice(acting.as_slice());
            }
            let error = deviation(&y, &plain.simulate(&p.theta, &u).expect("stable"), plain.outputs());
            assert!(error < 1e-10, "loop {i}, delay {delay}, {steps} steps: off by {error:.1e}");
        }
    }
    assert!(erring > 10, "{erring} loops with errors");
}

/// A loop that is closed already, its excitation late by a parameter: its poles are those of the loop alone.
#[test]
fn random_analog_loops_with_a_late_excitation() {
    let mut random = Random(16);
    for delay in [0.0, 0.4, 1.0, 3.7] {
        for i in 0..12 {
            let p = random.digital_loop(0.0, 1);
            let (m, lft, dt) = (p.model.controller.as_ref().expect("digital").channels(), &p.model.lft, p.model.dt);
            let empty = DMatrix::zeros;
            let (a, b, c, d) = (empty(0, 0), empty(0, m), empty(m, 0), empty(m, m));
            let theta: Vec<f64> = p.theta.iter().copied().chain([delay * dt]).collect();
            let late = Some(theta.len() - 1);
            let idle = Controller { late, ..Controller::new(a, b, c, d) };
            let with = |k| Problem { model: Model::new(lft.clone(), dt, k).expect("consistent"), theta: theta.clone() };
            let (analog, p) = (with(None), with(Some(idle)));
            assert_exact(&p, &mut random, &format!("loop {i}, delay {delay}"));
            assert_eq!(p.system().poles(&theta).expect("finite"), analog.system().poles(&theta).expect("finite"));
        }
    }
}

/// Under a controller that does nothing at once, every input is held from sample to sample, as in an analog loop.
#[test]
fn a_digital_loop_without_feedback_is_the_analog_one() {
    let mut random = Random(15);
    for i in 0..20 {
        let p = random.digital_loop(0.0, 1);
        let controller = p.model.controller.as_ref().expect("digital");
        let idle = Controller {
            c: &controller.c * 0.0,
            d: &controller.d * 0.0,
            late: None,
            hidden: 0,
            excitation: DMatrix::identity(controller.channels(), controller.channels()),
            errors: vec![],
            ..controller.clone()
        };
        let model = |controller| Model::new(p.model.lft.clone(), p.model.dt, controller).expect("consistent");
        let system = |model| Problem { model, theta: p.theta.clone() }.system();
        let (digital, analog) = (system(model(Some(idle))), system(model(None)));
        assert_eq!(digital.inputs(), analog.inputs());
        let u = random.signal(SAMPLES * analog.inputs());
        let (Ok(y), Ok(expected)) = (digital.simulate(&p.theta, &u), analog.simulate(&p.theta, &u)) else {
            continue; // the plant needs the feedback
        };
        let error = deviation(&y, &expected, analog.outputs());
        assert!(error < 1e-10, "loop {i}: off by {error:.1e}");
    }
}

/// `x' = command + d - x`, read as `y = x + d/2`; inputs are excitation and d, in this order.
#[test]
fn a_digital_lag_follows_its_recursion() {
    let (a, b) = (DMatrix::from_element(1, 1, -1.0), DMatrix::from_element(1, 2, 1.0));
    let (c, d) = (DMatrix::from_element(1, 1, 1.0), DMatrix::from_row_slice(1, 2, &[0.0, 0.5]));
    let empty = DMatrix::<f64>::zeros;
    let (gain, d_gain) = (0.3, DMatrix::from_element(1, 1, 0.3));
    let (delay, steps) = (1.0, 2);
    let law = Controller::new(empty(0, 0), empty(0, 1), empty(1, 0), d_gain);
    let controller = Controller { delay, steps, ..law };
    let lft = Lft::new(a, b, c, d, vec![]).expect("consistent");
    let p = Problem { model: Model::new(lft, 0.2, Some(controller)).expect("consistent"), theta: vec![] };
    let u = Random(16).signal(2 * 40);
    let y = p.system().simulate(&[], &u).expect("stable");
    let (decay, mut x, mut last) = ((-0.1_f64).exp(), 0.0, 0.0);
    for (u, y) in u.chunks_exact(2).zip(y) {
        assert!((y - (x + 0.5 * u[1])).abs() < 1e-14);
        for _ in 0..2 {
            let command = u[0] - gain * (x + 0.5 * u[1]);
            x = decay * x + (1.0 - decay) * (last + u[1]);
            last = command;
        }
    }
}

/// `x' = command - x`, outputs `x` and `2 x`; the controller reads the first, half of the second, and less r.
#[test]
fn a_controller_reads_a_combination_of_outputs_and_inputs() {
    let (a, b) = (DMatrix::from_element(1, 1, -1.0), DMatrix::from_row_slice(1, 2, &[1.0, 0.0]));
    let (c, d) = (DMatrix::from_row_slice(2, 1, &[1.0, 2.0]), DMatrix::zeros(2, 2));
    let empty = DMatrix::<f64>::zeros;
    let law = Controller::new(empty(0, 0), empty(0, 1), empty(1, 0), DMatrix::from_element(1, 1, 0.3));
    let reads = DMatrix::from_row_slice(1, 2, &[1.0, 0.5]);
    let takes = DMatrix::from_row_slice(1, 2, &[0.0, -1.0]);
    let controller = Controller { reads, takes, steps: 2, ..law };
    let lft = Lft::new(a, b, c, d, vec![]).expect("consistent");
    let model = |controller| Model::new(lft.clone(), 0.2, Some(controller));
    let own_command = DMatrix::from_element(1, 1, 1.0);
    assert!(model(Controller { takes: own_command, ..controller.clone() }).is_err());
    assert!(model(Controller { reads: empty(1, 3), ..controller.clone() }).is_err());
    let p = Problem { model: model(controller).expect("consistent"), theta: vec![] };
    let u = Random(18).signal(2 * 40);
    let y = p.system().simulate(&[], &u).expect("stable");
    let (decay, mut x) = ((-0.1_f64).exp(), 0.0);
    for (u, y) in u.chunks_exact(2).zip(y.chunks_exact(2)) {
        assert!((y[0] - x).abs() < 1e-14 && (y[1] - 2.0 * x).abs() < 1e-14);
        for _ in 0..2 {
            x = decay * x + (1.0 - decay) * (u[0] - 0.3 * (2.0 * x - u[1]));
        }
    }
}

/// Two or three poles at a relative distance `gap`; at zero they are defective or repeated.
fn clusters(gap: f64) -> Vec<(&'static str, Problem)> {
    let (one, other, third) = (0.7, 0.7 * (1.0 + gap), 0.7 * (1.0 - gap));
    let swing = |push| oscillators([3.0, 3.0 * (1.0 + gap)], 0.1, push);
    vec![
        ("two lags in series", lags(&[one, other], &[&[], &[0]], &[1])),
        ("three lags in series", lags(&[one, other, third], &[&[], &[0], &[1]], &[2])),
        ("two lags side by side", lags(&[one, other], &[&[], &[]], &[0, 1])),
        ("oscillators in series", swing([[0.0, 0.0], [1.0, 0.0]])),
        ("oscillators that barely couple", oscillators([3.0, 3.0], 0.1, [[0.0, gap], [gap, 0.0]])),
        ("oscillators that couple crosswise", oscillators([3.0, 3.0], 0.1, [[0.0, gap], [-gap, 0.0]])),
    ]
}

/// No gap at all, then 1e-9 to 1e-1 in steps of a third of a decade.
fn gaps() -> impl Iterator<Item = f64> {
    std::iter::once(0.0).chain((0..25).map(|i| 10_f64.powf(-9.0 + f64::from(i) / 3.0)))
}

#[test]
fn clustered_and_defective_analog_loops() {
    let mut random = Random(13);
    for gap in gaps() {
        for (name, p) in clusters(gap) {
            assert_exact(&p, &mut random, &format!("{name}, gap {gap:.1e}"));
        }
    }
}

/// With a delay and next to no feedback, the commands under way are a second cluster, about zero.
#[test]
fn clustered_and_defective_digital_loops() {
    let mut random = Random(14);
    for gap in gaps().step_by(2) {
        for (dt, delay, gain) in
            [(0.1, 0.0, 0.0), (0.1, 0.0, 1e-3), (0.01, 1.0, 0.0), (0.1, 2.5, 1e-3), (0.1, 2.5, 0.1)]
        {
            for (name, p) in clusters(gap) {
                let what = format!("{name}, gap {gap:.1e}, dt {dt}, delay {delay}, gain {gain}");
                assert_exact(&p.under_digital(dt, gain, delay), &mut random, &what);
            }
        }
    }
}

/// The response of a lag of time constant tau to a step, and its derivative by tau.
#[test]
fn a_lag_follows_its_closed_form() {
    let tau = 0.7;
    let system = lags(&[tau], &[&[]], &[0]).system();
    let (y, jacobian) = system.sensitivity(&[tau], &[0], &[1.0; 50]).unwrap();
    for (k, (y, slope)) in y.iter().zip(jacobian).enumerate() {
        let t = 0.1 * k as f64;
        let decay = (-t / tau).exp();
        assert!((y - (1.0 - decay)).abs() < 1e-14, "sample {k}");
        assert!((slope + t / (tau * tau) * decay).abs() < 1e-13, "sample {k}");
    }
}
