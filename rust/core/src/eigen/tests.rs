//! Eigenvalues against closed forms, and where they are hard to come by.

use nalgebra::DMatrix;

use super::*;
use crate::common::random::Random;

/// Commands under way of `m` channels, all but the last step's gone in `delay` samples; the last feed back `gain` times.
fn queue(m: usize, delay: usize, gain: f64) -> DMatrix<f64> {
    let n = m * delay;
    let fed = |i: usize, j: usize| if i < m && j == n - m + i { gain * (1.0 + i as f64) } else { 0.0 };
    DMatrix::from_fn(n, n, |i, j| if i >= m && j == i - m { 1.0 } else { fed(i, j) })
}

/// Sums of the eigenvalues and of their squares are the traces of the matrix and of its square.
fn assert_traces(a: &DMatrix<f64>, found: &[C64]) {
    let size = found.iter().map(|x| x.norm_sqr()).sum::<f64>().max(f64::MIN_POSITIVE);
    let (once, twice): (C64, C64) = (found.iter().sum(), found.iter().map(|x| x * x).sum());
    assert!((once - a.trace()).norm() < 1e-9 * size.sqrt() * a.nrows() as f64);
    assert!((twice - (a * a).trace()).norm() < 1e-9 * size * a.nrows() as f64);
}

#[test]
fn roots_of_one() {
    for (m, delay) in [(1, 3), (4, 20), (4, 40)] {
        let a = queue(m, delay, 1.0);
        let found = eigenvalues(&a).unwrap();
        for x in &found {
            let gain = x.powu(delay as u32);
            let nearest = (1..=m).map(|i| (gain - i as f64).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-9, "{x} is no root of a whole number");
        }
        assert_traces(&a, &found);
    }
}

/// Nothing but equal eigenvalues, more of them than the blocked iteration takes.
#[test]
fn nilpotent_queues_end() {
    for gain in [0.0, 1e-300, 1e-30, 1e-16, 1e-8] {
        let a = queue(4, 30, gain);
        assert!(eigenvalues(&a).unwrap().iter().all(|x| x.norm() < 1.1));
    }
}

#[test]
fn coefficients_of_any_size_end() {
    let mut random = Random(5);
    for n in [6, 40, 90] {
        let mut a = DMatrix::from_fn(n, n, |_, _| 10f64.powf(300.0 * random.between(-1.0, 1.0)));
        if let Ok(found) = eigenvalues(&a) {
            assert!(found.iter().all(|x| x.re.is_finite() && x.im.is_finite()));
        }
        a[(0, 0)] = f64::NAN;
        assert!(matches!(eigenvalues(&a), Err(Error::NotFinite { .. })));
    }
}

#[test]
fn vectors_are_those_of_the_values() {
    let mut random = Random(7);
    for n in [1, 2, 9, 80] {
        let a = DMatrix::from_fn(n, n, |_, _| random.between(-1.0, 1.0));
        let (lambda, v) = eigenvectors(&a).unwrap();
        let left = a.map(C64::from) * &v - &v * DMatrix::from_diagonal(&lambda.clone().into());
        assert!(left.norm() < 1e-11 * v.norm() * n as f64, "off by {:.1e}", left.norm());
        assert_traces(&a, &lambda);
        assert_traces(&a, &eigenvalues(&reflected(&a)).unwrap());
    }
}
