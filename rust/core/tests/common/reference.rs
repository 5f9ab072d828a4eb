//! Response and sensitivities computed another way: the loop acted out sample by sample in complex numbers.
//!
//! Derivatives are complex steps, exact to rounding; matrix exponentials are Taylor series with scaling.

use std::collections::VecDeque;

use ambid_core::{Controller, Lft, Model};
use nalgebra::{Complex, DMatrix, DVector};

type C64 = Complex<f64>;
type Matrix = DMatrix<C64>;

/// Size of the complex step; its square vanishes beside any number of a response.
const STEP: f64 = 1e-60;

/// Response from rest, samples x outputs, and its derivatives, samples x outputs x `free`, both row by row.
pub fn sensitivity(model: &Model, theta: &[f64], free: &[usize], u: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let real: Vec<C64> = theta.iter().map(|t| C64::from(*t)).collect();
    let y = response(model, &real, u).iter().map(|y| y.re).collect::<Vec<_>>();
    let mut slopes = vec![0.0; y.len() * free.len()];
    for (j, parameter) in free.iter().enumerate() {
        let mut stepped = real.clone();
        stepped[*parameter].im = STEP;
        let column = slopes.iter_mut().skip(j).step_by(free.len());
        column.zip(response(model, &stepped, u)).for_each(|(s, y)| *s = y.im / STEP);
    }
    (y, slopes)
}

/// `exp(a)` by its Taylor series, halved until the series converges fast.
pub fn taylor_expm(a: &Matrix) -> Matrix {
    let n = a.nrows();
    let norm = (0..n).map(|j| a.column(j).iter().map(|x| x.norm()).sum()).fold(0.0, f64::max);
    let halvings = norm.max(0.25).log2().ceil() as i32 + 2;
    let scaled = a * C64::from(f64::from(-halvings).exp2());
    let (mut term, mut sum) = (Matrix::identity(n, n), Matrix::identity(n, n));
    for k in 1..24 {
        term = &term * &scaled / C64::from(f64::from(k));
        sum += &term;
    }
    for _ in 0..halvings {
        sum = &sum * &sum;
    }
    sum
}

/// The plant with Delta closed.
struct Plant {
    a: Matrix,
    b: Matrix,
    c: Matrix,
    d: Matrix,
}

impl Plant {
    fn new(lft: &Lft, theta: &[C64]) -> Self {
        let (nu, ny, k) = (lft.inputs(), lft.outputs(), lft.gains.len());
        let complex = |m: &DMatrix<f64>| m.map(C64::from);
        let (a, b, c, d) = (complex(&lft.a), complex(&lft.b), complex(&lft.c), complex(&lft.d));
        let entry = |i: usize| theta[lft.gains[i].parameter].powi(lft.gains[i].power) * lft.gains[i].scale;
        let delta = Matrix::from_fn(k, k, |i, j| if i == j { entry(i) } else { C64::from(0.0) });
        let open = Matrix::identity(k, k) - d.view((ny, nu), (k, k)) * &delta;
        let w = delta * open.try_inverse().expect("no singular algebraic loop");
        let (w_x, w_u) = (&w * c.rows(ny, k), &w * d.view((ny, 0), (k, nu)));
        Self {
            a: a + b.columns(nu, k) * &w_x,
            b: b.columns(0, nu) + b.columns(nu, k) * &w_u,
            c: c.rows(0, ny) + d.view((0, nu), (ny, k)) * &w_x,
            d: d.view((0, 0), (ny, nu)) + d.view((0, nu), (ny, k)) * &w_u,
        }
    }

    /// Transition over `t` and response to an input held that long.
    fn hold(&self, t: C64) -> (Matrix, Matrix) {
        let (n, m) = self.b.shape();
        let mut block = Matrix::zeros(n + m, n + m);
        block.view_mut((0, 0), (n, n)).copy_from(&self.a);
        block.view_mut((0, n), (n, m)).copy_from(&self.b);
        let whole = taylor_expm(&(block * t));
        (whole.view((0, 0), (n, n)).into_owned(), whole.view((0, n), (n, m)).into_owned())
    }
}

fn response(model: &Model, theta: &[C64], u: &[f64]) -> Vec<C64> {
    let plant = Plant::new(&model.lft, theta);
    let rows = u.chunks_exact(model.inputs()).map(|row| DVector::from_iterator(row.len(), row.iter().map(C64::from)));
    match &model.controller {
        Some(controller) => digital(&plant, controller, theta, model.dt, rows),
        None => analog(&plant, model.dt, rows),
    }
}

fn analog(plant: &Plant, dt: f64, rows: impl Iterator<Item = DVector<C64>>) -> Vec<C64> {
    let (a, b) = plant.hold(C64::from(dt));
    let mut x = DVector::zeros(a.nrows());
    let mut y = Vec::new();
    for u in rows {
        y.extend((&plant.c * &x + &plant.d * &u).iter());
        x = &a * &x + &b * &u;
    }
    y
}

/// The controller computes a command each of its samples; the plant gets it after the delay.
///
/// Further inputs act on the plant from the sample on, as do those of a record that is held.
fn digital(
    plant: &Plant,
    k: &Controller,
    theta: &[C64],
    dt: f64,
    rows: impl Iterator<Item = DVector<C64>>,
) -> Vec<C64> {
    let [ka, kb, mut kc, mut kd] = [&k.a, &k.b, &k.c, &k.d].map(|m| m.map(C64::from));
    let mut excitation = k.excitation.map(C64::from);
    for error in &k.errors {
        let theta = theta[error.parameter];
        kc += error.c.map(C64::from) * theta;
        kd += error.d.map(C64::from) * theta;
        excitation += error.excitation.map(C64::from) * theta;
    }
    let (m, all, step) = (k.d.nrows(), plant.b.ncols(), dt / k.steps as f64);
    let delay = k.late.map_or(C64::from(0.0), |late| theta[late] * k.steps as f64 / dt) + k.delay;
    let whole = delay.re as usize;
    let fraction = delay - whole as f64;
    let (early, late) = (plant.hold(fraction * step), plant.hold((-fraction + 1.0) * step));
    let at_first = whole + usize::from(k.late.is_some() || fraction.re > 0.0);
    let mut commands = VecDeque::from(vec![DVector::zeros(m); whole + 2]);
    let (mut x, mut controller) = (DVector::zeros(plant.a.nrows()), DVector::zeros(ka.nrows()));
    let mut y = Vec::new();
    for u in rows {
        let mut acting = u.rows(0, all).into_owned();
        for sample in 0..k.steps {
            acting.rows_mut(0, m).fill(C64::from(0.0));
            let read = (&plant.c * &x + &plant.d * &acting).rows(0, m).into_owned();
            commands.push_front(&excitation * u.rows(0, m) - &kc * &controller - &kd * &read);
            commands.pop_back();
            acting.rows_mut(0, m).copy_from(&commands[at_first]);
            if sample == 0 {
                y.extend((&plant.c * &x + &plant.d * &acting).iter().take(plant.c.nrows() - k.hidden));
            }
            controller = &ka * &controller + &kb * &read;
            x = &early.0 * &x + &early.1 * &acting;
            acting.rows_mut(0, m).copy_from(&commands[whole]);
            x = &late.0 * &x + &late.1 * &acting;
        }
    }
    y
}
