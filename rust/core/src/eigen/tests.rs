//! Residuals, invariants and closed forms.

use super::*;
use crate::common::random::Random;

/// Largest residual of an eigenpair relative to the matrix, and whether pairs stand together.
fn check(a: &DMatrix<f64>, what: &str) {
    let n = a.nrows();
    let (lambda, v) = eigen(a).expect("converges");
    assert_eq!(lambda.len(), n);
    let size = a.norm().max(f64::MIN_POSITIVE);
    for (j, l) in lambda.iter().enumerate() {
        let x = v.column(j).unscale(v.column(j).norm());
        let residual = (a.map(C64::from) * &x - &x * *l).norm() / size;
        assert!(residual < 1e-14, "{what}, {n} states: residual {residual:.1e}");
        assert!(l.im <= 0.0 || lambda[j + 1] == l.conj(), "{what}: a pair is torn");
    }
    let trace: C64 = lambda.iter().sum();
    assert!((trace - a.trace()).norm() < 1e-13 * n as f64 * size, "{what}: trace");
    let alone = eigenvalues(a).expect("converges");
    assert_eq!(alone.len(), n, "{what}");
}

#[test]
fn eigenpairs_satisfy_their_equation() {
    let mut random = Random(1);
    for n in (1..60).step_by(3) {
        let a = random.matrix(n, n);
        check(&a, "random");
        check(&(&a - a.transpose()), "skew");
        check(&a.map(|x| if x.abs() < 0.3 { x.signum() } else { 0.0 }), "sparse");
        check(&a.clone().qr().q(), "orthogonal");
        check(&DMatrix::from_fn(n, n, |i, j| a[(i, j)] * 10_f64.powi(-((i + j) as i32) / 2)), "graded");
        check(&DMatrix::from_fn(n, n, |i, j| a[(i, j)] * 10_f64.powi(i as i32 % 9 - j as i32 % 7)), "badly scaled");
        check(&(a.upper_triangle() * 1e90), "triangular and large");
        check(&(a * 1e-90), "small");
    }
}

#[test]
fn repeated_poles_are_found() {
    let mut random = Random(2);
    for n in (4..40).step_by(4) {
        let q = random.matrix(n, n).qr().q();
        let jordan = DMatrix::from_fn(n, n, |i, j| if i == j { (i / 4) as f64 } else { f64::from(j == i + 1) });
        check(&jordan, "Jordan");
        check(&(&q * jordan * q.transpose()), "Jordan, turned");
        check(&DMatrix::from_fn(n, n, |i, j| f64::from(i == j + 1)), "commands under way");
        check(&DMatrix::zeros(n, n), "zero");
        check(&DMatrix::identity(n, n), "identity");
    }
    check(&DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 1.0, 0.0]), "two states");
}

#[test]
fn matrices_that_plain_shifts_leave_unchanged_converge() {
    for n in 3..40 {
        let cycle = DMatrix::from_fn(n, n, |i, j| f64::from(i == (j + 1) % n));
        check(&cycle, "cycle");
        // Day (1996), "How the shifted QR algorithm fails to converge and how to fix it"
        let n = 2 * n;
        let day = DMatrix::from_fn(n, n, |i, j| match i {
            _ if j == i + 1 - 2 * (i % 2) => 1.0,
            _ if i % 2 == 0 && j == (i + n - 1) % n => 1e-3,
            _ => 0.0,
        });
        check(&day, "Day");
    }
}

#[test]
fn eigenvalues_of_a_cycle_are_the_roots_of_one() {
    let n = 12;
    let lambda = eigenvalues(&DMatrix::from_fn(n, n, |i, j| f64::from(i == (j + 1) % n))).unwrap();
    for k in 0..n {
        let root = C64::from_polar(1.0, std::f64::consts::TAU * k as f64 / n as f64);
        let nearest = lambda.iter().map(|l| (l - root).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-14, "off by {nearest:.1e}");
    }
}

#[test]
fn what_is_not_finite_has_no_eigenvalues() {
    assert!(eigenvalues(&DMatrix::from_element(3, 3, f64::NAN)).is_none());
    assert!(eigen(&DMatrix::zeros(0, 0)).is_some_and(|(lambda, _)| lambda.is_empty()));
}
