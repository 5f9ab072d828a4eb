//! The upper linear fractional transformation: everything known in G, everything uncertain in Delta.
//!
//! ```text
//! x' = A x + B [u; w]      w = Delta(theta) z
//! [y; z] = C x + D [u; w]
//! ```
//!
//! Delta holds gains first, then nonlinear blocks; w and z stand in that order.

use nalgebra::DMatrix;

use crate::block::{Block, SIGNALS};
use crate::error::{Error, Result, check_finite};

/// One diagonal entry of Delta: `scale * theta[parameter]^power`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Index into the parameter vector.
    pub parameter: usize,
    /// Constant factor.
    pub scale: f64,
    /// Exponent: 1 for `K_i` and `K_s`, -1 for a time constant, 2 for a frequency.
    pub power: i32,
}

impl Gain {
    /// Value of the entry.
    pub fn value(&self, theta: &[f64]) -> f64 {
        self.scale * theta[self.parameter].powi(self.power)
    }

    /// Derivative of the entry by its parameter.
    pub fn slope(&self, theta: &[f64]) -> f64 {
        self.scale * f64::from(self.power) * theta[self.parameter].powi(self.power - 1)
    }
}

/// G of the LFT, with the last inputs and outputs closed by Delta.
#[derive(Debug, Clone)]
pub struct Lft {
    /// n x n.
    pub a: DMatrix<f64>,
    /// n x (inputs + gains + blocks).
    pub b: DMatrix<f64>,
    /// (outputs + gains + inputs of the blocks) x n.
    pub c: DMatrix<f64>,
    /// (outputs + gains + inputs of the blocks) x (inputs + gains + blocks).
    pub d: DMatrix<f64>,
    /// Diagonal of the linear part of Delta.
    pub gains: Vec<Gain>,
    /// Nonlinear part of Delta.
    pub blocks: Vec<Block>,
}

/// The loop with its gains closed, their ports still open for small changes of them.
///
/// A change `dDelta` changes the response from u to y by `H_yw dDelta H_zu` to first order. The ports of nonlinear
/// blocks are open too: w of the blocks follows u in the columns, z of the blocks follows y in the rows.
#[derive(Debug, Clone)]
pub struct Closed {
    pub a: DMatrix<f64>,
    pub b_u: DMatrix<f64>,
    pub b_w: DMatrix<f64>,
    pub c_y: DMatrix<f64>,
    pub c_z: DMatrix<f64>,
    pub d_yu: DMatrix<f64>,
    pub d_yw: DMatrix<f64>,
    pub d_zu: DMatrix<f64>,
}

