//! A loop on lines of the spectrum against cut records of the time-domain core.

mod common;

use ambid_core::{ClosedLoop, Error, Gain, Lft, LineData, Model, Result, line_equations, line_rows};
use common::loops::{Problem, lags};
use common::machine::{machine, saturating};
use common::random::Random;
use common::spectrum::{
    C64, Rows, clusters, every_kind, free_of, least_squares, orthonormal, points, sizes, stacked, transform,
};
use nalgebra::{DMatrix, DVector};

/// A stretch of a record that began at rest long before it.
struct Cut {
    u: Vec<C64>,
    z: Vec<C64>,
    /// Lines x outputs x parameters.
    slopes: Vec<C64>,
    /// The stretch itself.
    y: Vec<f64>,
    length: usize,
}

impl Cut {
    fn new(p: &Problem, random: &mut Random) -> Self {
        let system = p.system();
        let (nu, ny, np) = (system.inputs(), system.outputs(), p.theta.len());
        let (start, length) = (random.between(0.0, 90.0) as usize, random.between(60.0, 110.0) as usize);
        let u = random.signal((start + length) * nu);
        let (y, jacobian) = system.sensitivity(&p.theta, &p.free(), &u).expect("stable");
        Self {
            u: transform(&u[start * nu..], nu),
            z: transform(&y[start * ny..], ny),
            slopes: if np == 0 { vec![] } else { transform(&jacobian[start * ny * np..], ny * np) },
            y: y[start * ny..].to_vec(),
            length,
        }
    }
}

fn states(system: &ClosedLoop, theta: &[f64]) -> usize {
    let (w, u) = ([C64::from(1.0)], vec![C64::from(0.0); system.inputs()]);
    let found = system.lines(theta, &[], &w, &u, &[], true).expect("stable");
    found.basis.len() / system.outputs()
}

/// Response and transient are those of the record, and so are the slopes but for what a change of `d` makes up for.
#[test]
fn cut_records_of_every_kind() {
    let mut random = Random(41);
    for (name, p) in every_kind(&mut random) {
        let (system, free, ny) = (p.system(), p.free(), p.system().outputs());
        let cut = Cut::new(&p, &mut random);
        let (w, n) = (points(cut.length), states(&system, &p.theta));
        let units: Vec<f64> = sizes(&cut.z, ny).iter().map(|size| 1.0 / size).collect();
        let by: Vec<f64> = (0..w.len() * ny).map(|i| units[i % ny]).collect();
        let rows = |d: &[f64]| {
            let found = system.lines(&p.theta, &free, &w, &cut.u, d, true).expect("stable");
            let mut rows = Rows::new(&found, n, free.len());
            rows.scale(&by);
            rows
        };
        let scaled = |lines: &mut dyn Iterator<Item = C64>| {
            DVector::from_vec(lines.zip(&by).flat_map(|(z, by)| [z.re * by, z.im * by]).collect())
        };
        let expected = scaled(&mut cut.z.iter().copied());
        let forced = rows(&[]);
        let d = least_squares(&forced.basis, &(&expected - &forced.response), 1e-13);
        let found = rows(&d);
        let error = (&found.response - &expected).amax();
        assert!(error < 1e-10, "{name}: lines off by {error:.1e}");
        let by_basis = &forced.response + &found.basis * DVector::from_column_slice(&d);
        let error = (by_basis - &found.response).amax();
        assert!(error < 1e-10, "{name}: the transient is off its basis by {error:.1e}");

        // transients that leave no trace, of states that are not seen, are not to be given; what they add to slopes is
        let (_, taken, _) = orthonormal(&found.basis, 1e-13);
        let hidden: Vec<Rows> = (0..n)
            .filter(|k| !taken.contains(k))
            .map(|k| {
                let mut d = least_squares(&found.basis, &-found.basis.column(k), 1e-13);
                d[k] += 1.0;
                rows(&d)
            })
            .collect();
        for j in 0..free.len() {
            let expected = scaled(&mut cut.slopes.iter().skip(j).step_by(free.len()).copied());
            let mut span = found.basis.clone();
            for hidden in &hidden {
                let at = span.ncols();
                span = span.insert_column(at, 0.0);
                span.set_column(at, &(hidden.slopes.column(j) - forced.slopes.column(j)));
            }
            let left = free_of(&(found.slopes.column(j) - &expected), &orthonormal(&span, 1e-13).0).amax();
            assert!(left <= 1e-9 * expected.amax().max(1e-4), "{name}: slope {j} off by {left:.1e}");
        }

        // the record in time, from its periodic part and its transient
        let free_part = system.free_response(&p.theta, &d, cut.length, cut.length).expect("stable");
        let periodic =
            in_time(&system.lines(&p.theta, &[], &w, &cut.u, &[], false).expect("stable").response, ny, &cut);
        for (k, y) in cut.y.iter().enumerate() {
            let error = (y - free_part[k] - periodic[k]).abs() * units[k % ny];
            assert!(error < 1e-9, "{name}: sample {} of the record off by {error:.1e}", k / ny);
        }
    }
}

