//! Nonlinear blocks in a machine of two planes: convergence, independence of the parts, and steps without allocation.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use ambid_core::{Block, ClosedLoop, Coefficient, Error, Law, Lft, Model, Stepper};
use nalgebra::DMatrix;

mod common;

use common::deviation;
use common::loops::Problem;
use common::machine::{machine, saturating};
use common::random::Random;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: passes everything on to the system.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const SAMPLES: usize = 600;

fn excitation(system: &ClosedLoop, amplitude: f64) -> Vec<f64> {
    Random(7).signal(SAMPLES * system.inputs()).iter().map(|u| amplitude * u).collect()
}

#[test]
fn substeps_chosen_are_enough() {
    let chosen = saturating(0.0, 4, None).system();
    let p = saturating(0.0, 4, Some(32));
    let (free, u) = (p.free(), excitation(&chosen, 2.0));
    let (y, slopes) = chosen.sensitivity(&p.theta, &free, &u).expect("stable");
    let (fine, fine_slopes) = p.system().sensitivity(&p.theta, &free, &u).expect("stable");
    let off = deviation(&y, &fine, chosen.outputs());
    assert!(off < 1e-6, "response off by {off:.1e}");
    let off = common::slope_deviation(&slopes, &fine_slopes, &fine, chosen.outputs());
    assert!(off < 2e-6, "derivatives off by {off:.1e}");
}

#[test]
fn derivatives_by_strength_and_gain_are_differences_of_the_response() {
    let p = saturating(0.0, 4, Some(8));
    let system = p.system();
    let u = excitation(&system, 2.0);
    let free = p.free();
    let (y, slopes) = system.sensitivity(&p.theta, &free, &u).expect("stable");
    let mut expected = vec![0.0; slopes.len()];
    for j in 0..free.len() {
        let h = 1e-3 * p.theta[j];
        let moved = |n: f64| {
            let mut theta = p.theta.clone();
            theta[j] += n * h;
            system.simulate(&theta, &u).expect("stable")
        };
        let (far, near) = ((moved(2.0), moved(-2.0)), (moved(1.0), moved(-1.0)));
        for i in 0..y.len() {
            expected[i * free.len() + j] = (8.0 * (near.0[i] - near.1[i]) - (far.0[i] - far.1[i])) / (12.0 * h);
        }
    }
    let off = common::slope_deviation(&slopes, &expected, &y, system.outputs());
    assert!(off < 1e-6, "derivatives off by {off:.1e}");
}

#[test]
fn a_plane_without_blocks_stays_on_the_linear_path() {
    // axis 0 lies in the first plane
    let (bare, one) = (machine(0.0, 0.02), saturating(0.0, 1, None));
    let (linear, system) = (bare.system(), one.system());
    assert_eq!(system.parts(), 2);
    let u = excitation(&system, 2.0);
    let (y, expected) = (system.simulate(&one.theta, &u), linear.simulate(&bare.theta, &u));
    let (y, expected) = (y.expect("stable"), expected.expect("stable"));
    let outputs = system.outputs();
    for o in 0..outputs {
        let pick = |all: &[f64]| all.iter().skip(o).step_by(outputs).copied().collect::<Vec<_>>();
        assert_eq!(pick(&y) == pick(&expected), o % 2 == 1, "output {o}");
    }
}