impl Lft {
    /// A linear loop. Checks sizes and finiteness.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn new(a: DMatrix<f64>, b: DMatrix<f64>, c: DMatrix<f64>, d: DMatrix<f64>, gains: Vec<Gain>) -> Result<Self> {
        Self::with_blocks(a, b, c, d, gains, Vec::new())
    }

    /// The same with nonlinear blocks.
    ///
    /// # Errors
    /// As [`Lft::new`].
    pub fn with_blocks(
        a: DMatrix<f64>,
        b: DMatrix<f64>,
        c: DMatrix<f64>,
        d: DMatrix<f64>,
        gains: Vec<Gain>,
        blocks: Vec<Block>,
    ) -> Result<Self> {
        let shape = |what, m: &DMatrix<f64>, rows: usize, columns: usize| {
            if m.shape() == (rows, columns) {
                return check_finite(what, m.as_slice());
            }
            let size = |(r, c): (usize, usize)| format!("{r} x {c}");
            Err(Error::Shape { what, found: size(m.shape()), expected: size((rows, columns)) })
        };
        let (n, k) = (a.nrows(), gains.len());
        let signals: usize = blocks.iter().map(Block::inputs).sum();
        shape("A", &a, n, n)?;
        shape("B", &b, n, b.ncols().max(k + blocks.len()))?;
        shape("C", &c, c.nrows().max(k + signals), n)?;
        shape("D", &d, c.nrows(), b.ncols())?;
        Ok(Self { a, b, c, d, gains, blocks })
    }

    /// Number of inputs u.
    pub fn inputs(&self) -> usize {
        self.b.ncols() - self.gains.len() - self.blocks.len()
    }

    /// Number of outputs y.
    pub fn outputs(&self) -> usize {
        self.c.nrows() - self.gains.len() - self.signals()
    }

    /// Number of signals z that the blocks read.
    pub fn signals(&self) -> usize {
        self.blocks.iter().map(Block::inputs).sum()
    }

    /// The parameter of every gain and coefficient of a block that has one.
    pub fn parameters(&self) -> impl Iterator<Item = usize> {
        let blocks = self.blocks.iter().flat_map(|block| block.parameters().map(|(_, parameter)| parameter));
        self.gains.iter().map(|gain| gain.parameter).chain(blocks)
    }

    /// Closes the gains at `theta`; the ports of the blocks become further inputs and outputs.
    ///
    /// # Errors
    /// [`Error::Singular`] where `I - D_zw Delta` has no inverse or an entry of Delta, or its derivative, is not finite.
    pub fn close(&self, theta: &[f64]) -> Result<Closed> {
        let k = self.gains.len();
        let (nu, ny) = (self.inputs(), self.outputs());
        let delta: Vec<f64> = self.gains.iter().map(|g| g.value(theta)).collect();
        let slopes = self.gains.iter().map(|g| g.slope(theta));
        if delta.iter().copied().chain(slopes).any(|g| !g.is_finite()) {
            return Err(Error::Singular { what: "an entry of Delta or its derivative is not finite" });
        }
        let d_yu = self.d.clone().remove_columns(nu, k).remove_rows(ny, k);
        let b_w = self.b.columns(nu, k).into_owned();
        let d_yw = self.d.columns(nu, k).into_owned().remove_rows(ny, k);
        let d_zw = self.d.view((ny, nu), (k, k));

        // z = f (C_z x + D_zu u) with f = (I - D_zw Delta)^-1, and w = Delta z
        let mut c_z = self.c.rows(ny, k).into_owned();
        let mut d_zu = self.d.rows(ny, k).into_owned().remove_columns(nu, k);
        let mut loop_w = DMatrix::identity(k, k); // w of a unit change at the port: I + Delta f D_zw
        if d_zw.iter().any(|v| *v != 0.0) {
            let mut m = DMatrix::identity(k, k);
            for (j, g) in delta.iter().enumerate() {
                for i in 0..k {
                    m[(i, j)] -= d_zw[(i, j)] * g;
                }
            }
            let mut f = m.try_inverse().ok_or(Error::Singular { what: "I - D_zw Delta" })?;
            let follows = reached(&d_zw.into_owned());
            f.iter_mut().zip(follows.iter()).filter(|(_, follows)| !**follows).for_each(|(f, _)| *f = 0.0); // rounding
            c_z = &f * c_z;
            d_zu = &f * d_zu;
            loop_w += scale_rows(&(&f * d_zw), &delta);
        }
        let closing_x = scale_rows(&c_z, &delta);
        let closing_u = scale_rows(&d_zu, &delta);
        let mut closed = Closed {
            a: self.a.clone(),
            b_u: self.b.clone().remove_columns(nu, k),
            b_w: &b_w * &loop_w,
            c_y: self.c.clone().remove_rows(ny, k),
            c_z,
            d_yu,
            d_yw: &d_yw * &loop_w,
            d_zu,
        };
        add_product(&mut closed.a, &b_w, &closing_x);
        add_product(&mut closed.b_u, &b_w, &closing_u);
        add_product(&mut closed.c_y, &d_yw, &closing_x);
        add_product(&mut closed.d_yu, &d_yw, &closing_u);
        Ok(closed)
    }

    /// Closes all of Delta at `theta`, the blocks by their slopes at rest; where there are blocks, no port is left.
    ///
    /// # Errors
    /// As [`Lft::close`].
    pub fn close_at_rest(&self, theta: &[f64]) -> Result<Closed> {
        let closed = self.close(theta)?;
        if self.blocks.is_empty() {
            return Ok(closed);
        }
        let (nu, ny, nv, nq) = (self.inputs(), self.outputs(), self.blocks.len(), self.signals());
        let mut slopes = DMatrix::zeros(nv, nq);
        let mut first = 0;
        for (v, block) in self.blocks.iter().enumerate() {
            let mut by_coefficient = vec![0.0; block.coefficients()];
            let (_, by_z) = block.at(theta)?.evaluate::<false, true>([0.0; SIGNALS], &mut by_coefficient);
            (0..block.inputs()).for_each(|i| slopes[(v, first + i)] = by_z[i]);
            first += block.inputs();
        }
        let open = DMatrix::identity(nq, nq) - closed.d_yu.view((ny, nu), (nq, nv)) * &slopes;
        let delta = slopes * open.try_inverse().ok_or(Error::Singular { what: "I - D_zw Delta of the blocks" })?;
        let (by_x, by_u) = (&delta * closed.c_y.rows(ny, nq), &delta * closed.d_yu.view((ny, 0), (nq, nu)));
        let (b_v, d_yv) = (closed.b_u.columns(nu, nv), closed.d_yu.view((0, nu), (ny, nv)));
        let n = self.a.nrows();
        Ok(Closed {
            a: &closed.a + b_v * &by_x,
            b_u: closed.b_u.columns(0, nu) + b_v * &by_u,
            c_y: closed.c_y.rows(0, ny) + d_yv * &by_x,
            d_yu: closed.d_yu.view((0, 0), (ny, nu)) + d_yv * &by_u,
            b_w: DMatrix::zeros(n, 0),
            c_z: DMatrix::zeros(0, n),
            d_yw: DMatrix::zeros(ny, 0),
            d_zu: DMatrix::zeros(0, nu),
        })
    }
}

