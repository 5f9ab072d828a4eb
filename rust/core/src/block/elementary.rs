//! Elementary functions of the two magnets of an axis side by side, without calls: a call costs more than all of it.

use std::f64::consts::LOG2_E;

use crate::product::fused;

/// The two magnets of an axis.
pub(super) type Pair = [f64; 2];

const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// Largest size of an exponent: beyond it the exponential is no number of full precision any more.
const LARGEST: f64 = 708.0;

/// `1/2!, 1/3!, .. 1/13!`.
const INVERSE_FACTORIALS: [f64; 12] = [
    0.5,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// Of `2 atanh(s) = 2 s + s (l0 s^2 + l1 s^4 + ..)` for `s^2 < 0.03`, to 2^-58: fdlibm, `e_log.c`.
const LOGARITHM: [f64; 7] = [
    6.666_666_666_666_735e-1,
    3.999_999_999_940_942e-1,
    2.857_142_874_366_239e-1,
    2.222_219_843_214_978_4e-1,
    1.818_357_216_161_805e-1,
    1.531_383_769_920_937_3e-1,
    1.479_819_860_511_658_6e-1,
];

/// `exp(y) = scale (1 + small)`: `y = k ln 2 + r`, and the exponential of r less one is its Taylor series, which keeps
/// small numbers exact.
#[inline(always)]
fn parts<const FMA: bool>(y: f64) -> (f64, f64) {
    const TO_INTEGER: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: adding it rounds to an integer
    let c = &INVERSE_FACTORIALS;
    let shifted = fused::<FMA>(y, LOG2_E, TO_INTEGER);
    let k = shifted - TO_INTEGER;
    let r = fused::<FMA>(k, -LN_2_LOW, fused::<FMA>(k, -LN_2_HIGH, y));
    let r2 = r * r;
    let r4 = r2 * r2;
    let pair = |i: usize| fused::<FMA>(c[i + 1], r, c[i]);
    let four = |i: usize| fused::<FMA>(r2, pair(i + 2), pair(i));
    let series = fused::<FMA>(r4, fused::<FMA>(r4, four(8), four(4)), four(0));
    let small = fused::<FMA>(r2, series, r);
    let scale = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1.0_f64.to_bits())); // 2^k
    (small, scale)
}

/// To a few units in the last place, as all that follow; what is too large or too small for it becomes the last number.
#[inline(always)]
pub fn exp<const FMA: bool>(y: Pair) -> Pair {
    let mut out = [0.0; 2];
    for (out, y) in out.iter_mut().zip(y) {
        let (small, scale) = parts::<FMA>(y.clamp(-LARGEST, LARGEST));
        *out = fused::<FMA>(small, scale, scale);
    }
    out
}

/// Of x >= 0; that of zero is that of the smallest number.
#[inline(always)]
pub fn ln<const FMA: bool>(x: Pair) -> Pair {
    const HALF_OF_TWO: u64 = 0x3fe6_a09e_0000_0000; // the root of a half, from which on the mantissa is taken
    let c = &LOGARITHM;
    let mut out = [0.0; 2];
    for (out, x) in out.iter_mut().zip(x) {
        let bits = x.max(f64::MIN_POSITIVE).to_bits().wrapping_sub(HALF_OF_TWO);
        let k = f64::from((bits as i64 >> 52) as i32);
        let f = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) + HALF_OF_TWO) - 1.0;
        let s = f / (2.0 + f);
        let (z, half) = (s * s, 0.5 * f * f);
        let z2 = z * z;
        let even = z2 * fused::<FMA>(z2, fused::<FMA>(z2, c[5], c[3]), c[1]);
        let odd = fused::<FMA>(z2, fused::<FMA>(z2, fused::<FMA>(z2, c[6], c[4]), c[2]), c[0]);
        let rest = fused::<FMA>(s, half + fused::<FMA>(z, odd, even), k * LN_2_LOW) - half;
        *out = fused::<FMA>(k, LN_2_HIGH, f + rest);
    }
    out
}

/// `e/(e + 2)` with `e = exp(2 |x|) - 1`.
#[inline(always)]
pub fn tanh<const FMA: bool>(x: Pair) -> Pair {
    let mut out = [0.0; 2];
    for (out, x) in out.iter_mut().zip(x) {
        let (small, scale) = parts::<FMA>(2.0 * x.abs().min(20.0));
        let e = fused::<FMA>(small, scale, scale - 1.0);
        *out = (e / (e + 2.0)).copysign(x);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error relative to what the standard library finds, with and without fused products.
    fn error(ours: [Pair; 2], theirs: f64) -> f64 {
        ours.as_flattened().iter().map(|own| (own - theirs).abs()).fold(0.0, f64::max) / theirs.abs()
    }

    #[test]
    fn tanh_is_that_of_the_standard_library() {
        for i in -4000..=4000 {
            let x = f64::from(i) * 7.3e-3;
            if x != 0.0 {
                let error = error([tanh::<false>([x; 2]), tanh::<true>([x; 2])], x.tanh());
                assert!(error <= 6e-16, "tanh({x}) off by {error:.1e}");
            }
        }
        assert_eq!(tanh::<false>([1e-200, f64::INFINITY]), [1e-200, 1.0]);
        assert_eq!(tanh::<false>([0.0; 2]), [0.0; 2]);
    }

    #[test]
    fn exp_is_that_of_the_standard_library() {
        for i in -4000..=4000 {
            let x = f64::from(i) * 0.177;
            let error = error([exp::<false>([x; 2]), exp::<true>([x; 2])], x.exp());
            assert!(error <= 6e-16, "exp({x}) off by {error:.1e}");
        }
        let [least, most] = exp::<true>([f64::NEG_INFINITY, f64::INFINITY]);
        assert!(least < 1e-306 && most > 1e306 && most.is_finite());
    }

    #[test]
    fn ln_is_that_of_the_standard_library() {
        for i in -4000..=4000 {
            for x in [(f64::from(i) * 0.177).exp(), 1.0 + f64::from(i) * 2.3e-4] {
                if x > 0.0 && x != 1.0 {
                    let error = error([ln::<false>([x; 2]), ln::<true>([x; 2])], x.ln());
                    assert!(error <= 6e-16, "ln({x}) off by {error:.1e}");
                }
            }
        }
        assert_eq!(ln::<true>([1.0, 0.0]), [0.0, f64::MIN_POSITIVE.ln()]);
    }
}
