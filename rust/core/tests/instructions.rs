//! Results with AVX2 and without agree to rounding: this test runs itself once with each, and compares.

use std::process::Command;

use ambid_core::{Data, Instructions, LineData, SWITCH, line_rows, normal_equations};
use nalgebra::DMatrix;

mod common;

use common::loops::Problem;
use common::machine::{digital, machine, saturating};
use common::random::Random;
use common::spectrum::{C64, points, sizes};
use common::{deviation, slope_deviation};

const SAMPLES: usize = 400;
const MARK: &str = "numbers:";
const WITHIN: f64 = 1e-12;
/// Sums of products are taken over modes, whose shares in the response cancel.
const CANCELLED: f64 = 100.0;

fn problems() -> Vec<(&'static str, Problem)> {
    vec![
        ("planes apart", machine(0.0, 0.02)),
        ("turning", machine(100.0, 0.02)),
        ("digital", digital(100.0, 0.1)),
        ("saturating", saturating(0.0, 4, Some(4))),
    ]
}

fn is_linear(p: &Problem) -> bool {
    p.model.lft.blocks.is_empty()
}

/// Response in time and its derivatives, sums of squares; of linear loops response and whitened rows on lines.
fn results(p: &Problem) -> Vec<Vec<f64>> {
    let (system, free, mut random) = (p.system(), p.free(), Random(3));
    let ny = system.outputs();
    let u = random.signal(SAMPLES * system.inputs());
    let (y, slopes) = system.sensitivity(&p.theta, &free, &u).expect("stable");
    let z: Vec<f64> = y.iter().map(|y| y * random.between(0.5, 1.5)).collect();
    let size: Vec<f64> = (0..ny).map(|o| y.iter().skip(o).step_by(ny).fold(0.0, |a, b| b.abs().max(a))).collect();
    let data = Data::new(&system, u, z, size.iter().map(|s| 1.0 / s).collect(), 0).expect("consistent");
    let normal = normal_equations(&system, &p.theta, &free, &[&data]).expect("stable");
    let mut found = vec![y, slopes, normal.squares, scaled(&normal.hessian)];
    if is_linear(p) {
        found.extend(on_lines(p, &mut random));
    }
    found
}

fn on_lines(p: &Problem, random: &mut Random) -> [Vec<f64>; 2] {
    let (system, free) = (p.system(), p.free());
    let ny = system.outputs();
    let w = points(SAMPLES);
    let numbers = |count: usize, random: &mut Random| -> Vec<C64> {
        (0..count).map(|_| C64::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0))).collect()
    };
    let u = numbers(w.len() * system.inputs(), random);
    let response = system.lines(&p.theta, &free, &w, &u, &[], false).expect("stable").response;
    let size = sizes(&response, ny);
    let z = response.iter().map(|y| y * random.between(0.5, 1.5)).collect();
    let whitening = numbers(w.len() * ny * ny, random).iter().enumerate().map(|(i, v)| v / size[i % ny]).collect();
    let data = LineData::new(&system, w, u, z, whitening).expect("consistent");
    let rows = line_rows(&system, &p.theta, &free, &data, &[], false).expect("stable").0;
    [response.iter().flat_map(|z| [z.re, z.im]).collect(), rows]
}

/// Entries in units of the roots of the diagonal.
fn scaled(hessian: &DMatrix<f64>) -> Vec<f64> {
    let root: Vec<f64> = hessian.diagonal().iter().map(|h| h.sqrt()).collect();
    DMatrix::from_fn(root.len(), root.len(), |i, j| hessian[(i, j)] / (root[i] * root[j])).as_slice().to_vec()
}

#[test]
#[ignore = "its output is for the test below"]
fn numbers_of_this_process() {
    println!("{MARK}{}", Instructions::in_use().name());
    for (_, p) in problems() {
        for result in results(&p) {
            println!("{MARK}{}", result.iter().map(|x| format!("{:x}", x.to_bits())).collect::<Vec<_>>().join(" "));
        }
    }
}

/// Name of the instructions, and all results, of a process of its own.
fn of_process(switch: Option<&str>) -> (String, Vec<Vec<f64>>) {
    let mut command = Command::new(std::env::current_exe().expect("known"));
    command.args(["--exact", "numbers_of_this_process", "--ignored", "--nocapture", "--test-threads=1"]);
    match switch {
        Some(value) => command.env(SWITCH, value),
        None => command.env_remove(SWITCH),
    };
    let output = String::from_utf8(command.output().expect("runs").stdout).expect("text");
    // the first one stands behind the name of the test
    let mut lines = output.lines().filter_map(|line| line.split_once(MARK).map(|(_, numbers)| numbers));
    let name = lines.next().expect("a name").to_owned();
    let number = |bits: &str| f64::from_bits(u64::from_str_radix(bits, 16).expect("bits"));
    (name, lines.map(|line| line.split(' ').map(number).collect()).collect())
}

#[test]
fn the_switch_turns_them_off() {
    assert_eq!(of_process(Some("none")).0, "baseline");
    assert_eq!(of_process(None).0, Instructions::best().name());
    assert_eq!(of_process(Some("")).0, Instructions::best().name());
}

#[test]
fn results_agree_to_rounding() {
    let [(_, plain), (_, fast)] = [Some("none"), None].map(of_process);
    let mut all = plain.iter().zip(&fast);
    for (name, p) in problems() {
        let ny = p.system().outputs();
        let mut off = Vec::new();
        let mut next = |off: &mut Vec<f64>, deviation: &dyn Fn(&[f64], &[f64]) -> f64| {
            let (plain, fast) = all.next().expect("a result");
            off.push(deviation(fast, plain));
            plain
        };
        let y = next(&mut off, &|a, b| deviation(a, b, ny));
        next(&mut off, &|a, b| slope_deviation(a, b, y, ny));
        next(&mut off, &|a, b| deviation(a, b, ny));
        next(&mut off, &|a, b| deviation(a, b, b.len()) / CANCELLED);
        if is_linear(&p) {
            next(&mut off, &|a, b| deviation(a, b, 2 * ny));
            next(&mut off, &|a, b| deviation(a, b, p.theta.len() + 1));
        }
        println!("{name}: {off:?}");
        assert!(off.iter().all(|off| *off < WITHIN), "{name}: off by {off:?}");
    }
    assert!(all.next().is_none(), "all results are compared");
}
