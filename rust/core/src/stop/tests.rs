//! What may take long asks after a bounded piece of work: counted in samples and lines, whatever their number.

use std::cell::Cell;

use nalgebra::Complex;
use rayon::ThreadPoolBuilder;

use crate::common::loops::lags;
use crate::common::machine::saturating;
use crate::common::spectrum::points;
use crate::{LineData, Stepper, line_equations, noise};

/// Samples or lines between two questions, at most.
const MOST: usize = 4096;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// One question of this thread.
pub(super) fn count() {
    COUNT.set(COUNT.get() + 1);
}

/// Asserts that `work` of ever more samples or lines, all on one thread, asks in proportion to them.
fn assert_asks(what: &str, work: impl Fn(usize) + Sync) {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let asked = |size: usize| {
        alone.install(|| {
            COUNT.set(0);
            work(size);
            COUNT.get()
        })
    };
    let (few, many) = (asked(2 * MOST), asked(8 * MOST));
    assert!(few >= 2, "{what}: {few} questions in {} steps", 2 * MOST);
    assert!(many - few >= 6, "{what}: {} questions in {} steps more", many - few, 6 * MOST);
}

#[test]
fn samples_of_a_linear_loop() {
    let p = lags(&[0.7], &[&[]], &[0]);
    let system = p.system();
    let u = |samples: usize| vec![1.0; samples];
    assert_asks("simulate", |n| drop(system.simulate(&p.theta, &u(n)).unwrap()));
    assert_asks("sensitivity", |n| drop(system.folded(&p.theta, &[0], &u(n), 0, 100, 1.0).unwrap()));
    assert_asks("settled", |n| drop(system.settled(&p.theta, &[], &u(n), 1).unwrap()));
    assert_asks("stepper", |n| Stepper::new(&system, &p.theta).unwrap().run(&u(n), &mut vec![0.0; n]).unwrap());
}

#[test]
fn samples_of_a_nonlinear_loop() {
    let p = saturating(100.0, 1, Some(1));
    let system = p.system();
    let (nu, ny) = (system.inputs(), system.outputs());
    let u = |samples: usize| vec![0.01; samples * nu];
    assert_asks("simulate", |n| drop(system.simulate(&p.theta, &u(n)).unwrap()));
    assert_asks("stepper", |n| Stepper::new(&system, &p.theta).unwrap().run(&u(n), &mut vec![0.0; n * ny]).unwrap());
}

#[test]
fn lines() {
    let p = lags(&[0.7], &[&[]], &[0]);
    let system = p.system();
    let one = Complex::from(1.0);
    let data = |n: usize| {
        let w = points(2 * n - 2);
        LineData::new(&system, w.clone(), vec![one; n], vec![one; n], vec![one; n]).unwrap()
    };
    assert_asks("equations", |n| drop(line_equations(&system, &p.theta, &[0], &[&data(n)], &[]).unwrap()));
    assert_asks("transfer", |n| drop(system.transfer(&p.theta, &points(2 * n - 2)).unwrap()));
    assert_asks("inverses", |n| drop(noise::inverses(&vec![one; n], 1).unwrap()));
    assert_asks("whitening", |n| drop(noise::whitening(&vec![one; n], &vec![one; n], 1).unwrap()));
}
