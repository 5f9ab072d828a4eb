//! Cost of the core on a 24-state, nine-parameter machine. Run with `cargo bench -p ambid-core`.

use std::hint::black_box;
use std::time::Instant;

use ambid_core::{Data, LineData, Stepper, line_equations, normal_equations};
use nalgebra::Complex;

#[path = "../tests/common/mod.rs"]
mod common;

use common::loops::Problem;
use common::machine::{digital, machine, saturating};
use common::random::Random;

const SAMPLES: usize = 20_000;
const LINES: usize = 2557;
const REPEATS: usize = 15;

/// Prints median and minimum of the time of `run`, which covers `samples` samples.
fn measure(what: &str, samples: usize, mut run: impl FnMut()) {
    run();
    let mut seconds: Vec<f64> = (0..REPEATS)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    let (median, minimum) = (seconds[REPEATS / 2], seconds[0]);
    let each = 1e9 * median / samples as f64;
    println!("{what:<44} {samples:>7} {:>11.3} {:>11.3} {each:>11.1}", 1e3 * median, 1e3 * minimum);
}

fn measure_loop(name: &str, p: &Problem) {
    let (system, free) = (p.system(), p.free());
    for samples in [SAMPLES, 2 * SAMPLES] {
        let u = Random(1).signal(samples * system.inputs());
        let z = system.simulate(&p.theta, &u).expect("stable");
        let data = Data::new(&system, u.clone(), z, vec![1.0; system.outputs()], 0).expect("consistent");
        measure(&format!("{name}: simulate"), samples, || {
            black_box(system.simulate(&p.theta, &u).expect("stable"));
        });
        measure(&format!("{name}: sensitivity"), samples, || {
            black_box(system.sensitivity(&p.theta, &free, &u).expect("stable"));
        });
        measure(&format!("{name}: normal equations"), samples, || {
            black_box(normal_equations(&system, &p.theta, &free, &[&data]).expect("stable"));
        });
    }
    let u = Random(1).signal(SAMPLES * system.inputs());
    let mut stepper = Stepper::new(&system, &p.theta).expect("regular");
    let mut y = vec![0.0; system.outputs()];
    measure(&format!("{name}: stepper"), SAMPLES, || {
        for u in u.chunks_exact(system.inputs()) {
            stepper.step(u, &mut y).expect("sizes fit");
        }
        black_box(&y);
    });
}

/// The same on lines; every channel is whitened with every other.
fn measure_lines(name: &str, p: &Problem) {
    let (system, free) = (p.system(), p.free());
    let (nu, ny) = (system.inputs(), system.outputs());
    let mut random = Random(2);
    let mut numbers = |count: usize| -> Vec<Complex<f64>> {
        (0..count).map(|_| Complex::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0))).collect()
    };
    let w: Vec<_> = (0..LINES).map(|l| Complex::from_polar(1.0, 0.001 + 0.5 * l as f64 / LINES as f64)).collect();
    let u = numbers(LINES * nu);
    let z = system.lines(&p.theta, &[], &w, &u, &[], false).expect("stable").response;
    let data = LineData::new(&system, w.clone(), u, z, numbers(LINES * ny * ny)).expect("consistent");
    let equations = |near: &[Vec<f64>]| line_equations(&system, &p.theta, &free, &[&data], near).expect("stable");
    let near = equations(&[]).transients;
    measure(&format!("{name}: equations, transient known"), LINES, || {
        black_box(equations(&near));
    });
    measure(&format!("{name}: equations"), LINES, || {
        black_box(equations(&[]));
    });
    measure(&format!("{name}: transient"), LINES, || {
        black_box(line_equations(&system, &p.theta, &[], &[&data], &[]).expect("stable"));
    });
}

fn main() {
    println!("{:<44} {:>7} {:>11} {:>11} {:>11}", "", "lines", "median ms", "minimum ms", "ns/line");
    measure_lines("two planes at rest", &machine(0.0, 0.02));
    measure_lines("gyroscopically coupled", &machine(100.0, 0.02));
    measure_lines("double poles (dense)", &machine(1e-9, 0.0));
    measure_lines("digital, delay a parameter", &digital(0.0, 0.3));
    measure_lines("digital, delay a parameter, coupled", &digital(100.0, 0.3));
    println!("{:<44} {:>7} {:>11} {:>11} {:>11}", "", "samples", "median ms", "minimum ms", "ns/sample");
    measure_loop("two planes at rest", &machine(0.0, 0.02));
    measure_loop("gyroscopically coupled", &machine(100.0, 0.02));
    // alike planes that barely couple: double poles, so the plain recursion
    measure_loop("double poles (dense)", &machine(1e-9, 0.0));
    // a force law on every axis, its strength a tenth parameter
    measure_loop("four force laws", &saturating(0.0, 4, Some(1)));
    measure_loop("four force laws, coupled", &saturating(100.0, 4, Some(1)));
}