/// The record whose lines from zero to half the sampling rate these are.
fn in_time(lines: &[C64], ny: usize, cut: &Cut) -> Vec<f64> {
    let (length, root) = (cut.length, (cut.length as f64).sqrt());
    let mut y = vec![0.0; length * ny];
    for (l, w) in points(length).iter().enumerate() {
        let count = if l == 0 || 2 * l == length { 1.0 } else { 2.0 };
        for (k, y) in y.chunks_exact_mut(ny).enumerate() {
            let turn = C64::from_polar(count / root, w.arg() * k as f64);
            y.iter_mut().zip(&lines[l * ny..]).for_each(|(y, z)| *y += (turn * z).re);
        }
    }
    y
}

#[test]
fn the_transfer_is_the_response_to_unit_inputs() {
    let mut random = Random(42);
    for (name, p) in every_kind(&mut random) {
        let (system, w) = (p.system(), points(75));
        let (nu, ny) = (system.inputs(), system.outputs());
        let transfer = system.transfer(&p.theta, &w).expect("stable");
        let each = sizes(&transfer, ny * nu);
        let size: Vec<f64> = each.chunks_exact(nu).map(|row| row.iter().copied().fold(0.0, f64::max)).collect();
        for a in 0..nu {
            let u: Vec<C64> = (0..w.len() * nu).map(|i| C64::from(f64::from(u8::from(i % nu == a)))).collect();
            let found = system.lines(&p.theta, &[], &w, &u, &[], false).expect("stable");
            for (i, z) in found.response.iter().enumerate() {
                let (line, o) = (i / ny, i % ny);
                let error = (z - transfer[(line * ny + o) * nu + a]).norm() / size[o];
                assert!(error < 1e-11, "{name}: line {line}, output {o}, input {a} off by {error:.1e}");
            }
        }
    }
}

/// Values do not depend on what else is asked for.
#[test]
fn values_with_and_without_derivatives_agree() {
    let mut random = Random(43);
    for (name, p) in every_kind(&mut random) {
        let (system, cut) = (p.system(), Cut::new(&p, &mut random));
        let w = points(cut.length);
        let size = sizes(&cut.z, system.outputs());
        let with = system.lines(&p.theta, &p.free(), &w, &cut.u, &[], true).expect("stable");
        let without = system.lines(&p.theta, &[], &w, &cut.u, &[], false).expect("stable");
        assert!(without.basis.is_empty() && without.slopes.is_empty());
        for (i, (a, b)) in with.response.iter().zip(&without.response).enumerate() {
            assert!((a - b).norm() < 1e-10 * size[i % size.len()], "{name}: {a} and {b}");
        }
    }
}

