//! Eigenvalues and eigenvectors of a real matrix.
//!
//! From its real Schur form, the vectors by back-substitution; as LAPACK's `dgeev`, which also balances: the matrices
//! of a loop come balanced. Written here since general libraries that have it take longer to compile than all else.

mod schur;

use nalgebra::{Complex, DMatrix};

use schur::schur;

type C64 = Complex<f64>;

/// Eigenvalues; of a complex pair the upper one first, its conjugate next. `None` where they do not converge.
pub fn eigenvalues(a: &DMatrix<f64>) -> Option<Vec<C64>> {
    schur(a, false).map(|(t, _)| spectrum(&t))
}

/// Eigenvalues, in the order of [`eigenvalues`], and as columns the eigenvectors, of any length.
///
/// Where they are clustered the vectors are those of a matrix that differs by roundings.
pub fn eigen(a: &DMatrix<f64>) -> Option<(Vec<C64>, DMatrix<C64>)> {
    let (t, q) = schur(a, true)?;
    let lambda = spectrum(&t);
    let n = t.nrows();
    let size = t.amax();
    let tiny = if size > 0.0 { f64::EPSILON * size } else { 1.0 };
    let (mut re, mut im) = (DMatrix::<f64>::zeros(n, n), DMatrix::<f64>::zeros(n, n));
    for (k, l) in lambda.iter().enumerate().filter(|(_, l)| l.im >= 0.0) {
        let (re, im) = (&mut re.as_mut_slice()[k * n..][..n], &mut im.as_mut_slice()[k * n..][..n]);
        solve(&t, *l, k, tiny, (re, im));
    }
    let (re, im) = (&q * re, &q * im);
    let v = DMatrix::from_fn(n, n, |i, j| match lambda[j].im {
        x if x < 0.0 => C64::new(re[(i, j - 1)], -im[(i, j - 1)]),
        _ => C64::new(re[(i, j)], im[(i, j)]),
    });
    Some((lambda, v))
}

/// The eigenvalues of the blocks of T.
fn spectrum(t: &DMatrix<f64>) -> Vec<C64> {
    let mut all = Vec::with_capacity(t.nrows());
    while all.len() < t.nrows() {
        let lambda = eigenvalue(t, all.len());
        all.push(lambda);
        if lambda.im > 0.0 {
            all.push(lambda.conj());
        }
    }
    all
}

/// The eigenvalue of the block that begins with row k, the upper one of a pair.
fn eigenvalue(t: &DMatrix<f64>, k: usize) -> C64 {
    if k + 1 < t.nrows() && t[(k + 1, k)] != 0.0 {
        let (a, b, c, d) = (t[(k, k)], t[(k, k + 1)], t[(k + 1, k)], t[(k + 1, k + 1)]);
        let p = (a - d) / 2.0;
        let scale = p.abs().max(b.abs()).max(c.abs());
        let disc = (p / scale) * p + (b / scale) * c;
        return C64::new((a + d) / 2.0, scale.sqrt() * (-disc).max(0.0).sqrt());
    }
    C64::from(t[(k, k)])
}

/// The eigenvector of block k: `(T - l) x = 0`, from the block upwards. x comes as zeros, in real and imaginary parts.
///
/// Divisors below `tiny` are taken as that: the eigenvalue is repeated.
fn solve(t: &DMatrix<f64>, l: C64, k: usize, tiny: f64, (re, im): (&mut [f64], &mut [f64])) {
    let n = t.nrows();
    // x_j is known: what follows for the rows above
    let put = |j: usize, x: C64, re: &mut [f64], im: &mut [f64]| {
        let column = &t.as_slice()[j * n..][..j];
        for ((r, i), t) in re.iter_mut().zip(im.iter_mut()).zip(column) {
            *r -= t * x.re;
            *i -= t * x.im;
        }
        (re[j], im[j]) = (x.re, x.im);
    };
    if l.im > 0.0 {
        // the larger of the two rows gives
        let (a, b, c, d) = (t[(k, k)], t[(k, k + 1)], t[(k + 1, k)], t[(k + 1, k + 1)]);
        let (x, y) = if b.abs() >= c.abs() { (C64::from(1.0), (l - a) / b) } else { ((l - d) / c, C64::from(1.0)) };
        put(k + 1, y, re, im);
        put(k, x, re, im);
    } else {
        put(k, C64::from(1.0), re, im);
    }
    let mut j = k;
    while j > 0 {
        j -= 1;
        let size = re[..=j].iter().chain(&im[..=j]).fold(0.0_f64, |m, x| m.max(x.abs()));
        if size > 1e100 {
            re.iter_mut().chain(im.iter_mut()).for_each(|x| *x /= size);
        }
        if j > 0 && t[(j, j - 1)] != 0.0 {
            let (a, b, c, d) = (t[(j - 1, j - 1)] - l, t[(j - 1, j)], t[(j, j - 1)], t[(j, j)] - l);
            let (r, s) = (C64::new(re[j - 1], im[j - 1]), C64::new(re[j], im[j]));
            // Gaussian elimination with the larger pivot of the first column
            let (x, y) = if a.norm() >= c.abs() {
                let f = c / a;
                let y = (s - f * r) / guard(d - f * b, tiny);
                ((r - b * y) / a, y)
            } else {
                let f = a / c;
                let y = (r - f * s) / guard(b - f * d, tiny);
                ((s - d * y) / c, y)
            };
            put(j, y, re, im);
            put(j - 1, x, re, im);
            j -= 1;
        } else {
            let x = C64::new(re[j], im[j]) / guard(t[(j, j)] - l, tiny);
            put(j, x, re, im);
        }
    }
}

fn guard(x: C64, tiny: f64) -> C64 {
    if x.norm() < tiny { C64::from(tiny) } else { x }
}

#[cfg(test)]
mod tests;
