//! Matrix exponential and its exact derivative (Pade 13, scaling and squaring).
//!
//! Higham (2005), "The scaling and squaring method for the matrix exponential revisited"; derivative after
//! Al-Mohy and Higham (2009), "Computing the Frechet derivative of the matrix exponential", algorithm 6.4.

use nalgebra::DMatrix;

use crate::error::{Error, Result};
use crate::stop::go_on;

const B: [f64; 14] = [
    64_764_752_532_480_000.0,
    32_382_376_266_240_000.0,
    7_771_770_303_897_600.0,
    1_187_353_796_428_800.0,
    129_060_195_264_000.0,
    10_559_470_521_600.0,
    670_442_572_800.0,
    33_522_128_640.0,
    1_323_241_920.0,
    40_840_800.0,
    960_960.0,
    16_380.0,
    182.0,
    1.0,
];
/// Largest 1-norm for which the Pade approximant and its derivative are exact to rounding.
const THETA_13: f64 = 4.74;

/// `exp(a)` and, for each direction `e`, the derivative of `exp(a + s e)` by s at 0.
///
/// # Errors
/// [`Error::Singular`] where `a` is not finite or too large to exponentiate, or the result overflows.
pub fn expm(a: &DMatrix<f64>, directions: &[DMatrix<f64>]) -> Result<(DMatrix<f64>, Vec<DMatrix<f64>>)> {
    let too_large = Error::Singular { what: "the matrix exponential over one sample overflows" };
    let n = a.nrows();
    let norm = (0..n).map(|j| a.column(j).lp_norm(1)).fold(0.0, f64::max);
    if norm > 1e8 || !a.iter().all(|x| x.is_finite()) {
        return Err(too_large);
    }
    let squarings = (norm / THETA_13).log2().ceil().max(0.0) as i32;
    let scale = f64::from(-squarings).exp2();
    let a = a * scale;
    let eye = DMatrix::<f64>::identity(n, n);
    let a2 = &a * &a;
    let a4 = &a2 * &a2;
    let a6 = &a4 * &a2;
    let w1 = &a6 * B[13] + &a4 * B[11] + &a2 * B[9];
    let w2 = &a6 * B[7] + &a4 * B[5] + &a2 * B[3] + &eye * B[1];
    let z1 = &a6 * B[12] + &a4 * B[10] + &a2 * B[8];
    let z2 = &a6 * B[6] + &a4 * B[4] + &a2 * B[2] + &eye * B[0];
    let w = &a6 * &w1 + w2;
    let u = &a * &w;
    let v = &a6 * &z1 + z2;
    let lu = (&v - &u).lu();
    let mut r = lu.solve(&(&u + &v)).ok_or_else(|| too_large.clone())?;
    let mut derivatives = Vec::with_capacity(directions.len());
    for e in directions {
        go_on()?;
        let e = e * scale;
        let m2 = &a * &e + &e * &a;
        let m4 = &a2 * &m2 + &m2 * &a2;
        let m6 = &a4 * &m2 + &m4 * &a2;
        let lw = &a6 * (&m6 * B[13] + &m4 * B[11] + &m2 * B[9]) + &m6 * &w1 + (&m6 * B[7] + &m4 * B[5] + &m2 * B[3]);
        let lu_part = &a * lw + &e * &w;
        let lv_part =
            &a6 * (&m6 * B[12] + &m4 * B[10] + &m2 * B[8]) + &m6 * &z1 + (&m6 * B[6] + &m4 * B[4] + &m2 * B[2]);
        let right = &lu_part + &lv_part + (&lu_part - &lv_part) * &r;
        derivatives.push(lu.solve(&right).expect("the same matrix was solved before"));
    }
    for _ in 0..squarings {
        for l in &mut derivatives {
            *l = &r * &*l + &*l * &r;
        }
        r = &r * &r;
    }
    if !derivatives.iter().chain([&r]).all(|m| m.iter().all(|x| x.is_finite())) {
        return Err(too_large);
    }
    Ok((r, derivatives))
}

#[cfg(test)]
mod tests;
