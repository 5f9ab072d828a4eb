//! Real Schur form `A = Q T Q'` by Francis' implicit double-shift QR iteration.
//!
//! Source: LAPACK's `dlahqr` (Anderson et al. 1999, "LAPACK Users' Guide") and Golub, Van Loan (2013), "Matrix
//! Computations", section 7.5. T is block triangular: a block of two rows is a complex pair.

use nalgebra::linalg::Hessenberg;
use nalgebra::{Complex, DMatrix};

/// Sweeps for one eigenvalue, or a pair, after which the iteration is given up; a few are usual.
const MAX_SWEEPS: usize = 300;

/// T, and Q where `vectors` are wanted (else it has no rows). `None` where a number is not finite.
pub fn schur(a: &DMatrix<f64>, vectors: bool) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let n = a.nrows();
    if !a.iter().all(|x| x.is_finite()) {
        return None;
    }
    if n < 2 {
        return Some((a.clone(), DMatrix::identity(n, n)));
    }
    let hessenberg = Hessenberg::new(a.clone());
    let (mut q, mut t) = match vectors {
        true => hessenberg.unpack(),
        false => (DMatrix::zeros(0, n), hessenberg.unpack_h()),
    };
    let (mut end, mut sweeps) = (n, 0);
    while end > 0 {
        let hi = end - 1;
        let lo = deflate(&mut t, hi);
        if hi - lo > 1 {
            if sweeps == MAX_SWEEPS {
                return None;
            }
            sweeps += 1;
            // now and then other shifts, for matrices that the usual ones do not change
            let exceptional = match sweeps % 20 {
                10 => Some(lo),
                0 => Some(hi - 2),
                _ => None,
            };
            sweep(&mut t, &mut q, (lo, hi), exceptional);
            continue;
        }
        if hi > lo {
            split(&mut t, &mut q, lo);
        }
        (end, sweeps) = (lo, 0);
    }
    Some((t, q))
}

/// First row of the block that ends with row `hi`, whose link to the rows above is cut.
///
/// Negligible is what changes an eigenvalue by a rounding: Ahues, Tisseur (1997), LAPACK Working Note 122.
fn deflate(t: &mut DMatrix<f64>, hi: usize) -> usize {
    let n = t.nrows();
    for k in (1..=hi).rev() {
        let below = t[(k, k - 1)].abs();
        let (x, y) = (t[(k - 1, k - 1)], t[(k, k)]);
        let mut size = x.abs() + y.abs();
        if size == 0.0 {
            if k >= 2 {
                size += t[(k - 1, k - 2)].abs();
            }
            if k + 1 < n {
                size += t[(k + 1, k)].abs();
            }
        }
        let small = below <= f64::MIN_POSITIVE * n as f64 / f64::EPSILON
            || (below <= f64::EPSILON * size && {
                let above = t[(k - 1, k)].abs();
                let (ab, ba) = (below.max(above), below.min(above));
                let (aa, bb) = (y.abs().max((x - y).abs()), y.abs().min((x - y).abs()));
                let s = aa + ab;
                ba * (ab / s) <= f64::EPSILON * (bb * (aa / s))
            });
        if small {
            t[(k, k - 1)] = 0.0;
            return k;
        }
    }
    0
}

/// v, w and beta of the reflector `1 - w v'` that takes x to `(beta, 0, 0)`; `None` where x is so already.
fn reflector(x: [f64; 3]) -> Option<([f64; 3], [f64; 3], f64)> {
    let scale = x[0].abs() + x[1].abs() + x[2].abs();
    if x[1] == 0.0 && x[2] == 0.0 {
        return None;
    }
    let p = x.map(|x| x / scale);
    let s = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt().copysign(p[0]);
    let v0 = p[0] + s;
    Some(([1.0, p[1] / v0, p[2] / v0], [v0 / s, p[1] / s, p[2] / s], -s * scale))
}

/// The two shifts: eigenvalues of the last two rows, of real ones the nearer twice.
fn shifts(t: &DMatrix<f64>, (lo, hi): (usize, usize), exceptional: Option<usize>) -> [Complex<f64>; 2] {
    let [a, b, c, d] = if let Some(at) = exceptional {
        let s = t[(at + 1, at)].abs() + t[(at + 2, at + 1)].abs();
        let h = 0.75 * s + if at == lo { t[(at, at)] } else { t[(hi, hi)] };
        [h, -0.4375 * s, s, h]
    } else {
        [t[(hi - 1, hi - 1)], t[(hi - 1, hi)], t[(hi, hi - 1)], t[(hi, hi)]]
    };
    let s = a.abs() + b.abs() + c.abs() + d.abs();
    if s == 0.0 {
        return [Complex::from(0.0); 2];
    }
    let (a, b, c, d) = (a / s, b / s, c / s, d / s);
    let middle = (a + d) / 2.0;
    let square = (a - middle) * (d - middle) - b * c;
    let root = square.abs().sqrt();
    if square >= 0.0 {
        return [Complex::new(middle * s, root * s), Complex::new(middle * s, -root * s)];
    }
    let (x, y) = (middle + root, middle - root);
    [Complex::from(s * if (x - d).abs() <= (y - d).abs() { x } else { y }); 2]
}

