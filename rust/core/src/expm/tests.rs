//! The exponential against closed forms, its derivative against differences and the block-triangular identity.

use super::*;
use crate::common::random::Random;
use crate::common::reference::taylor_expm;
use nalgebra::Complex;

fn value(a: &DMatrix<f64>) -> DMatrix<f64> {
    expm(a, &[]).unwrap().0
}

/// A square matrix, row by row.
fn square(entries: &[f64]) -> DMatrix<f64> {
    let n = entries.len().isqrt();
    DMatrix::from_row_slice(n, n, entries)
}

fn assert_close(found: &DMatrix<f64>, expected: &DMatrix<f64>, tolerance: f64) {
    let error = (found - expected).norm() / expected.norm();
    assert!(error < tolerance, "off by {error:.1e}");
}

#[test]
fn diagonal() {
    let a = DMatrix::from_diagonal(&vec![-3.0, 0.5, 2.0].into());
    let expected = DMatrix::from_diagonal(&vec![(-3.0_f64).exp(), 0.5_f64.exp(), 2.0_f64.exp()].into());
    assert_close(&value(&a), &expected, 1e-14);
}

#[test]
fn nilpotent() {
    let a = square(&[0.0, 2.0, 3.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0]);
    assert_close(&value(&a), &square(&[1.0, 2.0, 3.0 + 4.0, 0.0, 1.0, 4.0, 0.0, 0.0, 1.0]), 1e-14);
}

/// Angles up to 40 rad: several squarings.
#[test]
fn rotation() {
    for angle in [0.1, 3.0, 40.0_f64] {
        let a = square(&[0.0, -angle, angle, 0.0]);
        let (sine, cosine) = angle.sin_cos();
        assert_close(&value(&a), &square(&[cosine, -sine, sine, cosine]), 1e-12);
    }
}

/// A stiff matrix of norm 3000 whose exponential is known from its eigenvectors.
#[test]
fn large_norm() {
    let (turn, back) = (square(&[1.0, 1.0, 0.0, 1.0]), square(&[1.0, -1.0, 0.0, 1.0]));
    let with = |fast: f64, slow: f64| &turn * square(&[fast, 0.0, 0.0, slow]) * &back;
    assert_close(&value(&with(-3000.0, -0.5)), &with(0.0, (-0.5_f64).exp()), 1e-12);
}

#[test]
fn empty_and_zero() {
    assert_eq!(value(&DMatrix::zeros(0, 0)).shape(), (0, 0));
    assert_eq!(value(&DMatrix::zeros(2, 2)), DMatrix::identity(2, 2));
}

#[test]
fn random_matrices_against_taylor() {
    let mut random = Random(1);
    for scale in [0.01, 0.5, 3.0, 10.0] {
        let a = random.matrix(6, 6) * scale;
        let expected = taylor_expm(&a.map(Complex::from)).map(|x| x.re);
        assert_close(&value(&a), &expected, 1e-12);
    }
}

/// `exp [A E; 0 A]` holds the derivative in its upper right block.
#[test]
fn derivative_is_the_block_of_the_augmented_exponential() {
    let mut random = Random(2);
    for scale in [0.01, 1.0, 5.0] {
        let (a, e) = (random.matrix(5, 5) * scale, random.matrix(5, 5));
        let mut augmented = DMatrix::zeros(10, 10);
        augmented.view_mut((0, 0), (5, 5)).copy_from(&a);
        augmented.view_mut((5, 5), (5, 5)).copy_from(&a);
        augmented.view_mut((0, 5), (5, 5)).copy_from(&e);
        let expected = value(&augmented).view((0, 5), (5, 5)).into_owned();
        let (_, derivatives) = expm(&a, &[e.clone(), e * 2.0]).unwrap();
        assert_close(&derivatives[0], &expected, 1e-12);
        assert_close(&derivatives[1], &(expected * 2.0), 1e-12);
    }
}

#[test]
fn derivative_against_central_differences() {
    let mut random = Random(3);
    let (a, e) = (random.matrix(5, 5) * 3.0, random.matrix(5, 5));
    let h = 1e-5;
    let difference = (value(&(&a + &e * h)) - value(&(&a - &e * h))) / (2.0 * h);
    assert_close(&expm(&a, &[e]).unwrap().1[0], &difference, 1e-8);
}

/// The derivative along the matrix itself is that of `exp(s a)`.
#[test]
fn derivative_along_itself() {
    let a = square(&[-2.0, 7.0, -7.0, -2.0]);
    let (whole, derivatives) = expm(&a, std::slice::from_ref(&a)).unwrap();
    assert_close(&derivatives[0], &(&a * whole), 1e-12);
}

#[test]
fn what_overflows_is_an_error() {
    for entry in [f64::NAN, f64::INFINITY, 1e300, 2e4] {
        assert!(matches!(expm(&square(&[entry]), &[]), Err(Error::Singular { .. })), "{entry}");
    }
    assert_eq!(value(&square(&[-2e4])), square(&[0.0]), "what decays does not overflow");
}
