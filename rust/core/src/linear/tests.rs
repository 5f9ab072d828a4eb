//! The modal path against the dense one, and which of the two a loop takes by itself.

use super::*;
use crate::common::loops::{Problem, lags, oscillators};
use crate::common::machine::machine;
use crate::common::random::Random;
use crate::common::{deviation, slope_deviation};

const SAMPLES: usize = 300;

fn collect(response: &Response, inputs: usize, columns: usize, u: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; u.len() / inputs * columns];
    response
        .run(u, &mut |from, count, block, stride| {
            for (k, row) in block.chunks_exact(stride).take(count).enumerate() {
                out[(from + k) * columns..(from + k + 1) * columns].copy_from_slice(&row[..columns]);
            }
        })
        .expect("nobody stops it");
    out
}

fn dense(p: &Problem) -> Response {
    let (value, slopes) = discretise(&p.model, &p.theta, &p.free()).unwrap();
    Response::Dense(Dense::new(&value, &slopes))
}

/// Deviations of the modal from the dense path: response, derivatives. `None` where the loop takes the dense path.
fn modal_against_dense(p: &Problem, random: &mut Random) -> Option<(f64, f64)> {
    let response = Response::new(&p.model, &p.theta, &p.free()).expect("a stable loop");
    if matches!(response, Response::Dense(_)) {
        return None;
    }
    let (inputs, width) = (p.model.inputs(), 1 + p.theta.len());
    let columns = p.model.outputs() * width;
    let u = random.signal(SAMPLES * inputs);
    let found = collect(&response, inputs, columns, &u);
    let expected = collect(&dense(p), inputs, columns, &u);
    let pick = |all: &[f64], values: bool| -> Vec<f64> {
        (0..all.len()).filter(|i| (i % width == 0) == values).map(|i| all[i]).collect()
    };
    let (y, slopes) = (pick(&expected, true), pick(&expected, false));
    let outputs = p.model.outputs();
    Some((deviation(&pick(&found, true), &y, outputs), slope_deviation(&pick(&found, false), &slopes, &y, outputs)))
}

fn hold_against_each_other(loops: impl Iterator<Item = Problem>, random: &mut Random) {
    let (mut modal, mut all) = (0, 0);
    for (i, p) in loops.enumerate() {
        all += 1;
        if let Some((value, slope)) = modal_against_dense(&p, random) {
            modal += 1;
            assert!(value < 1e-10, "loop {i}: response off by {value:.1e}");
            assert!(slope < 1e-9, "loop {i}: derivatives off by {slope:.1e}");
        }
    }
    assert!(3 * modal > all, "only {modal} of {all} loops took the modal path");
}

#[test]
fn modal_is_dense_for_analog_loops() {
    let mut random = Random(1);
    let loops: Vec<_> = (0..200).map(|_| random.analog_loop()).collect();
    hold_against_each_other(loops.into_iter(), &mut random);
}

#[test]
fn modal_is_dense_for_digital_loops() {
    let mut random = Random(2);
    for delay in [0.0, 1.0, 2.5] {
        for steps in [1, 2] {
            let loops: Vec<_> = (0..50).map(|_| random.digital_loop(delay, steps)).collect();
            hold_against_each_other(loops.into_iter(), &mut random);
        }
    }
}

#[test]
fn modal_is_dense_for_machines() {
    let mut random = Random(4);
    for gyroscopic in [0.0, 30.0, 1000.0] {
        if let Some((value, slope)) = modal_against_dense(&machine(gyroscopic, 0.02), &mut random) {
            assert!(value < 1e-10 && slope < 1e-9, "{gyroscopic} rad/s: off by {value:.1e}, {slope:.1e}");
        }
    }
}

#[test]
fn loops_take_the_path_that_suits_them() {
    let modal = |p: &Problem| matches!(Response::new(&p.model, &p.theta, &p.free()), Ok(Response::Modal(_)));
    assert!(modal(&lags(&[0.7, 1.5], &[&[], &[0]], &[1])), "distinct poles");
    assert!(modal(&machine(100.0, 0.02)), "a machine at speed");
    let double = lags(&[0.7, 0.7], &[&[], &[0]], &[1]);
    assert!(!modal(&double), "a defective pole");
    assert!(!modal(&lags(&[0.7, 0.7], &[&[], &[]], &[0, 1])), "a repeated pole");
    assert!(!modal(&lags(&[0.7, 0.7 * (1.0 + 1e-7)], &[&[], &[0]], &[1])), "clustered poles");
    assert!(!modal(&machine(1e-9, 0.0)), "planes alike");
    assert!(!modal(&double.under_digital(0.1, 0.0, 0.0)), "a defective pole of a sampled loop");
    let queues = oscillators([3.0, 5.0], 0.1, [[0.0, 1.0], [1.0, 0.0]]).under_digital(0.1, 0.0, 1.0);
    assert!(!modal(&queues), "commands under way that nothing depends on: two poles at zero");
}
