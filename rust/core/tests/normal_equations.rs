//! Normal equations against J'J and J'r formed from the sensitivities themselves.

mod common;

use ambid_core::{ClosedLoop, Data, Normal, normal_equations};
use common::loops::{Problem, lags};
use common::machine::machine;
use common::random::Random;
use nalgebra::{DMatrix, DVector};

/// A record as numbers, to form the sums from.
struct Record {
    u: Vec<f64>,
    z: Vec<f64>,
    weights: Vec<f64>,
    first: usize,
}

impl Record {
    /// A response to random steps, with noise and an offset of about its own size.
    fn new(p: &Problem, random: &mut Random, samples: usize, first: usize) -> Self {
        let system = p.system();
        let ny = system.outputs();
        let u = random.signal(samples * system.inputs());
        let mut z = system.simulate(&p.theta, &u).expect("stable");
        let size: Vec<f64> = (0..ny).map(|o| z.iter().skip(o).step_by(ny).fold(0.0, |a, b| b.abs().max(a))).collect();
        z.iter_mut().enumerate().for_each(|(i, z)| *z += size[i % ny] * (0.7 + random.between(-0.3, 0.3)));
        let weights = size.iter().map(|s| random.between(0.5, 2.0) / s).collect();
        Self { u, z, weights, first }
    }

    fn data(&self, system: &ClosedLoop) -> Data {
        Data::new(system, self.u.clone(), self.z.clone(), self.weights.clone(), self.first).expect("consistent")
    }
}

/// The definition, in the plainest words.
fn by_definition(p: &Problem, theta: &[f64], free: &[usize], records: &[Record]) -> Normal {
    let system = p.system();
    let (ny, np) = (system.outputs(), free.len());
    let mut sum = Normal { hessian: DMatrix::zeros(np, np), gradient: DVector::zeros(np), squares: vec![0.0; ny] };
    for record in records {
        let (y, jacobian) = system.sensitivity(theta, free, &record.u).expect("stable");
        let samples = y.len() / ny;
        let count = samples - record.first;
        for o in 0..ny {
            let centred = |v: DVector<f64>| v.add_scalar(-v.mean()) * record.weights[o];
            let at = |k: usize| (record.first + k) * ny + o;
            let residual = centred(DVector::from_fn(count, |k, _| y[at(k)] - record.z[at(k)]));
            let slopes: Vec<_> =
                (0..np).map(|j| centred(DVector::from_fn(count, |k, _| jacobian[at(k) * np + j]))).collect();
            sum.squares[o] += residual.norm_squared();
            for i in 0..np {
                sum.gradient[i] += slopes[i].dot(&residual);
                for j in 0..np {
                    sum.hessian[(i, j)] += slopes[i].dot(&slopes[j]);
                }
            }
        }
    }
    sum
}

fn assert_normal(p: &Problem, free: &[usize], records: &[Record]) {
    let system = p.system();
    let theta: Vec<f64> = p.theta.iter().map(|t| 1.02 * t).collect();
    let data: Vec<Data> = records.iter().map(|r| r.data(&system)).collect();
    let found = normal_equations(&system, &theta, free, &data.iter().collect::<Vec<_>>()).expect("stable");
    let expected = by_definition(p, &theta, free, records);
    // entries are compared in units of the parameters' own effect
    let total: f64 = expected.squares.iter().sum();
    let effect: Vec<f64> = (0..free.len()).map(|i| expected.hessian[(i, i)].sqrt()).collect();
    for i in 0..free.len() {
        let error = (found.gradient[i] - expected.gradient[i]).abs();
        assert!(error <= 1e-10 * effect[i] * total.sqrt(), "gradient {i}: off by {error:.1e}");
        for j in 0..free.len() {
            let error = (found.hessian[(i, j)] - expected.hessian[(i, j)]).abs();
            assert!(error <= 1e-10 * effect[i] * effect[j], "hessian {i}, {j}: off by {error:.1e}");
        }
    }
    for (found, expected) in found.squares.iter().zip(&expected.squares) {
        assert!((found - expected).abs() <= 1e-10 * expected, "squares {found} instead of {expected}");
    }
}

#[test]
fn of_random_loops() {
    let mut random = Random(21);
    for _ in 0..30 {
        let p = random.analog_loop();
        let records = [Record::new(&p, &mut random, 257, 0)];
        assert_normal(&p, &p.free(), &records);
    }
}

#[test]
fn of_machines_with_several_records_that_start_late() {
    let mut random = Random(22);
    for gyroscopic in [0.0, 100.0] {
        let p = machine(gyroscopic, 0.02);
        let records =
            [(500, 0), (333, 1), (700, 180), (61, 60)].map(|(n, first)| Record::new(&p, &mut random, n, first));
        assert_normal(&p, &p.free(), &records);
        assert_normal(&p, &[8, 2], &records);
        assert_normal(&p, &[], &records);
    }
}

#[test]
fn a_weight_of_zero_leaves_a_channel_out() {
    let mut random = Random(23);
    let p = machine(0.0, 0.02);
    let mut record = Record::new(&p, &mut random, 300, 10);
    record.weights[4..].fill(0.0);
    record.weights[1] = 0.0;
    let system = p.system();
    let with = normal_equations(&system, &p.theta, &p.free(), &[&record.data(&system)]).expect("stable");
    // what a channel without weight measured does not matter
    record.z.iter_mut().skip(1).step_by(8).for_each(|z| *z *= 3.0);
    let without = normal_equations(&system, &p.theta, &p.free(), &[&record.data(&system)]).expect("stable");
    assert_eq!(with.hessian, without.hessian);
    assert_eq!(with.gradient, without.gradient);
    assert_eq!(with.squares, without.squares);
    assert_eq!(with.squares[1], 0.0);
    assert_normal(&p, &p.free(), &[record]);
}

/// One output is the excitation's, the other is reached by nothing: its measurement counts as it is.
#[test]
fn an_output_that_no_input_reaches_is_all_residual() {
    let mut p = lags(&[0.7], &[&[]], &[0]);
    let c = p.model.lft.c.clone().insert_row(1, 0.0);
    let d = p.model.lft.d.clone().insert_row(1, 0.0);
    (p.model.lft.c, p.model.lft.d) = (c, d);
    let system = p.system();
    let data = Data::new(&system, vec![1.0; 4], vec![0.0, 1.0, 0.0, 2.0, 0.0, 3.0, 0.0, 6.0], vec![1.0, 2.0], 0);
    let normal = normal_equations(&system, &p.theta, &[0], &[&data.unwrap()]).unwrap();
    assert!((normal.squares[1] - 4.0 * 14.0).abs() < 1e-13);
}

#[test]
fn no_records_no_information() {
    let p = machine(0.0, 0.02);
    let normal = normal_equations(&p.system(), &p.theta, &p.free(), &[]).unwrap();
    assert_eq!(normal.hessian, DMatrix::zeros(9, 9));
    assert_eq!(normal.squares, vec![0.0; 8]);
}

#[test]
fn same_bits_for_one_and_many_threads() {
    let mut random = Random(24);
    let p = machine(100.0, 0.02);
    let system = p.system();
    let records: Vec<Data> = (0..9).map(|i| Record::new(&p, &mut random, 200 + 37 * i, i).data(&system)).collect();
    let records: Vec<&Data> = records.iter().collect();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| normal_equations(&system, &p.theta, &p.free(), &records)).expect("stable")
    };
    let (one, four) = (with(1), with(4));
    assert_eq!(one.hessian, four.hessian);
    assert_eq!(one.gradient, four.gradient);
    assert_eq!(one.squares, four.squares);
}
