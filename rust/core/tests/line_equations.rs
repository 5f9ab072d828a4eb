//! Normal equations on lines against the same sums formed from the lines, their slopes and their basis.

mod common;

use ambid_core::{ClosedLoop, LineData, line_equations, line_rows};
use common::loops::Problem;
use common::machine::machine;
use common::random::Random;
use common::spectrum::{C64, clusters, every_kind, free_of, orthonormal, points, sizes, stacked};
use nalgebra::{DMatrix, DVector};

/// Measured lines as numbers, to form the sums from.
struct Record {
    w: Vec<C64>,
    u: Vec<C64>,
    z: Vec<C64>,
    whitening: Vec<C64>,
    channels: usize,
}

/// Whitened rows of a record.
struct Rows {
    basis: DMatrix<f64>,
    slopes: DMatrix<f64>,
    residual: DVector<f64>,
}

impl Record {
    /// Random lines near those of a loop, under a whitening that is dense or leaves zeros.
    fn new(p: &Problem, random: &mut Random, lines: usize, channels: usize) -> Self {
        let system = p.system();
        let (nu, ny) = (system.inputs(), system.outputs());
        let mut numbers = |count: usize| -> Vec<C64> {
            (0..count).map(|_| C64::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0))).collect()
        };
        let w = points(2 * lines - 2);
        let u = numbers(lines * nu);
        let all = system.lines(&p.theta, &[], &w, &u, &[], false).expect("stable").response;
        let size = sizes(&all, ny);
        let noise = numbers(lines * channels);
        let z = (0..lines * channels).map(|i| {
            let (line, o) = (i / channels, i % channels);
            all[line * ny + o] + noise[i] * size[o] * 0.3
        });
        let z = z.collect();
        let mut whitening = numbers(lines * channels * channels);
        let triangle = random.pick(&[false, true]);
        for (i, w) in whitening.iter_mut().enumerate() {
            let (row, column) = (i / channels % channels, i % channels);
            *w = if triangle && column > row { C64::from(0.0) } else { *w / size[column] };
        }
        Self { w, u, z, whitening, channels }
    }

    fn data(&self, system: &ClosedLoop) -> LineData {
        let Self { w, u, z, whitening, .. } = self;
        LineData::new(system, w.clone(), u.clone(), z.clone(), whitening.clone()).expect("consistent")
    }

    /// The rows by their definition.
    fn rows(&self, system: &ClosedLoop, theta: &[f64], free: &[usize], d: &[f64]) -> Rows {
        let (ny, p) = (system.outputs(), self.channels);
        let found = system.lines(theta, free, &self.w, &self.u, d, true).expect("stable");
        let n = found.basis.len() / found.response.len();
        let whitened = |lines: &[C64], columns: usize| -> DMatrix<f64> {
            let mut white = vec![C64::from(0.0); self.w.len() * p * columns];
            for (i, white) in white.iter_mut().enumerate() {
                let (line, c, column) = (i / columns / p, i / columns % p, i % columns);
                let own =
                    (0..p).map(|o| self.whitening[(line * p + c) * p + o] * lines[(line * ny + o) * columns + column]);
                *white = own.sum();
            }
            stacked(&white, self.w.len() * p, columns)
        };
        let mut residual = found.response.clone();
        for (i, z) in self.z.iter().enumerate() {
            residual[i / p * ny + i % p] -= z;
        }
        Rows {
            basis: whitened(&found.basis, n),
            slopes: whitened(&found.slopes, free.len()),
            residual: whitened(&residual, 1).column(0).into_owned(),
        }
    }
}

/// Slopes and residual, freed from what the transient can take over.
struct Free {
    slopes: DMatrix<f64>,
    residual: DVector<f64>,
    rank: usize,
    /// How exact sums can be in which what little a column has of its own stands as a square.
    exact: f64,
}

impl Rows {
    /// Columns of the transient count of which a part of `own` of their square is their own.
    fn free_of_transients(&self, own: f64) -> Free {
        let (q, taken, least) = orthonormal(&self.basis, own.sqrt());
        let mut slopes = self.slopes.clone();
        slopes.column_iter_mut().for_each(|mut s| s.copy_from(&free_of(&s.clone_owned(), &q)));
        let exact = (1e-14 / (least * least)).max(1e-10);
        Free { slopes, residual: free_of(&self.residual, &q), rank: taken.len(), exact }
    }
}

fn states(system: &ClosedLoop, theta: &[f64]) -> usize {
    let (w, u) = ([C64::from(1.0)], vec![C64::from(0.0); system.inputs()]);
    system.lines(theta, &[], &w, &u, &[], true).expect("stable").basis.len() / system.outputs()
}