/// One double-shift sweep over the block of rows lo..=hi, from T and Q.
fn sweep(t: &mut DMatrix<f64>, q: &mut DMatrix<f64>, (lo, hi): (usize, usize), exceptional: Option<usize>) {
    let [rt1, rt2] = shifts(t, (lo, hi), exceptional);
    // first column of (T - rt1) (T - rt2) from row m on, but for its scale
    let first = |t: &DMatrix<f64>, m: usize| {
        let h21 = t[(m + 1, m)];
        let s = (t[(m, m)] - rt2.re).abs() + rt2.im.abs() + h21.abs();
        let g = h21 / s;
        let v = [
            g * t[(m, m + 1)] + (t[(m, m)] - rt1.re) * ((t[(m, m)] - rt2.re) / s) - rt1.im * (rt2.im / s),
            g * (t[(m, m)] + t[(m + 1, m + 1)] - rt1.re - rt2.re),
            g * t[(m + 2, m + 1)],
        ];
        let s = v[0].abs() + v[1].abs() + v[2].abs();
        if s == 0.0 { v } else { v.map(|v| v / s) }
    };
    // start below two consecutive small links
    let mut start = hi - 2;
    let mut x = first(t, start);
    while start > lo {
        let h00 = t[(start - 1, start - 1)].abs();
        let tail = t[(start, start - 1)].abs() * (x[1].abs() + x[2].abs());
        if tail <= f64::EPSILON * x[0].abs() * (h00 + t[(start, start)].abs() + t[(start + 1, start + 1)].abs()) {
            break;
        }
        start -= 1;
        x = first(t, start);
    }
    for k in start..hi {
        let three = k + 1 < hi;
        if k > start {
            x = [t[(k, k - 1)], t[(k + 1, k - 1)], if three { t[(k + 2, k - 1)] } else { 0.0 }];
        }
        let Some((v, w, beta)) = reflector(x) else { continue };
        if k > start {
            t[(k, k - 1)] = beta;
            t[(k + 1, k - 1)] = 0.0;
            if three {
                t[(k + 2, k - 1)] = 0.0;
            }
        } else if k > lo {
            t[(k, k - 1)] *= 1.0 - w[0];
        }
        left(t, k, three, &v, &w);
        right(t, k, hi.min(k + 3) + 1, three, &v, &w);
        let rows = q.nrows();
        right(q, k, rows, three, &v, &w);
    }
}

/// The reflector from the left, on rows k.. of columns k...
fn left(t: &mut DMatrix<f64>, k: usize, three: bool, v: &[f64; 3], w: &[f64; 3]) {
    let n = t.nrows();
    for column in t.as_mut_slice()[k * n..].chunks_exact_mut(n) {
        if three {
            let [a, b, c] = [column[k], column[k + 1], column[k + 2]];
            let sum = a + v[1] * b + v[2] * c;
            column[k] = a - sum * w[0];
            column[k + 1] = b - sum * w[1];
            column[k + 2] = c - sum * w[2];
        } else {
            let [a, b] = [column[k], column[k + 1]];
            let sum = a + v[1] * b;
            column[k] = a - sum * w[0];
            column[k + 1] = b - sum * w[1];
        }
    }
}

/// The reflector from the right, on columns k.. of so many rows.
fn right(m: &mut DMatrix<f64>, k: usize, rows: usize, three: bool, v: &[f64; 3], w: &[f64; 3]) {
    let n = m.nrows();
    let (a, rest) = m.as_mut_slice()[k * n..].split_at_mut(n);
    if three {
        let (b, c) = rest.split_at_mut(n);
        for ((a, b), c) in a[..rows].iter_mut().zip(&mut b[..rows]).zip(&mut c[..rows]) {
            let sum = *a * w[0] + *b * w[1] + *c * w[2];
            *a -= sum;
            *b -= sum * v[1];
            *c -= sum * v[2];
        }
    } else {
        for (a, b) in a[..rows].iter_mut().zip(&mut rest[..rows]) {
            let sum = *a * w[0] + *b * w[1];
            *a -= sum;
            *b -= sum * v[1];
        }
    }
}

/// Makes the block of rows lo, lo + 1 triangular where its eigenvalues are real.
fn split(t: &mut DMatrix<f64>, q: &mut DMatrix<f64>, lo: usize) {
    let hi = lo + 1;
    let (a, b, c, d) = (t[(lo, lo)], t[(lo, hi)], t[(hi, lo)], t[(hi, hi)]);
    let p = (a - d) / 2.0;
    let scale = p.abs().max(b.abs()).max(c.abs());
    let disc = (p / scale) * p + (b / scale) * c;
    if disc < 0.0 {
        return;
    }
    // eigenvalue d + z, eigenvector (z, c)
    let z = p + (scale.sqrt() * disc.sqrt()).copysign(p);
    let norm = z.hypot(c);
    let (cos, sin) = (z / norm, c / norm);
    let n = t.nrows();
    for j in lo..n {
        let (x, y) = (t[(lo, j)], t[(hi, j)]);
        t[(lo, j)] = cos * x + sin * y;
        t[(hi, j)] = cos * y - sin * x;
    }
    for (m, rows) in [(&mut *t, hi + 1), (q, usize::MAX)] {
        for i in 0..rows.min(m.nrows()) {
            let (x, y) = (m[(i, lo)], m[(i, hi)]);
            m[(i, lo)] = cos * x + sin * y;
            m[(i, hi)] = cos * y - sin * x;
        }
    }
    t[(lo, lo)] = d + z;
    t[(hi, hi)] = if z == 0.0 { d } else { d - b / z * c };
    t[(hi, lo)] = 0.0;
}
