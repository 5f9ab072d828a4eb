//! Exact zero-order hold of a loop over one sample of the record, and its exact derivative by the parameters.

use nalgebra::DMatrix;

use crate::error::{Error, Result};
use crate::expm::expm;
use crate::lft::Closed;
use crate::model::{Controller, GainError, Model};
use crate::reading::{Group, groups};

/// Part of a sample by which rounding parts one instant from another.
const SAME_INSTANT: f64 = 1e-12;

/// `x[k+1] = a x[k] + b u[k]`, `y[k] = c x[k] + d u[k]`; also the derivative of one by a parameter.
#[derive(Debug, Clone)]
pub struct Discrete {
    /// States x states.
    pub a: DMatrix<f64>,
    /// States x inputs.
    pub b: DMatrix<f64>,
    /// Outputs x states.
    pub c: DMatrix<f64>,
    /// Outputs x inputs.
    pub d: DMatrix<f64>,
}

impl Discrete {
    /// The same system in states that are `t` times smaller.
    pub(crate) fn rescale(&mut self, t: &[f64]) {
        for (i, t) in t.iter().enumerate() {
            self.a.row_mut(i).scale_mut(1.0 / t);
            self.b.row_mut(i).scale_mut(1.0 / t);
            self.a.column_mut(i).scale_mut(*t);
            self.c.column_mut(i).scale_mut(*t);
        }
    }

    /// `[a b; c d]`.
    pub(crate) fn stacked(&self) -> DMatrix<f64> {
        let (n, m) = self.b.shape();
        let mut out = DMatrix::zeros(n + self.c.nrows(), n + m);
        for (at, part) in [((0, 0), &self.a), ((0, n), &self.b), ((n, 0), &self.c), ((n, n), &self.d)] {
            out.view_mut(at, part.shape()).copy_from(part);
        }
        out
    }
}

/// A value and its derivatives, one per free parameter.
struct Dual {
    value: DMatrix<f64>,
    slopes: Vec<DMatrix<f64>>,
}

impl Dual {
    fn constant(value: DMatrix<f64>, parameters: usize) -> Self {
        let zero = DMatrix::zeros(value.nrows(), value.ncols());
        Self { value, slopes: vec![zero; parameters] }
    }

    fn times(&self, right: &Self) -> Self {
        let slopes = (self.slopes.iter().zip(&right.slopes)).map(|(l, r)| l * &right.value + &self.value * r).collect();
        Self { value: &self.value * &right.value, slopes }
    }

    fn plus(&self, right: &Self) -> Self {
        let slopes = (self.slopes.iter().zip(&right.slopes)).map(|(l, r)| l + r).collect();
        Self { value: &self.value + &right.value, slopes }
    }

    /// Takes over some of the rows.
    fn replace(&mut self, rows: &[usize], from: &Self) {
        let own = [&mut self.value].into_iter().chain(&mut self.slopes);
        for (own, from) in own.zip([&from.value].into_iter().chain(&from.slopes)) {
            rows.iter().for_each(|row| own.set_row(*row, &from.row(*row)));
        }
    }

