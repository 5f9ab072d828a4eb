//! The matrix exponential and the phi functions of an exponential integrator.
//!
//! `phi_0(z) = exp(z)`, `phi_j(z) = (phi_(j-1)(z) - 1/(j-1)!) / z`. Taylor series of a small step, then doubling:
//! `phi_j(2 z) = (exp(z) phi_j(z) + sum_(i=1..j) phi_i(z) / (j-i)!) / 2^j`, Skaflestad and Wright (2009).

use nalgebra::DMatrix;

use crate::error::{Error, Result};

/// Terms of the series: the rest is below rounding for a norm of a half.
const TERMS: usize = 16;

/// `exp(A t)`, and `t phi_j(A t) B` for j = 1, 2, 3.
pub struct Phi {
    pub exp: DMatrix<f64>,
    pub b: [DMatrix<f64>; 3],
}

impl Phi {
    /// The columns of B do not act on each other, so that B may have any scale.
    ///
    /// # Errors
    /// [`Error::Singular`] where A t is not finite or too large to exponentiate.
    pub fn new(a: &DMatrix<f64>, b: &DMatrix<f64>, t: f64) -> Result<Self> {
        let n = a.nrows();
        let norm = (0..n).map(|j| a.column(j).lp_norm(1)).fold(0.0, f64::max) * t;
        if !norm.is_finite() || norm > 1e8 {
            return Err(Error::Singular { what: "the matrix exponential over one step overflows" });
        }
        let doublings = (2.0 * norm).log2().ceil().max(0.0) as i32;
        let step = t * f64::from(-doublings).exp2();
        let (a, b) = (a * step, b * step);
        let eye = DMatrix::identity(n, n);
        let mut exp = eye.clone();
        for k in (1..=TERMS).rev() {
            exp = &a * exp / k as f64 + &eye;
        }
        let inverse_factorial = |k: usize| 1.0 / (1..=k).map(|i| i as f64).product::<f64>();
        let mut third = DMatrix::zeros(n, b.ncols());
        for k in (3..TERMS).rev() {
            third = &a * third + &b * inverse_factorial(k);
        }
        let second = &a * &third + &b * 0.5;
        let first = &a * &second + &b;
        let mut phi = Self { exp, b: [first, second, third] };
        for _ in 0..doublings {
            phi.double();
        }
        Ok(phi)
    }

    fn double(&mut self) {
        let Self { exp, b: [first, second, third] } = self;
        *third = (&*exp * &*third + &*first * 0.5 + &*second + &*third) * 0.25;
        *second = (&*exp * &*second + &*first + &*second) * 0.5;
        *first = &*exp * &*first + &*first;
        *exp = &*exp * &*exp;
    }
}