/// Digital loops of every kind, with blocks that read and drive at random but have no strength.
#[test]
fn blocks_without_strength_leave_digital_loops_alone() {
    let mut random = Random(9);
    for (delay, steps) in [(0.0, 1), (0.3, 2), (1.0, 1), (2.5, 2)] {
        for i in 0..4 {
            let p = random.digital_loop(delay, steps);
            let (lft, controller) = (&p.model.lft, p.model.controller.clone());
            let (n, columns, rows) = (lft.a.nrows(), lft.b.ncols(), lft.c.nrows());
            let mut d = random.matrix(rows + 3, columns + 2);
            d.view_mut((0, 0), (rows, columns)).copy_from(&lft.d);
            d.view_mut((0, columns), (rows + 3, 2)).fill(0.0);
            let mut whole = |m: &DMatrix<f64>, rows, columns| {
                let mut out = random.matrix(rows, columns);
                out.view_mut((0, 0), m.shape()).copy_from(m);
                out
            };
            let (b, c) = (whole(&lft.b, n, columns + 2), whole(&lft.c, rows + 3, n));
            let block = |exponents: Vec<[u32; 2]>, inputs| {
                Block::new(Law::Polynomial { inputs, exponents }, vec![Coefficient::Constant(0.0)]).expect("allowed")
            };
            let blocks = vec![block(vec![[2, 1]], 2), block(vec![[3, 0]], 1)];
            let lft = Lft::with_blocks(lft.a.clone(), b, c, d, lft.gains.clone(), blocks).expect("consistent");
            let model = Model::new(lft, p.model.dt, controller).expect("consistent");
            let dull = Problem { model: Model { substeps: Some(32), ..model }, theta: p.theta.clone() };
            let (system, free) = (p.system(), p.free());
            let u = random.signal(100 * system.inputs());
            let (y, slopes) = dull.system().sensitivity(&p.theta, &free, &u).expect("stable");
            let (expected, expected_slopes) = system.sensitivity(&p.theta, &free, &u).expect("stable");
            let what = format!("loop {i}, delay {delay}, {steps} steps");
            let off = deviation(&y, &expected, system.outputs());
            assert!(off < 1e-10, "{what}: response off by {off:.1e}");
            let off = common::slope_deviation(&slopes, &expected_slopes, &expected, system.outputs());
            assert!(off < 1e-6, "{what}: derivatives off by {off:.1e}");
            let mut stepper = Stepper::new(&dull.system(), &p.theta).expect("regular");
            let mut stepped = vec![0.0; y.len()];
            for (u, y) in u.chunks_exact(system.inputs()).zip(stepped.chunks_exact_mut(system.outputs())) {
                stepper.step(u, y).expect("sizes fit");
            }
            let off = deviation(&stepped, &y, system.outputs());
            assert!(off < 1e-10, "{what}: steps off by {off:.1e}");
            let settled = |p: &Problem, u: &[f64]| p.system().settled(&p.theta, &[], u, 100).expect("stable").0;
            let expected = settled(&p, &u);
            for found in [settled(&p, &u.repeat(2)), settled(&dull, &u), settled(&dull, &u.repeat(2))] {
                let off = deviation(&found, &expected, system.outputs());
                assert!(off < 1e-7, "{what}: steady state off by {off:.1e}");
            }
        }
    }
}

#[test]
fn steps_are_the_simulation_and_allocate_nothing() {
    let p = saturating(0.0, 4, Some(4));
    let system = p.system();
    let u = excitation(&system, 2.0);
    let expected = system.simulate(&p.theta, &u).expect("stable");
    let mut stepper = Stepper::new(&system, &p.theta).expect("regular");
    let mut y = vec![0.0; expected.len()];
    let before = ALLOCATIONS.get();
    for (u, y) in u.chunks_exact(system.inputs()).zip(y.chunks_exact_mut(system.outputs())) {
        stepper.step(u, y).expect("sizes fit");
    }
    assert_eq!(ALLOCATIONS.get(), before, "a step allocates");
    let off = deviation(&y, &expected, system.outputs());
    assert!(off < 1e-10, "off by {off:.1e}");
}

#[test]
fn divergence_is_an_error() {
    let p = saturating(0.0, 4, Some(1));
    let system = p.system();
    let found = system.simulate(&p.theta, &excitation(&system, 1e9));
    assert!(matches!(found, Err(Error::Diverged { .. })), "{found:?}");
}

/// The steady state of the linearised loop is nearer to that of the loop than rest is.
#[test]
fn a_periodic_response_starts_from_the_linear_steady_state() {
    for axes in [2, 4] {
        let p = saturating(0.0, axes, Some(2));
        let system = p.system();
        let (ny, u) = (system.outputs(), excitation(&system, 2.0));
        let last = |u: &[f64]| {
            let y = system.simulate(&p.theta, u).expect("stable");
            y[y.len() - SAMPLES * ny..].to_vec()
        };
        let expected = last(&u.repeat(12));
        for periods in [1, 2] {
            let u = u.repeat(periods);
            let off = deviation(&system.settled(&p.theta, &[], &u, SAMPLES).expect("stable").0, &expected, ny);
            let from_rest = deviation(&last(&u), &expected, ny);
            assert!(off < 0.02 * from_rest, "{axes} axes: off by {off:.1e}, from rest by {from_rest:.1e}");
        }
        let free: Vec<usize> = (0..p.theta.len()).collect();
        let (y, slopes) = system.settled(&p.theta, &free, &u.repeat(12), SAMPLES).expect("stable");
        let (again, sums) = system.folded(&p.theta, &free, &u.repeat(12), 11 * SAMPLES, SAMPLES, 1.0).expect("stable");
        let off = deviation(&y, &again, ny);
        assert!(off < 1e-4, "{axes} axes: the last period off by {off:.1e}");
        let off = common::slope_deviation(&slopes, &sums, &again, ny);
        assert!(off < 1e-2, "{axes} axes: derivatives of the last period off by {off:.1e}");
    }
}