#[test]
fn folded_is_the_sum_over_whole_periods() {
    let mut random = Random(44);
    for (name, p) in every_kind(&mut random) {
        let (system, free) = (p.system(), p.free());
        let (nu, ny, np) = (system.inputs(), system.outputs(), free.len());
        let (period, samples) = (random.between(3.0, 70.0) as usize, random.between(150.0, 300.0) as usize);
        let first = random.between(0.0, 60.0) as usize;
        let u = random.signal(samples * nu);
        let (y, jacobian) = system.sensitivity(&p.theta, &free, &u).expect("stable");
        let (found, slopes) = system.folded(&p.theta, &free, &u, first, period, 1.0).expect("stable");
        let periods = (samples - first) / period;
        let sum = |x: &[f64], columns: usize| -> Vec<f64> {
            let of = |i: usize| (0..periods).map(|k| x[(first + k * period) * columns + i]).sum();
            (0..period * columns).map(of).collect()
        };
        assert!(common::deviation(&found, &sum(&y, ny), ny) < 1e-11, "{name}");
        assert!(common::deviation(&slopes, &sum(&jacobian, ny * np), ny * np) < 1e-11, "{name}");
        let (none, _) = system.folded(&p.theta, &free, &u, samples, period, 1.0).expect("stable");
        assert!(none.iter().all(|y| *y == 0.0), "{name}: no whole period");
    }
}

/// `y = 3 theta u` has no transient and is its own transfer.
#[test]
fn a_loop_without_states() {
    let (none, d) = (DMatrix::zeros, DMatrix::from_row_slice(2, 2, &[0.0, 3.0, 1.0, 0.0]));
    let gain = Gain { parameter: 0, scale: 1.0, power: 1 };
    let lft = Lft::new(none(0, 0), none(0, 2), none(2, 0), d, vec![gain]).expect("consistent");
    let system = ClosedLoop::new(Model::new(lft, 0.1, None).expect("consistent"), 1).expect("consistent");
    let w = points(8);
    let u: Vec<C64> = w.iter().map(|w| w * 2.0).collect();
    let found = system.lines(&[0.5], &[0], &w, &u, &[], true).expect("stable");
    assert!(found.basis.is_empty());
    for ((z, slope), u) in found.response.iter().zip(&found.slopes).zip(&u) {
        assert!((z - u * 1.5).norm() < 1e-14 && (slope - u * 3.0).norm() < 1e-14);
    }
    assert!(system.transfer(&[0.5], &w).expect("stable").iter().all(|g| (g - 1.5).norm() < 1e-14));
    assert_eq!(system.free_response(&[0.5], &[], 8, 8).expect("stable"), vec![0.0; 8]);
    let whitening = vec![C64::from(1.0); w.len()];
    let data = LineData::new(&system, w.clone(), u.clone(), vec![C64::from(0.0); w.len()], whitening).expect("fits");
    let normal = line_equations(&system, &[0.5], &[0], &[&data], &[]).expect("stable");
    let squares: f64 = u.iter().map(|u| u.norm_sqr()).sum();
    assert!((normal.cost - 2.25 * squares).abs() < 1e-13 * squares && normal.fitted.iter().all(|fitted| *fitted == 0));
}

fn shape<T>(result: Result<T>) -> bool {
    matches!(result, Err(Error::Shape { .. }))
}

fn not_finite<T>(result: Result<T>) -> bool {
    matches!(result, Err(Error::NotFinite { .. }))
}