/// The whole of [`line_equations`] by its definition; `near` is left to the core where it is empty.
///
/// Gradient and Hessian agree to `within` of what the slopes are before the transient takes its share.
fn assert_equations(p: &Problem, free: &[usize], records: &[Record], near: &[Vec<f64>], within: f64, what: &str) {
    let system = p.system();
    let theta: Vec<f64> = p.theta.iter().map(|t| 1.01 * t).collect();
    let data: Vec<LineData> = records.iter().map(|r| r.data(&system)).collect();
    let data: Vec<&LineData> = data.iter().collect();
    let found = line_equations(&system, &theta, free, &data, near).expect("stable");
    // one that is far off is left for the best
    let start = line_equations(&system, &theta, &[], &data, &[]).expect("stable").transients;
    let np = free.len();
    let (mut hessian, mut gradient) = (DMatrix::zeros(np, np), DVector::zeros(np));
    // the core counts a part of 1e-11: what counts for sure, and what may count
    let (mut cost, mut ranks, mut exact) = (0.0, [0, 0], 0.0_f64);
    let (mut effect, mut total) = (vec![0.0; np], 0.0);
    for ((record, start), transient) in records.iter().zip(&start).zip(&found.transients) {
        let rows = record.rows(&system, &theta, free, start);
        let [sure, all] = [1e-10, 1e-12].map(|own| rows.free_of_transients(own));
        hessian += sure.slopes.tr_mul(&sure.slopes);
        gradient += sure.slopes.tr_mul(&sure.residual);
        cost += sure.residual.norm_squared();
        ranks = [ranks[0] + sure.rank, ranks[1] + all.rank];
        exact = exact.max(sure.exact);
        effect.iter_mut().enumerate().for_each(|(j, e)| *e += rows.slopes.column(j).norm_squared());
        let size = record.rows(&system, &theta, &[], &[]).residual.norm_squared().max(rows.residual.norm_squared());
        total += size;
        // the transient that is found leaves what is best
        let best = record.rows(&system, &theta, &[], transient).residual.norm_squared();
        let error = (best - sure.residual.norm_squared()).abs() / size;
        assert!(sure.rank < all.rank || error < 1e2 * exact, "{what}: the transient leaves {error:.1e} too much");
    }
    let fitted: usize = found.fitted.iter().sum();
    assert!((ranks[0]..=ranks[1]).contains(&fitted), "{what}: {fitted} numbers of {ranks:?}");
    if ranks[0] < ranks[1] {
        return; // what a column at the limit takes over depends on the way a transient is given
    }
    let error = (found.cost - cost).abs() / total;
    assert!(error < 1e2 * exact, "{what}: cost off by {error:.1e}");
    for i in 0..np {
        let error = (found.gradient[i] - gradient[i]).abs() / (effect[i] * total).sqrt().max(1e-12);
        assert!(error < within.max(1e2 * exact), "{what}: gradient {i} off by {error:.1e}");
        for j in 0..np {
            let error = (found.hessian[(i, j)] - hessian[(i, j)]).abs() / (effect[i] * effect[j]).sqrt().max(1e-12);
            assert!(error < within.max(1e2 * exact), "{what}: hessian {i}, {j} off by {error:.1e}");
        }
    }
}

/// A transient of each record, a tenth off the best one.
fn any_near(p: &Problem, records: &[Record]) -> Vec<Vec<f64>> {
    let system = p.system();
    let data: Vec<LineData> = records.iter().map(|r| r.data(&system)).collect();
    let data: Vec<&LineData> = data.iter().collect();
    let mut near = line_equations(&system, &p.theta, &[], &data, &[]).expect("stable").transients;
    near.iter_mut().flatten().for_each(|d| *d *= 0.9);
    near
}

#[test]
fn of_every_kind_of_loop() {
    let mut random = Random(51);
    for (name, p) in every_kind(&mut random) {
        let channels = 1 + (random.between(0.0, 1.0) * p.model.outputs() as f64) as usize;
        let records = [Record::new(&p, &mut random, 70, p.model.outputs()), Record::new(&p, &mut random, 41, channels)];
        assert_equations(&p, &p.free(), &records, &[], 1e-4, &name);
        assert_equations(&p, &[], &records, &[], 1e-5, &format!("{name}, no parameters"));
    }
}

#[test]
fn of_some_parameters_in_any_order() {
    let mut random = Random(52);
    let p = machine(0.0, 0.02);
    let records = [97, 5, 48, 49].map(|lines| Record::new(&p, &mut random, lines, 8));
    let near = any_near(&p, &records);
    assert_equations(&p, &[8, 2], &records, &near, 1e-8, "two of nine");
    assert_equations(&p, &[3], &records, &[], 1e-10, "one of nine");
}

