//! A packed model is the same model; bytes that are none are refused, whatever they are.

mod common;

use std::sync::Arc;

use ambid_core::{Block, Coefficient, Curve, Error, Gain, Law, Lft, Model, Packed, Stepper, Table};
use common::loops::{Problem, lags};
use common::machine::{digital, machine, saturating};
use common::random::Random;
use nalgebra::DMatrix;

fn packed(p: Problem) -> Packed {
    let names = |kind: &str, count: usize| (0..count).map(|k| format!("{kind}.{k}")).collect();
    let (inputs, outputs) = (names("u", p.model.inputs()), names("y", p.model.outputs()));
    Packed { inputs, outputs, parameters: names("theta", p.theta.len()), model: p.model, theta: p.theta }
}

/// A lag with a block of every kind beside it.
fn blocks() -> Problem {
    let grid = [(-1.0, 0.5, 5), (-1.0, 1.0, 3)];
    let table = Table::new(&grid, &(0..15).map(f64::from).collect::<Vec<_>>()).expect("a grid");
    let laws = [
        Law::Force { curve: Curve::Power, single: true, bias: 2.0, held: 0.1, level: 1.5 },
        Law::Limit,
        Law::BoucWen { coordinates: 2, rate_smoothing: 0.1, state_smoothing: 0.2 },
        Law::Stop { coordinates: 1, smoothing: 0.1 },
        Law::Table(Arc::new(table)),
        Law::Polynomial { inputs: 1, exponents: vec![[3, 0]] },
    ];
    let block = |law: Law| {
        let count = law.coefficients().len();
        let coefficients =
            (0..count).map(|k| if k == 0 { Coefficient::Parameter(1) } else { Coefficient::Constant(0.5) });
        Block::new(law, coefficients.collect()).expect("allowed")
    };
    let blocks: Vec<_> = laws.into_iter().map(block).collect();
    let signals: usize = blocks.iter().map(Block::inputs).sum();
    let (inputs, rows) = (2 + blocks.len(), 2 + signals);
    let b = DMatrix::from_fn(1, inputs, |_, j| if j == 0 { 0.0 } else { 1.0 });
    let c = DMatrix::from_fn(rows, 1, |i, _| if i == 1 { -1.0 } else { 1.0 });
    let d = DMatrix::from_fn(rows, inputs, |i, j| f64::from(u8::from((i, j) == (1, 0))));
    let gain = Gain { parameter: 0, scale: 1.0, power: -1 };
    let lft = Lft::with_blocks(DMatrix::zeros(1, 1), b, c, d, vec![gain], blocks).expect("consistent");
    Problem { model: Model::new(lft, 0.01, None).expect("consistent"), theta: vec![0.2, 0.3] }
}

/// The checksum of bytes that were changed on purpose.
fn signed(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = bytes.len() - 8;
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    let check = bytes[..body].iter().fold(0xcbf2_9ce4_8422_2325, step);
    bytes[body..].copy_from_slice(&check.to_le_bytes());
    bytes
}

#[test]
fn what_is_read_steps_as_what_was_written() {
    let digital_lags = lags(&[0.7, 0.7], &[&[], &[0]], &[1]).under_digital(0.1, 0.3, 2.5);
    let problems = [machine(100.0, 0.02), digital(0.0, 0.3), digital_lags, saturating(0.0, 4, Some(2)), blocks()];
    for own in problems.map(packed) {
        let found = Packed::from_bytes(&own.to_bytes()).expect("as written");
        assert_eq!((&found.inputs, &found.outputs, &found.parameters), (&own.inputs, &own.outputs, &own.parameters));
        assert_eq!(found.to_bytes(), own.to_bytes());
        let u = Random(51).signal(50 * own.inputs.len());
        let [before, after] = [own, found].map(|packed| {
            let mut y = vec![0.0; 50 * packed.outputs.len()];
            let mut stepper = Stepper::new(&packed.system().expect("consistent"), &packed.theta).expect("regular");
            stepper.run(&u, &mut y).expect("sizes fit");
            y
        });
        assert_eq!(before, after);
    }
}

#[test]
fn a_file_that_is_cut_or_changed_is_refused() {
    let bytes = packed(saturating(0.0, 1, None)).to_bytes();
    for length in 0..bytes.len() {
        assert!(matches!(Packed::from_bytes(&bytes[..length]), Err(Error::Format { .. })), "cut to {length}");
    }
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        assert!(matches!(Packed::from_bytes(&changed), Err(Error::Format { .. })), "changed at {at}");
    }
}

#[test]
fn a_hostile_file_with_a_right_checksum_ends_in_an_error_or_a_loop() {
    for own in [packed(blocks()), packed(digital(0.0, 0.3))] {
        let bytes = own.to_bytes();
        let mut random = Random(52);
        for round in 0..4000 {
            let mut changed = bytes.clone();
            for value in random.signal(1 + round % 3) {
                let at = 16 + (value.abs() * 1e9) as usize % (bytes.len() - 24);
                changed[at] = [0, 1, 0x7f, 0xff, 0xf0][(value.abs() * 1e7) as usize % 5];
            }
            if round % 5 == 0 {
                changed.truncate(16 + round % (bytes.len() - 16));
                changed.extend([0; 8]);
            }
            if let Ok(found) = Packed::from_bytes(&signed(changed)) {
                let _ = Stepper::new(&found.system().expect("checked when read"), &found.theta);
            }
        }
    }
}

#[test]
fn a_loop_too_large_to_step_is_refused() {
    for change in [
        |model: &mut Model| model.substeps = Some(1_000_000),
        |model: &mut Model| model.controller.as_mut().expect("digital").delay = 999.0,
        |model: &mut Model| model.controller.as_mut().expect("digital").steps = 1_000_000,
    ] {
        let mut own = packed(digital(0.0, 0.3));
        change(&mut own.model);
        assert!(Packed::from_bytes(&own.to_bytes()).is_err());
    }
}