#[test]
fn wrong_lengths() {
    let p = machine(0.0, 0.02);
    let system = p.system();
    let (w, zero) = (points(20), C64::from(0.0));
    let lines = w.len();
    let u = vec![zero; lines * 4];
    assert!(system.lines(&p.theta, &[0], &w, &u, &[0.0; 24], true).is_ok());
    assert!(shape(system.lines(&p.theta, &[0], &w, &u[1..], &[], true)), "inputs");
    assert!(shape(system.lines(&p.theta, &[9], &w, &u, &[], true)), "a parameter that does not exist");
    assert!(shape(system.lines(&p.theta[1..], &[], &w, &u, &[], true)), "theta");
    assert!(shape(system.lines(&p.theta, &[], &w, &u, &[0.0; 23], true)), "transient");
    assert!(shape(system.transfer(&p.theta[1..], &w)), "theta");
    assert!(shape(system.free_response(&p.theta, &[0.0; 25], 20, 20)), "transient");
    let data = |u: usize, z: usize, whitening: usize| {
        LineData::new(&system, w.clone(), vec![zero; u], vec![zero; z], vec![zero; whitening])
    };
    let good = data(4 * lines, 8 * lines, 64 * lines).expect("consistent");
    assert!(data(4 * lines, 3 * lines, 9 * lines).is_ok(), "fewer channels than outputs");
    assert!(shape(data(4 * lines - 1, 8 * lines, 64 * lines)), "inputs");
    assert!(shape(data(4 * lines, 8 * lines + 1, 64 * lines)), "outputs");
    assert!(shape(data(4 * lines, 8 * lines, 63 * lines)), "whitening");
    assert!(shape(data(4 * lines, 9 * lines, 81 * lines)), "more channels than outputs");
    assert!(shape(line_rows(&system, &p.theta, &[], &good, &[0.0; 3], true)), "transient");
    let other = lags(&[0.7], &[&[]], &[0]);
    assert!(shape(line_equations(&other.system(), &other.theta, &[0], &[&good], &[])), "a record of another loop");
    assert!(shape(line_rows(&other.system(), &other.theta, &[0], &good, &[], true)), "a record of another loop");
}

#[test]
fn numbers_that_are_not_finite() {
    let p = lags(&[0.7], &[&[]], &[0]);
    let system = p.system();
    let one = || vec![C64::from(1.0)];
    assert!(LineData::new(&system, one(), one(), one(), one()).is_ok());
    for bad in [f64::NAN, f64::INFINITY] {
        for bad in [C64::new(bad, 0.0), C64::new(0.0, bad)] {
            let bad = || vec![bad];
            assert!(not_finite(LineData::new(&system, bad(), one(), one(), one())));
            assert!(not_finite(LineData::new(&system, one(), bad(), one(), one())));
            assert!(not_finite(LineData::new(&system, one(), one(), bad(), one())));
            assert!(not_finite(LineData::new(&system, one(), one(), one(), bad())));
        }
        assert!(not_finite(system.lines(&[bad], &[], &one(), &one(), &[], false)));
        assert!(not_finite(system.transfer(&[bad], &one())));
        assert!(not_finite(system.free_response(&[bad], &[0.0], 4, 4)));
    }
}

#[test]
fn unstable_loops_have_no_lines() {
    let analog = machine(0.0, 0.02);
    let digital = lags(&[0.7], &[&[]], &[0]).under_digital(0.1, 50.0, 1.5);
    for mut p in [analog, digital] {
        if p.theta.len() == 9 {
            p.theta[..4].fill(1.0); // next to no force: the bearings do not levitate
        }
        let (system, w) = (p.system(), points(9));
        let u = vec![C64::from(1.0); w.len() * system.inputs()];
        let unstable = |e: Error| matches!(e, Error::Unstable { growth, .. } if growth > 1.0);
        assert!(unstable(system.lines(&p.theta, &p.free(), &w, &u, &[], true).unwrap_err()));
        assert!(unstable(system.transfer(&p.theta, &w).unwrap_err()));
        assert!(unstable(system.free_response(&p.theta, &[], 9, 9).unwrap_err()));
    }
}

/// A nonlinear loop is linearised at rest, where a curve `tanh` is the straight line; its slopes are refused.
#[test]
fn nonlinear_loops_are_linearised_at_rest() {
    let p = saturating(0.0, 4, Some(1));
    let (system, w) = (p.system(), points(40));
    let u = vec![C64::from(1.0); w.len() * system.inputs()];
    assert!(matches!(system.lines(&p.theta, &[0], &w, &u, &[], true), Err(Error::Singular { .. })));
    let found = system.lines(&p.theta, &[], &w, &u, &[], false).expect("stable").response;
    // small inputs from rest stay in the linear range, and lines of a record that dies out are its transfer
    let (nu, ny, samples) = (system.inputs(), system.outputs(), 40_000);
    let mut pulse = vec![0.0; samples * nu];
    pulse[..nu].fill(1e-7);
    let y = system.simulate(&p.theta, &pulse).expect("stable");
    let size = sizes(&found, ny);
    for (l, w) in w.iter().enumerate() {
        for o in 0..ny {
            let sum: C64 = (0..samples).map(|k| C64::from_polar(1e7, -w.arg() * k as f64) * y[k * ny + o]).sum();
            let error = (sum - found[l * ny + o]).norm() / size[o];
            assert!(error < 1e-5, "line {l}, output {o}: off by {error:.1e}");
        }
    }
}