    /// Applies a linear map (padding, selection, multiplication by a constant) to the value and to each slope.
    fn map(&self, f: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> Self {
        Self { value: f(&self.value), slopes: self.slopes.iter().map(f).collect() }
    }
}

/// The sampled loop and its derivative by each parameter in `free`.
///
/// Of an output that is late, C and D are those of its phase after a sample; whole samples are left to the caller.
///
/// Nonlinear blocks are linearised at rest; then `free` must be empty.
///
/// # Errors
/// [`Error::Singular`] where Delta cannot be closed, the exponential overflows, or a displacement that a digital
/// controller reads follows its command at once.
pub fn discretise(model: &Model, theta: &[f64], free: &[usize]) -> Result<(Discrete, Vec<Discrete>)> {
    let (value, slopes, _) = discretise_scaled(model, theta, free)?;
    Ok((value, slopes))
}

/// The same, and how much smaller the states of the plant are than those of the model.
pub fn discretise_scaled(model: &Model, theta: &[f64], free: &[usize]) -> Result<(Discrete, Vec<Discrete>, Vec<f64>)> {
    let mut closed = model.lft.close_at_rest(theta)?;
    let sizes = closed.balance();
    let plant = Plant::new(model, &closed, theta, free);
    let late = groups(model, theta, free)?;
    let (value, slopes) = match &model.controller {
        None => {
            let (a, b) = plant.hold(model.dt, &vec![0.0; free.len()])?;
            let (mut c, mut d) = (plant.c.map(Clone::clone), plant.d.map(Clone::clone));
            for Group { instant, outputs } in &late {
                let (x, u) = plant.hold(instant.phase, &instant.slopes)?;
                c.replace(outputs, &plant.c.times(&x));
                d.replace(outputs, &plant.c.times(&u).plus(&plant.d));
            }
            collect(&a, &b, &c, &d)
        }
        Some(controller) => sampled(&plant, &controller.at(theta, model.dt)?, model.dt, free, &late)?,
    };
    Ok((value, slopes, sizes))
}

/// The closed continuous plant with its derivatives.
struct Plant {
    a: Dual,
    b: Dual,
    c: Dual,
    d: Dual,
}

impl Plant {
    fn new(model: &Model, closed: &Closed, theta: &[f64], free: &[usize]) -> Self {
        let gains = &model.lft.gains;
        // dX = left . dDelta . right, summed over the gains of one parameter
        let slopes = |left: &DMatrix<f64>, right: &DMatrix<f64>| -> Vec<DMatrix<f64>> {
            let slope_of = |parameter: &usize| {
                let mut sum = DMatrix::zeros(left.nrows(), right.ncols());
                for (k, gain) in gains.iter().enumerate().filter(|(_, g)| g.parameter == *parameter) {
                    sum.ger(gain.slope(theta), &left.column(k), &right.row(k).transpose(), 1.0);
                }
                sum
            };
            free.iter().map(slope_of).collect()
        };
        let dual = |value: &DMatrix<f64>, slopes| Dual { value: value.clone(), slopes };
        Self {
            a: dual(&closed.a, slopes(&closed.b_w, &closed.c_z)),
            b: dual(&closed.b_u, slopes(&closed.b_w, &closed.d_zu)),
            c: dual(&closed.c_y, slopes(&closed.d_yw, &closed.c_z)),
            d: dual(&closed.d_yu, slopes(&closed.d_yw, &closed.d_zu)),
        }
    }

