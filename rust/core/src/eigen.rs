//! Eigenvalues and eigenvectors of a real matrix, in a bounded number of steps.
//!
//! Of the two iterations of faer only the unblocked one ends always, after 30 steps a state as LAPACK's. The blocked one,
//! its usual way from 75 states on, sorts and moves the values of a window until none is out of place: where many are
//! equal but for rounding, as those of commands under way, it may change places for ever.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, EvdParams, evd_real, evd_scratch};
use faer::{Auto, Mat, Par};
use nalgebra::{Complex, DMatrix};

use crate::error::{Error, Result};
use crate::lft::balancing;

type C64 = Complex<f64>;

/// Eigenvalues of a matrix whose states may be of very unlike size.
///
/// What does not converge in these states does so in others: after the matrix its transpose and a reflection are tried.
///
/// # Errors
/// [`Error::NotFinite`] of the matrix, or of what is left of it in states of like size; [`Error::Singular`] where
/// nothing converges.
pub fn eigenvalues(a: &DMatrix<f64>) -> Result<Vec<C64>> {
    let (t, n) = (balancing(a), a.nrows());
    let a = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * t[j] / t[i]);
    if a.iter().any(|x| !x.is_finite()) {
        return Err(Error::NotFinite { what: "the matrix of the closed loop, in states of like size," });
    }
    let tries = [|a: &DMatrix<f64>| a.clone(), |a: &DMatrix<f64>| a.transpose(), reflected];
    let found = tries.iter().find_map(|states| decomposed(&states(&a), None));
    found.ok_or(Error::Singular { what: NOT_CONVERGED })
}

/// Eigenvalues, and eigenvectors of any length as columns; `None` where they do not converge.
pub fn eigenvectors(a: &DMatrix<f64>) -> Option<(Vec<C64>, DMatrix<C64>)> {
    let n = a.nrows();
    let mut u = Mat::zeros(n, n);
    let lambda = decomposed(a, Some(&mut u))?;
    let mut v = DMatrix::from_fn(n, n, |i, j| C64::from(u[(i, j)]));
    // of a conjugate pair, the real and the imaginary part of the first one's vector stand side by side
    let mut j = 0;
    while j + 1 < n {
        if lambda[j].im == 0.0 {
            j += 1;
            continue;
        }
        for i in 0..n {
            v[(i, j)] = C64::new(u[(i, j)], u[(i, j + 1)]);
            v[(i, j + 1)] = v[(i, j)].conj();
        }
        j += 2;
    }
    Some((lambda, v))
}

pub const NOT_CONVERGED: &str = "its poles cannot be computed, since their iteration does not converge; scale the \
                                 controller's matrices, or lower its order or the delay";

fn decomposed(a: &DMatrix<f64>, vectors: Option<&mut Mat<f64>>) -> Option<Vec<C64>> {
    let n = a.nrows();
    let mut settings = <EvdParams as Auto<f64>>::auto();
    settings.schur.blocking_threshold = usize::MAX;
    let settings = settings.into();
    let matrix = Mat::from_fn(n, n, |i, j| a[(i, j)]);
    // what does not converge stays as it is here, and nothing else says so
    let (mut re, mut im) = (Diag::<f64>::zeros(n), Diag::<f64>::zeros(n));
    re.column_vector_mut().fill(f64::NAN);
    let wanted = if vectors.is_some() { ComputeEigenvectors::Yes } else { ComputeEigenvectors::No };
    let mut memory = MemBuffer::new(evd_scratch::<f64>(n, ComputeEigenvectors::No, wanted, Par::Seq, settings));
    let stack = MemStack::new(&mut memory);
    let vectors = vectors.map(|u| u.as_mut());
    evd_real(matrix.as_ref(), re.as_mut(), im.as_mut(), None, vectors, Par::Seq, stack, settings).ok()?;
    let (re, im) = (re.column_vector(), im.column_vector());
    let lambda: Vec<C64> = re.iter().zip(im.iter()).map(|(re, im)| C64::new(*re, *im)).collect();
    lambda.iter().all(|x| x.re.is_finite() && x.im.is_finite()).then_some(lambda)
}

/// The matrix in states reflected at the plane across `(1, 1, ..)`, which mixes them all.
pub fn reflected(a: &DMatrix<f64>) -> DMatrix<f64> {
    let h = reflection(a.nrows());
    &h * a * &h
}

/// The reflection at the plane across `(1, 1, ..)`, its own inverse.
pub fn reflection(n: usize) -> DMatrix<f64> {
    let part = 2.0 / n.max(1) as f64;
    DMatrix::from_fn(n, n, |i, j| f64::from(i == j) - part)
}

#[cfg(test)]
mod tests;