/// Two equal states, and one that is not seen, are one number of the transient fewer.
#[test]
fn transients_that_cannot_be_separated() {
    let mut random = Random(53);
    for (name, p) in clusters(0.0).into_iter().filter(|(name, _)| name.contains("lag")) {
        let system = p.system();
        let record = Record::new(&p, &mut random, 60, 1);
        let found = line_equations(&system, &p.theta, &[], &[&record.data(&system)], &[]).expect("stable");
        let hidden = usize::from(name != "three lags in series");
        assert_eq!(found.fitted, [found.transients[0].len() - hidden], "{name}");
        assert!(found.transients[0].iter().all(|d| d.is_finite()));
    }
}

#[test]
fn rows_are_those_of_the_lines() {
    let mut random = Random(54);
    for (name, p) in every_kind(&mut random) {
        let (system, free) = (p.system(), p.free());
        let channels = 1 + (random.between(0.0, 1.0) * p.model.outputs() as f64) as usize;
        let record = Record::new(&p, &mut random, 53, channels);
        let (data, n) = (record.data(&system), states(&system, &p.theta));
        let d: Vec<f64> = (0..n).map(|_| random.between(-1.0, 1.0)).collect();
        for (d, transients) in [(&d[..], true), (&d[..], false), (&[][..], true)] {
            let expected = record.rows(&system, &p.theta, &free, d);
            let (rows, columns) = line_rows(&system, &p.theta, &free, &data, d, transients).expect("stable");
            let first = if transients { n } else { 0 };
            assert_eq!((rows.len(), columns), (2 * 53 * channels * columns, first + free.len() + 1));
            let (size, seen) = (expected.residual.amax(), 1e-3 * expected.basis.amax());
            for (i, row) in rows.chunks_exact(columns).enumerate() {
                for (j, found) in row.iter().enumerate() {
                    let (expected, unit) = if j < first {
                        (expected.basis[(i, j)], expected.basis.column(j).amax().max(seen))
                    } else if j < columns - 1 {
                        (expected.slopes[(i, j - first)], expected.slopes.column(j - first).amax())
                    } else {
                        (expected.residual[i], size)
                    };
                    let error = (found - expected).abs();
                    assert!(error <= 1e-11 * unit.max(1e-6 * size), "{name}: row {i}, column {j} off by {error:.1e}");
                }
            }
        }
    }
}

#[test]
fn no_records_no_information() {
    let p = machine(0.0, 0.02);
    let found = line_equations(&p.system(), &p.theta, &p.free(), &[], &[]).expect("stable");
    assert_eq!((found.hessian, found.cost, found.fitted), (DMatrix::zeros(9, 9), 0.0, vec![]));
}

#[test]
fn same_bits_for_one_and_many_threads() {
    let mut random = Random(55);
    let p = machine(100.0, 0.02);
    let system = p.system();
    let records: Vec<LineData> = (0..9).map(|i| Record::new(&p, &mut random, 60 + 93 * i, 8).data(&system)).collect();
    let records: Vec<&LineData> = records.iter().collect();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let rows = pool.install(|| line_rows(&system, &p.theta, &p.free(), records[8], &[], true)).expect("stable");
        (pool.install(|| line_equations(&system, &p.theta, &p.free(), &records, &[])).expect("stable"), rows)
    };
    let ((one, rows), (four, of_four)) = (with(1), with(4));
    assert_eq!(rows, of_four);
    assert_eq!((one.hessian, one.gradient, one.cost), (four.hessian, four.gradient, four.cost));
    assert_eq!(one.transients, four.transients);
}

/// A transient that is far off gives J to the digits that one from nothing does.
#[test]
fn from_a_transient_that_is_far_off() {
    let mut random = Random(54);
    let p = machine(0.0, 0.02);
    let (system, free) = (p.system(), [8, 2]);
    let record = Record::new(&p, &mut random, 97, 8);
    let data = record.data(&system);
    let expected = line_equations(&system, &p.theta, &free, &[&data], &[]).expect("stable");
    let any: Vec<f64> = expected.transients[0].iter().map(|_| random.between(-1.0, 1.0)).collect();
    let size = expected.transients[0].iter().fold(0.0_f64, |size, d| size.max(d.abs()));
    for far in [1e2, 1e5, 1e8] {
        let near: Vec<f64> = any.iter().map(|d| far * size * d).collect();
        let found = line_equations(&system, &p.theta, &free, &[&data], &[near]).expect("stable");
        let off = (found.cost / expected.cost - 1.0).abs();
        assert!(off < 1e-6, "{far:.0e} times as large: J off by {off:.1e}");
        let off = (&found.gradient - &expected.gradient).norm() / expected.gradient.norm();
        assert!(off < 1e-4, "{far:.0e} times as large: gradient off by {off:.1e}");
    }
}
