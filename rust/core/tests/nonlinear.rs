//! Nonlinear blocks in a machine of two planes: convergence, independence of the parts, and steps without allocation.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use ambid_core::{Block, ClosedLoop, Coefficient, Curve, Error, Law, Lft, Model, Stepper};
use nalgebra::DMatrix;

mod common;

use common::deviation;
use common::loops::Problem;
use common::machine::machine;
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

/// The machine with a force law on its first `axes` axes; the strength is one more parameter.
fn saturating(axes: usize, substeps: Option<usize>) -> Problem {
    let Problem { model, mut theta } = machine(0.0, 0.02);
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
        Block::new(Law::Force { curve: Curve::Tanh, bias: 6.0 }, coefficients).expect("allowed")
    };
    let lft = Lft::with_blocks(lft.a.clone(), b, c, d, lft.gains.clone(), (0..axes).map(block).collect());
    theta.push(1.0);
    let model = Model { substeps, ..Model::new(lft.expect("consistent"), model.dt, None).expect("consistent") };
    Problem { model, theta }
}

fn excitation(system: &ClosedLoop, amplitude: f64) -> Vec<f64> {
    Random(7).signal(SAMPLES * system.inputs()).iter().map(|u| amplitude * u).collect()
}

#[test]
fn substeps_chosen_are_enough() {
    let chosen = saturating(4, None).system();
    let p = saturating(4, Some(32));
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
    let p = saturating(4, Some(8));
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
    let (bare, one) = (machine(0.0, 0.02), saturating(1, None));
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

#[test]
fn steps_are_the_simulation_and_allocate_nothing() {
    let p = saturating(4, Some(4));
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
    let p = saturating(4, Some(1));
    let system = p.system();
    let found = system.simulate(&p.theta, &excitation(&system, 1e9));
    assert!(matches!(found, Err(Error::Diverged { .. })), "{found:?}");
}