    /// `exp(A t)` and the integral of `exp(A s) B` over 0..t; `longer` holds the derivative of t by each parameter.
    fn hold(&self, t: f64, longer: &[f64]) -> Result<(Dual, Dual)> {
        let (n, m) = self.b.value.shape();
        // inputs far larger than the states change: the exponential is linear in them, and need not square for them
        let size = |column: f64| if column > 1.0 && column.is_finite() { column.log2().ceil().exp2() } else { 1.0 };
        let sizes: Vec<f64> = self.b.value.column_iter().map(|column| size(column.lp_norm(1) * t)).collect();
        let stacked = |a: &DMatrix<f64>, b: &DMatrix<f64>, t: f64| {
            let mut block = DMatrix::zeros(n + m, n + m);
            block.view_mut((0, 0), (n, n)).copy_from(&(a * t));
            block.view_mut((0, n), (n, m)).copy_from(&(b * t));
            sizes.iter().enumerate().for_each(|(j, size)| block.column_mut(n + j).unscale_mut(*size));
            block
        };
        let moved = (self.a.slopes.iter().zip(&self.b.slopes)).map(|(a, b)| stacked(a, b, t));
        let value = |t| stacked(&self.a.value, &self.b.value, t);
        let directions: Vec<_> = moved.zip(longer).map(|(moved, longer)| moved + value(*longer)).collect();
        let (value, slopes) = expm(&value(t), &directions)?;
        let whole = Dual { value, slopes };
        let a = whole.map(|e| e.view((0, 0), (n, n)).into_owned());
        let b = whole.map(|e| {
            let mut b = e.view((0, n), (n, m)).into_owned();
            sizes.iter().enumerate().for_each(|(j, size)| b.column_mut(j).scale_mut(*size));
            b
        });
        Ok((a, b))
    }
}

/// The loop with a digital controller, over one sample of the record.
///
/// States: plant, controller, and the commands under way (newest first). Within a controller sample the amplifier
/// sees the command of `whole + 1` samples ago for the fraction of the delay, then that of `whole` samples ago.
/// Inputs: excitations, further inputs of the plant, noise.
fn sampled(
    plant: &Plant,
    k: &Controller,
    dt: f64,
    free: &[usize],
    groups: &[Group],
) -> Result<(Discrete, Vec<Discrete>)> {
    let (np, m, q) = (free.len(), k.channels(), k.signals());
    if k.reads_commands(&plant.d.value) || plant.d.slopes.iter().any(|d| k.reads_commands(d)) {
        return Err(Error::Singular { what: "a signal that the controller reads follows a command at once" });
    }
    let step = dt / k.steps as f64;
    let (whole, fraction, in_two) = k.split_delay();
    let (nx, nu) = plant.b.value.shape();
    let (nk, ny) = (k.a.nrows(), plant.c.value.nrows());
    let queue = m * (whole + usize::from(in_two));
    let n = nx + nk + queue;
    let constant = |value| Dual::constant(value, np);
    let place = |rows: usize, columns: usize, at: (usize, usize), block: &DMatrix<f64>| {
        let mut out = DMatrix::zeros(rows, columns);
        out.view_mut(at, block.shape()).copy_from(block);
        out
    };

    // derivatives of the delay in seconds, and the law of the controller, by each parameter
    let later: Vec<f64> = free.iter().map(|p| f64::from(u8::from(k.late == Some(*p)))).collect();
    let slopes: Vec<_> = free.iter().map(|p| k.slope(*p)).collect();
    let law = |value: DMatrix<f64>, of: fn(&GainError) -> DMatrix<f64>| {
        let zero = DMatrix::zeros(value.nrows(), value.ncols());
        let slopes = slopes.iter().map(|s| s.as_ref().map_or_else(|| zero.clone(), of));
        Dual { slopes: slopes.collect(), value }
    };
    let k_c = law(k.c.clone(), |error| error.c.clone());
    let k_d = law(k.d.clone(), |error| error.d.clone());
    let k_e = law(k.excitation.clone(), |error| error.excitation.clone());

    // what is read, and the fresh command -C_k x_k - D_k read + e i_e, as rows over states and inputs
    let read_x = plant.c.map(|c| place(q, n, (0, 0), &(&k.reads * c)));
    let read_u = plant.d.map(|d| &k.reads * d).plus(&constant(k.takes.clone()));
    let fresh_x = k_d.times(&read_x).map(|y| -y).plus(&k_c.map(|c| place(m, n, (0, nx), &-c)));
    let fresh_u = k_d.times(&read_u).map(|y| -y).plus(&k_e.map(|e| place(m, nu, (0, 0), e)));
    // what acts on the plant: the command of `age` samples ago, and the further inputs
    let further = place(nu, nu, (m, m), &DMatrix::identity(nu - m, nu - m));
    let acting = |age: usize| -> (Dual, Dual) {
        let (x, u) = if age == 0 {
            (fresh_x.map(Clone::clone), fresh_u.map(Clone::clone))
        } else {
            let row = place(m, n, (0, nx + nk + m * (age - 1)), &DMatrix::identity(m, m));
            (constant(row), constant(DMatrix::zeros(m, nu)))
        };
        let among_all = |commands: Dual| commands.map(|c| c.clone().resize_vertically(nu, 0.0));
        (among_all(x), among_all(u).plus(&constant(further.clone())))
    };
    let late = acting(whole);

    // plant over one controller sample
    let earlier: Vec<f64> = later.iter().map(|s| -s).collect();
    let (a2, g2) = plant.hold(step * (1.0 - fraction), &earlier)?;
    let mut plant_x = a2.map(|a| place(nx, n, (0, 0), a)).plus(&g2.times(&late.0));
    let mut plant_u = g2.times(&late.1);
    let mut first = late;
    if in_two {
        let (a1, g1) = plant.hold(step * fraction, &later)?;
        first = acting(whole + 1);
        plant_x = a2.times(&a1).map(|a| place(nx, n, (0, 0), a)).plus(&g2.times(&acting(whole).0));
        let a2g1 = a2.times(&g1);
        plant_x = plant_x.plus(&a2g1.times(&first.0));
        plant_u = plant_u.plus(&a2g1.times(&first.1));
    }
    // controller and queue
    let control_x = read_x.map(|y| &k.b * y).plus(&constant(place(nk, n, (0, nx), &k.a)));
    let control_u = read_u.map(|y| &k.b * y);
    let stack = |parts: [&Dual; 3], columns: usize| -> Dual {
        let build = |pick: &dyn Fn(&Dual) -> DMatrix<f64>| {
            let mut out = DMatrix::zeros(n, columns);
            let mut at = 0;
            for part in parts {
                let block = pick(part);
                out.rows_mut(at, block.nrows()).copy_from(&block);
                at += block.nrows();
            }
            out
        };
        let slopes = (0..np).map(|j| build(&|d: &Dual| d.slopes[j].clone())).collect();
        Dual { value: build(&|d: &Dual| d.value.clone()), slopes }
    };
    let aged = place(queue, n, (m.min(queue), nx + nk), &DMatrix::identity(queue.saturating_sub(m), queue));
    let newest = |d: &Dual, columns| d.map(|v| place(queue, columns, (0, 0), &v.rows(0, m.min(queue)).into_owned()));
    let queue_x = newest(&fresh_x, n).plus(&constant(aged));
    let queue_u = newest(&fresh_u, nu);
    let step_a = stack([&plant_x, &control_x, &queue_x], n);
    let step_b = stack([&plant_u, &control_u, &queue_u], nu);

    // several controller samples to one of the record, the excitation held
    let (mut a, mut b) = (step_a.map(Clone::clone), step_b.map(Clone::clone));
    for bit in (0..k.steps.max(1).ilog2()).rev() {
        b = a.times(&b).plus(&b);
        a = a.times(&a);
        if k.steps >> bit & 1 == 1 {
            b = step_a.times(&b).plus(&step_b);
            a = step_a.times(&a);
        }
    }
    let mut c = plant.c.map(|c| place(ny, n, (0, 0), c)).plus(&plant.d.times(&first.0));
    let mut d = plant.d.times(&first.1);
    for Group { instant, outputs } in groups {
        // whole controller samples, then as far as the instant reaches into the one that follows
        let before = (instant.phase / step).floor().min(k.steps as f64 - 1.0);
        let rest = (instant.phase - before * step).max(0.0);
        let mut acts = acting(whole);
        let (mut x, mut u);
        // what is read when a command comes to act is read behind it, as without a delay
        if in_two && rest < step * fraction - SAME_INSTANT * dt {
            acts = acting(whole + 1);
            let (a, g) = plant.hold(rest, &instant.slopes)?;
            x = a.map(|a| place(nx, n, (0, 0), a)).plus(&g.times(&acts.0));
            u = g.times(&acts.1);
        } else if in_two {
            let (a1, g1) = plant.hold(step * fraction, &later)?;
            let since: Vec<f64> = instant.slopes.iter().zip(&later).map(|(instant, later)| instant - later).collect();
            let (a2, g2) = plant.hold((rest - step * fraction).max(0.0), &since)?;
            let (earlier, a2g1) = (acting(whole + 1), a2.times(&g1));
            x = a2.times(&a1).map(|a| place(nx, n, (0, 0), a)).plus(&a2g1.times(&earlier.0)).plus(&g2.times(&acts.0));
            u = a2g1.times(&earlier.1).plus(&g2.times(&acts.1));
        } else {
            let (a, g) = plant.hold(rest, &instant.slopes)?;
            x = a.map(|a| place(nx, n, (0, 0), a)).plus(&g.times(&acts.0));
            u = g.times(&acts.1);
        }
        (x, u) = (plant.c.times(&x).plus(&plant.d.times(&acts.0)), plant.c.times(&u).plus(&plant.d.times(&acts.1)));
        for _ in 0..before as usize {
            u = x.times(&step_b).plus(&u);
            x = x.times(&step_a);
        }
        c.replace(outputs, &x);
        d.replace(outputs, &u);
    }
    let shown = |part: &Dual| part.map(|m| m.rows(0, ny - k.hidden).into_owned());
    Ok(collect(&a, &b, &shown(&c), &shown(&d)))
}

fn collect(a: &Dual, b: &Dual, c: &Dual, d: &Dual) -> (Discrete, Vec<Discrete>) {
    let value = Discrete { a: a.value.clone(), b: b.value.clone(), c: c.value.clone(), d: d.value.clone() };
    let slopes = (0..a.slopes.len())
        .map(|j| Discrete {
            a: a.slopes[j].clone(),
            b: b.slopes[j].clone(),
            c: c.slopes[j].clone(),
            d: d.slopes[j].clone(),
        })
        .collect();
    (value, slopes)
}