/// Which row follows which column at once, directly or by way of others; every one follows itself.
fn reached(m: &DMatrix<f64>) -> DMatrix<bool> {
    let k = m.nrows();
    let mut found = DMatrix::from_fn(k, k, |i, j| i == j || m[(i, j)] != 0.0);
    for by in 0..k {
        for j in (0..k).filter(|j| *j != by) {
            if found[(by, j)] {
                (0..k).for_each(|i| found[(i, j)] |= found[(i, by)]);
            }
        }
    }
    found
}

fn scale_rows(m: &DMatrix<f64>, factors: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| factors[i] * m[(i, j)])
}

/// `target += left right`, skipping the zeros of `left`: Delta ports act on few states.
fn add_product(target: &mut DMatrix<f64>, left: &DMatrix<f64>, right: &DMatrix<f64>) {
    for p in 0..left.ncols() {
        for i in (0..left.nrows()).filter(|i| left[(*i, p)] != 0.0) {
            for j in 0..target.ncols() {
                target[(i, j)] += left[(i, p)] * right[(p, j)];
            }
        }
    }
}

impl Closed {
    /// Scales the states by powers of two so that rows and columns of A are of like size; says how much smaller they
    /// became.
    ///
    /// The response stays the same to the last bit; matrix exponentials and eigenvectors gain digits.
    pub fn balance(&mut self) -> Vec<f64> {
        let t = balancing(&self.a);
        let n = t.len();
        for j in 0..n {
            for i in 0..n {
                self.a[(i, j)] *= t[j] / t[i];
            }
        }
        for (i, t) in t.iter().enumerate() {
            self.b_u.row_mut(i).scale_mut(1.0 / t);
            self.b_w.row_mut(i).scale_mut(1.0 / t);
            self.c_y.column_mut(i).scale_mut(*t);
            self.c_z.column_mut(i).scale_mut(*t);
        }
        t
    }
}

/// Diagonal state scaling, powers of two, after Osborne (1960), as LAPACK's `gebal`.
pub(crate) fn balancing(a: &DMatrix<f64>) -> Vec<f64> {
    let n = a.nrows();
    let mut t = vec![1.0_f64; n];
    for _ in 0..10 {
        let mut changed = false;
        for i in 0..n {
            let (mut row, mut column) = (0.0, 0.0);
            for j in (0..n).filter(|j| *j != i) {
                row += (a[(i, j)] * t[j]).abs();
                column += (a[(j, i)] / t[j]).abs();
            }
            row /= t[i];
            column *= t[i];
            if row > 0.0 && column > 0.0 {
                let factor = (0.5 * (row / column).log2()).round();
                if factor != 0.0 {
                    t[i] *= factor.exp2();
                    changed = true;
                }
            }
        }
        if !changed {
            break;
        }
    }
    t
}