/// Without derivatives and transients poles may lie as close as they like: it is the response of the other way.
#[test]
fn values_alone_of_clustered_poles() {
    let mut random = Random(47);
    for gap in std::iter::once(0.0).chain((0..20).map(|i| 10_f64.powf(-10.0 + 0.5 * f64::from(i)))) {
        for (name, p) in clusters(gap) {
            let (system, w) = (p.system(), points(200));
            let u: Vec<C64> = (0..w.len() * system.inputs()).map(|_| C64::from(random.between(-1.0, 1.0))).collect();
            let of = |with_basis| system.lines(&p.theta, &[], &w, &u, &[], with_basis).expect("stable").response;
            let (alone, beside) = (of(false), of(true));
            let size = sizes(&beside, system.outputs());
            for (i, (a, b)) in alone.iter().zip(&beside).enumerate() {
                let off = (a - b).norm() / size[i % system.outputs()];
                assert!(off < 1e-9, "{name}, gap {gap:.1e}: off by {off:.1e}");
            }
        }
    }
}

/// Of signals that fade away, times r^-k, lines lie on the circle of radius r.
#[test]
fn signals_that_fade_away() {
    let mut random = Random(61);
    let (p, samples, radius) = (machine(0.0, 0.02), 200, 1.01_f64);
    let system = p.system();
    let (nu, ny) = (system.inputs(), system.outputs());
    let u = random.signal(samples * nu);
    let y = system.simulate(&p.theta, &u).expect("stable");
    let faded = |x: &[f64], columns: usize| -> Vec<C64> {
        let x: Vec<f64> = x.iter().enumerate().map(|(i, x)| x * radius.powi(-((i / columns) as i32))).collect();
        transform(&x, columns)
    };
    let w: Vec<C64> = points(samples).iter().map(|w| w * radius).collect();
    let expected = stacked(&faded(&y, ny), w.len() * ny, 1).column(0).into_owned();
    let lines = |d: &[f64]| system.lines(&p.theta, &[], &w, &faded(&u, nu), d, true).expect("stable");
    let forced = Rows::new(&lines(&[]), states(&system, &p.theta), 0);
    let d = least_squares(&forced.basis, &(&expected - &forced.response), 1e-13);
    let found = Rows::new(&lines(&d), d.len(), 0);
    let error = (&found.response - &expected).amax() / expected.amax();
    assert!(error < 1e-10, "lines off by {error:.1e}");
}

/// A loop that grows by less than the circle does counts as stable there, and only there.
#[test]
fn a_pole_between_two_circles() {
    let p = lags(&[-50.0], &[&[]], &[0]);
    let (system, u) = (p.system(), [C64::from(1.0)]);
    let growth = system.poles(&p.theta).expect("regular")[0].re;
    assert!(growth > 0.0, "a time constant below zero grows");
    let on = |radius: f64| system.lines(&p.theta, &[], &[C64::new(0.0, radius)], &u, &[], false);
    assert!(matches!(on(1.0), Err(Error::Unstable { .. })));
    let beyond = (1.1 * growth * p.model.dt).exp();
    let found = on(beyond).expect("damped").response[0];
    let mu = (growth * p.model.dt).exp();
    let expected = (1.0 - mu) / (C64::new(0.0, beyond) - mu);
    assert!((found - expected).norm() < 1e-12 * expected.norm(), "{found} for {expected}");
}
