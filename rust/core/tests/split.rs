//! Independent parts: found where they are, not where they are not, and every signal in its place.

mod common;

use ambid_core::{ClosedLoop, Controller, Gain, Lft, Model};
use common::loops::Problem;
use common::machine::machine;
use common::random::Random;
use common::{deviation, reference, slope_deviation};
use nalgebra::DMatrix;

/// `x_i' = -(i + 1) x_i + b u`, read as `y = c x + d u`.
fn first_orders(b: DMatrix<f64>, c: DMatrix<f64>, d: DMatrix<f64>) -> Lft {
    let n = b.nrows();
    let a = DMatrix::from_fn(n, n, |i, j| if i == j { -1.0 - i as f64 } else { 0.0 });
    Lft::new(a, b, c, d, vec![]).expect("consistent")
}

fn entries(rows: usize, columns: usize, at: &[(usize, usize)]) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |i, j| f64::from(u8::from(at.contains(&(i, j)))))
}

fn system(lft: Lft) -> ClosedLoop {
    ClosedLoop::new(Model::new(lft, 0.1, None).expect("consistent"), 0).expect("consistent")
}

fn assert_exact(p: &Problem) {
    let system = p.system();
    let u = Random(31).signal(150 * system.inputs());
    let (y, jacobian) = system.sensitivity(&p.theta, &p.free(), &u).expect("stable");
    let (expected, slopes) = reference::sensitivity(&p.model, &p.theta, &p.free(), &u);
    assert!(deviation(&y, &expected, system.outputs()) < 1e-9);
    assert!(slope_deviation(&jacobian, &slopes, &expected, system.outputs()) < 1e-9);
}

#[test]
fn the_planes_of_a_rotor_at_rest_decouple() {
    assert_eq!(machine(0.0, 0.02).system().parts(), 2);
    assert_eq!(machine(1e-12, 0.02).system().parts(), 1, "any coupling at all counts");
}

/// Only axes of one plane respond to an axis of it, and only to parameters of that plane and the common lag.
#[test]
fn planes_keep_to_themselves() {
    let p = machine(0.0, 0.02);
    let system = p.system();
    let mut u = vec![0.0; 4 * 100];
    u.iter_mut().skip(1).step_by(4).for_each(|u| *u = 1.0); // A_eta
    let (y, jacobian) = system.sensitivity(&p.theta, &p.free(), &u).expect("stable");
    for axis in 0..8 {
        let moves = y.iter().skip(axis).step_by(8).any(|y| *y != 0.0);
        assert_eq!(moves, axis % 2 == 1, "output {axis}");
        for j in 0..9 {
            let matters = jacobian.iter().skip(axis * 9 + j).step_by(72).any(|s| *s != 0.0);
            assert_eq!(matters, axis % 2 == 1 && (j == 8 || j % 2 == 1), "output {axis}, parameter {j}");
        }
    }
}

/// Inputs and outputs of three independent states in mixed order.
#[test]
fn signals_keep_their_places() {
    let b = entries(3, 3, &[(0, 2), (1, 0), (2, 1)]);
    let c = entries(4, 3, &[(0, 1), (1, 2), (2, 0), (3, 2)]);
    let lft = first_orders(b, c, DMatrix::zeros(4, 3));
    let p = Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta: vec![] };
    assert_eq!(p.system().parts(), 3);
    assert_exact(&p);
}

/// An input may be shared by parts: it shows nothing of one to another.
#[test]
fn shared_inputs_couple_nothing() {
    let (b, c) = (entries(2, 2, &[(0, 0), (1, 1), (1, 0)]), entries(2, 2, &[(0, 0), (1, 1)]));
    for d in [DMatrix::zeros(2, 2), entries(2, 2, &[(0, 1)])] {
        let lft = first_orders(b.clone(), c.clone(), d);
        let p = Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta: vec![] };
        assert_eq!(p.system().parts(), 2);
        assert_exact(&p);
    }
}

