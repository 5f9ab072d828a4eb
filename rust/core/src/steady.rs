//! The steady state of a loop whose excitation repeats, linearised at rest, and the response from there on.

use nalgebra::{DMatrix, DVector, DVectorView};

use crate::discretise::{Discrete, discretise_scaled};
use crate::error::Result;
use crate::kernel::BLOCK;
use crate::linear::stable;
use crate::modal;
use crate::model::Model;
use crate::nonlinear::Nonlinear;
use crate::stop::go_on;

/// Part that a direction of the state changes by over a period, relative to the most, below which it does not decay.
const NEUTRAL: f64 = 1e-9;
/// Part of the change over a period that may be left of it in a steady state; else there is none.
const REPEATS: f64 = 1e-6;
/// Iterations per state after which singular values are given up, as LAPACK does.
const ITERATIONS: usize = 30;

/// Response (samples x outputs) to `u`, whose first `period` samples repeat, from the steady state of the linearised
/// loop on; from rest where that has none. Of a nonlinear loop each output is followed by its derivatives by `free`, which
/// begin with none; a linear one has none.
///
/// # Errors
/// As [`crate::ClosedLoop::simulate`].
pub fn from_steady_state(model: &Model, theta: &[f64], free: &[usize], u: &[f64], period: usize) -> Result<Vec<f64>> {
    let inputs = model.inputs();
    let (discrete, _, sizes) = discretise_scaled(model, theta, &[])?;
    let mu: Vec<_> = modal::poles(model, theta)?.into_iter().map(|pole| (pole * model.dt).exp()).collect();
    if model.lft.blocks.is_empty() {
        stable(&mu, model.dt)?;
        return follow(&discrete, steady_state(&discrete, &u[..period * inputs])?, u);
    }
    let run = Nonlinear::new(model, theta, free)?;
    if mu.iter().any(|mu| mu.norm() > 1.0 + NEUTRAL) {
        return run.run_from(&vec![0.0; discrete.a.nrows()], u); // such as one that is stuck at rest, and slips
    }
    let mut state: Vec<f64> = steady_state(&discrete, &u[..period * inputs])?.iter().copied().collect();
    state.iter_mut().zip(sizes).for_each(|(x, size)| *x *= size);
    run.run_from(&state, u)
}

/// The state at the beginning of a period of inputs that repeats; of directions that do not decay, such as the flux of
/// a hysteresis, none. At rest where these are driven on.
fn steady_state(discrete: &Discrete, u: &[f64]) -> Result<DVector<f64>> {
    let n = discrete.a.nrows();
    let (mut state, mut next, inputs) = (DVector::zeros(n), DVector::zeros(n), discrete.b.ncols());
    for (k, u) in u.chunks_exact(inputs).enumerate() {
        if k % BLOCK == 0 {
            go_on()?;
        }
        next.gemv(1.0, &discrete.a, &state, 0.0);
        next.gemv(1.0, &discrete.b, &DVectorView::from_slice(u, inputs), 1.0);
        std::mem::swap(&mut state, &mut next);
    }
    let open = DMatrix::identity(n, n) - discrete.a.pow((u.len() / inputs) as u32);
    let settled = || {
        // a loop that grows beyond all numbers over a period has no singular values, and looking for them no end
        let finite = open.iter().all(|x| x.is_finite());
        let parts = finite.then(|| open.clone().try_svd(true, true, 5.0 * f64::EPSILON, ITERATIONS * n)).flatten()?;
        let largest = parts.singular_values.max();
        let found = parts.solve(&state, NEUTRAL * largest).ok()?;
        // what a direction that does not decay is driven along grows from period to period
        ((&open * &found - &state).norm() <= REPEATS * state.norm()).then_some(found)
    };
    Ok(settled().unwrap_or_else(|| DVector::zeros(n)))
}

/// The response of a linear loop from a state on.
fn follow(discrete: &Discrete, mut state: DVector<f64>, u: &[f64]) -> Result<Vec<f64>> {
    let (inputs, mut next, mut y) = (discrete.b.ncols(), state.clone(), DVector::zeros(discrete.c.nrows()));
    let mut out = Vec::with_capacity(u.len() / inputs * y.len());
    for (k, u) in u.chunks_exact(inputs).enumerate() {
        if k % BLOCK == 0 {
            go_on()?;
        }
        let u = DVectorView::from_slice(u, inputs);
        y.gemv(1.0, &discrete.c, &state, 0.0);
        y.gemv(1.0, &discrete.d, &u, 1.0);
        out.extend(y.iter());
        next.gemv(1.0, &discrete.a, &state, 0.0);
        next.gemv(1.0, &discrete.b, &u, 1.0);
        std::mem::swap(&mut state, &mut next);
    }
    Ok(out)
}