/// Entries of Delta couple what they read with what they drive.
#[test]
fn gains_couple() {
    let bare = first_orders(entries(2, 1, &[(0, 0)]), entries(2, 2, &[(0, 0), (1, 1)]), DMatrix::zeros(2, 1));
    let b = bare.b.insert_column(1, 0.0) + entries(2, 2, &[(1, 1)]);
    let c = bare.c.insert_row(2, 0.0) + entries(3, 2, &[(2, 0)]);
    let gain = Gain { parameter: 0, scale: 1.0, power: 1 };
    let lft = Lft::new(bare.a, b, c, DMatrix::zeros(3, 2), vec![gain]).expect("consistent");
    let p = Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta: vec![0.5] };
    assert_eq!(p.system().parts(), 1);
    assert_exact(&p);
}

/// A digital controller couples by any of its matrices, and by excitations that act on several commands.
#[test]
fn digital_controllers_split_with_the_plant() {
    let plant = || {
        let c = entries(3, 2, &[(0, 0), (1, 1), (2, 0)]);
        first_orders(entries(2, 2, &[(0, 0), (1, 1)]), c, DMatrix::zeros(3, 2))
    };
    let controlled = |couple: usize| {
        let part = |i: usize| {
            let mut m = DMatrix::from_diagonal_element(2, 2, 0.3);
            m[(1, 0)] = if couple == i { 0.1 } else { 0.0 };
            m
        };
        let [a, b, c, d, excitation] = [0, 1, 2, 3, 4].map(part);
        let controller = Controller { delay: 1.5, steps: 2, excitation, ..Controller::new(a, b, c, d) };
        Problem { model: Model::new(plant(), 0.1, Some(controller)).expect("consistent"), theta: vec![] }
    };
    let apart = controlled(usize::MAX);
    assert_eq!(apart.system().parts(), 2);
    assert_exact(&apart);
    for couple in 0..5 {
        let p = controlled(couple);
        assert_eq!(p.system().parts(), 1, "matrix {couple}");
        assert_exact(&p);
    }
}

/// Inputs that a digital controller does not drive act on both parts, on one, and on what the controller never sees.
#[test]
fn further_inputs_of_a_digital_loop_keep_their_places() {
    let b = entries(3, 5, &[(0, 0), (1, 1), (0, 2), (1, 2), (1, 3), (2, 4)]);
    let c = entries(4, 3, &[(0, 0), (1, 1), (2, 0), (3, 2)]);
    let lft = first_orders(b, c, entries(4, 5, &[(0, 3), (2, 2), (3, 3)]));
    let eye = |factor| DMatrix::from_diagonal_element(2, 2, factor);
    let law = Controller::new(eye(0.3), eye(0.1), eye(0.2), eye(0.3));
    let controller = Controller { delay: 1.5, steps: 2, ..law };
    let p = Problem { model: Model::new(lft, 0.1, Some(controller)).expect("consistent"), theta: vec![] };
    assert_eq!(p.system().parts(), 3);
    assert_eq!(p.system().inputs(), 5);
    assert_exact(&p);
}

/// The last state has an output but no input, the last output no state: both stay at zero.
#[test]
fn what_no_input_reaches_is_zero() {
    let lft = first_orders(entries(2, 1, &[(0, 0)]), entries(3, 2, &[(0, 0), (1, 1)]), DMatrix::zeros(3, 1));
    let system = system(lft);
    assert_eq!(system.parts(), 3);
    let y = system.simulate(&[], &[1.0; 20]).expect("stable");
    assert!(y.chunks_exact(3).skip(1).all(|y| y[0] > 0.0 && y[1] == 0.0 && y[2] == 0.0));
}

/// A state that no output shows makes no part; its input is heard by nobody.
#[test]
fn what_no_output_shows_is_left_out() {
    let lft = first_orders(entries(2, 2, &[(0, 0), (1, 1)]), entries(1, 2, &[(0, 0)]), DMatrix::zeros(1, 2));
    let p = Problem { model: Model::new(lft, 0.1, None).expect("consistent"), theta: vec![] };
    assert_eq!(p.system().parts(), 1);
    assert_exact(&p);
}
