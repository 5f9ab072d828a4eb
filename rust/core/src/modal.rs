//! Poles and residues of the sampled loop, with their exact derivatives by the parameters.
//!
//! With `A V = V diag(lambda)`, `W = V^-1` and `T = W dA V`, to first order
//! `d lambda_i = T_ii`, `dV = V Q`, `dW = -Q W`, `Q_mi = T_mi / (lambda_i - lambda_m)`, `Q_ii = 0`.
//! A change of Delta gives `T = (W B_w) dDelta (C_z V)`, an outer product.

use nalgebra::{Complex, DMatrix};

use crate::discretise::{Discrete, discretise};
use crate::eigen::{eigenvalues, eigenvectors};
use crate::error::Result;
use crate::lft::{Closed, balancing};
use crate::model::{Controller, Model};
use crate::reading::{Group, groups};

type C64 = Complex<f64>;

/// `y[k] = sum_i c_i p_i[k] + d u[k]`, `p_i[k+1] = mu_i p_i[k] + b_i u[k]`; also a derivative of these numbers.
#[derive(Debug, Clone)]
pub struct Residues {
    pub mu: Vec<C64>,
    /// modes x inputs.
    pub b: DMatrix<C64>,
    /// outputs x modes.
    pub c: DMatrix<C64>,
    pub d: DMatrix<f64>,
}

/// A loop in modal form. Complex poles come as conjugate pairs.
#[derive(Debug, Clone)]
pub struct Modal {
    pub value: Residues,
    /// One per free parameter.
    pub slopes: Vec<Residues>,
}

/// Condition of the eigenvectors up to which ten digits of the response remain.
const MAX_CONDITION: f64 = 1e5;
/// What may be left of the equation of the eigenvectors, relative to the largest pole, for nine digits of the response.
const MAX_LEFT_OVER: f64 = 1e-12;
/// Condition per pole, divided by the smallest gap between poles, up to which nine digits of the derivatives remain.
///
/// Measured on clustered loops of 2 to 24 poles: the loss is up to 2.5e-15 times this ratio.
const MAX_LOSS_ANALOG: f64 = 3e5;
/// The same of a sampled loop, where it is up to 8e-14 times the ratio: commands under way are all but nilpotent.
const MAX_LOSS_SAMPLED: f64 = 1e4;

impl Modal {
    /// The modal form, or `None` where poles are so clustered or defective that it would lose digits.
    ///
    /// Of `values_only`, neither derivatives nor transients, clustered poles lose none, as long as the vectors hold.
    ///
    /// # Errors
    /// As [`crate::lft::Lft::close`] and [`discretise`].
    pub fn new(model: &Model, theta: &[f64], free: &[usize], values_only: bool) -> Result<Option<Self>> {
        if model.controller.is_none() {
            let mut closed = model.lft.close_at_rest(theta)?;
            closed.balance();
            let late = groups(model, theta, free)?;
            return Ok(Self::analog(model, &closed, theta, free, values_only, &late));
        }
        let (mut value, mut slopes) = discretise(model, theta, free)?;
        let t = balancing(&value.a);
        slopes.iter_mut().chain([&mut value]).for_each(|part| part.rescale(&t));
        Ok(Self::sampled(&value, &slopes, values_only))
    }

    fn analog(
        model: &Model,
        closed: &Closed,
        theta: &[f64],
        free: &[usize],
        values_only: bool,
        late: &[Group],
    ) -> Option<Self> {
        let basis = Eigen::new(&closed.a, 0.0, (!values_only).then_some(MAX_LOSS_ANALOG))?;
        let (dt, gains) = (model.dt, &model.lft.gains);
        let b = basis.left_times(&closed.b_u);
        let c = basis.times_right(&closed.c_y);
        let beta = basis.left_times(&closed.b_w);
        let gamma = basis.times_right(&closed.c_z);
        let n = basis.lambda.len();
        let hold: Vec<Hold> = basis.lambda.iter().map(|l| Hold::new(*l, dt)).collect();
        let held = |b: &DMatrix<C64>| DMatrix::from_fn(n, b.ncols(), |i, a| hold[i].phi * b[(i, a)]);

        let at_phase: Vec<Vec<Hold>> =
            late.iter().map(|g| basis.lambda.iter().map(|l| Hold::new(*l, g.instant.phase)).collect()).collect();
        let phases = || late.iter().zip(&at_phase);

        let slopes = free.iter().enumerate().map(|(j, parameter)| {
            let mut t = DMatrix::<C64>::zeros(n, n);
            let mut db = DMatrix::<C64>::zeros(n, b.ncols());
            let mut dc = DMatrix::<C64>::zeros(c.nrows(), n);
            let mut dd = DMatrix::<f64>::zeros(c.nrows(), b.ncols());
            for (k, gain) in gains.iter().enumerate().filter(|(_, g)| g.parameter == *parameter) {
                let slope = gain.slope(theta);
                let scaled = C64::from(slope);
                let one = C64::from(1.0);
                t.ger(scaled, &beta.column(k), &gamma.row(k).transpose(), one);
                db.ger(scaled, &beta.column(k), &closed.d_zu.row(k).transpose().map(C64::from), one);
                dc.ger(scaled, &closed.d_yw.column(k).map(C64::from), &gamma.row(k).transpose(), one);
                dd.ger(slope, &closed.d_yw.column(k), &closed.d_zu.row(k).transpose(), 1.0);
            }
            let turn = basis.turn(&t);
            dc += &c * &turn;
            db -= &turn * &b;
            let rate = |i: usize| t[(i, i)];
            for (Group { instant, outputs }, at) in phases() {
                let later = instant.slopes[j];
                for (o, i) in outputs.iter().flat_map(|o| (0..n).map(move |i| (*o, i))) {
                    let Hold { mu, phi, phi_slope } = at[i];
                    let (own, moved) = (c[(o, i)], dc[(o, i)]);
                    for a in 0..b.ncols() {
                        let by_phi = (moved * phi + own * (phi_slope * rate(i) + mu * later)) * b[(i, a)];
                        dd[(o, a)] += (by_phi + own * phi * db[(i, a)]).re;
                    }
                    dc[(o, i)] = mu * (moved + own * (rate(i) * instant.phase + basis.lambda[i] * later));
                }
            }
            let mu = (0..n).map(|i| hold[i].mu * rate(i) * dt).collect();
            let db = DMatrix::from_fn(n, b.ncols(), |i, a| {
                hold[i].phi * db[(i, a)] + hold[i].phi_slope * rate(i) * b[(i, a)]
            });
            Residues { mu, b: db, c: dc, d: dd }
        });
        let slopes = slopes.collect();
        let mu = hold.iter().map(|h| h.mu).collect();
        let (mut at_instants, mut d) = (c.clone(), closed.d_yu.clone());
        for (Group { outputs, .. }, at) in phases() {
            for (o, i) in outputs.iter().flat_map(|o| (0..n).map(move |i| (*o, i))) {
                (0..b.ncols()).for_each(|a| d[(o, a)] += (c[(o, i)] * at[i].phi * b[(i, a)]).re);
                at_instants[(o, i)] *= at[i].mu;
            }
        }
        let value = Residues { mu, b: held(&b), c: at_instants, d };
        Some(Self { value, slopes })
    }

    fn sampled(value: &Discrete, slopes: &[Discrete], values_only: bool) -> Option<Self> {
        let basis = Eigen::new(&value.a, 1.0, (!values_only).then_some(MAX_LOSS_SAMPLED))?;
        let b = basis.left_times(&value.b);
        let c = basis.times_right(&value.c);
        let slopes = slopes.iter().map(|s| {
            let t = basis.left_times(&s.a) * &basis.v;
            let turn = basis.turn(&t);
            Residues {
                mu: t.diagonal().iter().copied().collect(),
                b: basis.left_times(&s.b) - &turn * &b,
                c: basis.times_right(&s.c) + &c * &turn,
                d: s.d.clone(),
            }
        });
        let slopes = slopes.collect();
        Some(Self { value: Residues { mu: basis.lambda, b, c, d: value.d.clone() }, slopes })
    }
}

/// Zero-order hold of one pole: `mu = exp(lambda dt)`, `phi = (mu - 1) / lambda`, and d phi / d lambda.
struct Hold {
    mu: C64,
    phi: C64,
    phi_slope: C64,
}

impl Hold {
    fn new(lambda: C64, dt: f64) -> Self {
        let z = lambda * dt;
        let mu = z.exp();
        if z.norm() > 0.5 {
            let phi = (mu - 1.0) / lambda;
            return Self { mu, phi, phi_slope: (mu * dt - phi) / lambda };
        }
        // series: (e^z - 1)/z = sum z^k/(k+1)!, its derivative sum (k+1) z^k/(k+2)!
        let (mut phi, mut slope) = (C64::from(0.0), C64::from(0.0));
        let mut term = C64::from(1.0); // z^k / (k+1)!
        for k in 0..18 {
            let k = f64::from(k);
            phi += term;
            slope += term * ((k + 1.0) / (k + 2.0));
            term = term * z / (k + 2.0);
        }
        Self { mu, phi: phi * dt, phi_slope: slope * dt * dt }
    }
}

/// Eigenvectors of a loop that can be relied upon.
struct Eigen {
    lambda: Vec<C64>,
    v: DMatrix<C64>,
    w: DMatrix<C64>,
}

impl Eigen {
    /// `rest` is the pole of a state that stays as it is: 0 of a continuous, 1 of a sampled loop. For derivatives,
    /// which have a `max_loss`, poles need to lie apart; without them it is enough that the vectors are what they are.
    fn new(a: &DMatrix<f64>, rest: f64, max_loss: Option<f64>) -> Option<Self> {
        let n = a.nrows();
        let (lambda, mut v) = eigenvectors(a)?;
        for mut column in v.column_iter_mut() {
            let norm = column.norm();
            column.unscale_mut(norm);
        }
        if !v.iter().all(|x| x.re.is_finite() && x.im.is_finite()) {
            return None;
        }
        let w = v.clone().try_inverse()?;
        let condition = v.norm() * w.norm();
        let holds = || match max_loss {
            Some(max_loss) => condition < max_loss * n as f64 * gap(&lambda, rest),
            None => left_over(a, &lambda, &v, &w) < MAX_LEFT_OVER,
        };
        let reliable = condition < MAX_CONDITION && holds();
        reliable.then_some(Self { lambda, v, w })
    }

    fn left_times(&self, m: &DMatrix<f64>) -> DMatrix<C64> {
        complex_real(&self.w, m)
    }

    fn times_right(&self, m: &DMatrix<f64>) -> DMatrix<C64> {
        complex_real(&self.v.transpose(), &m.transpose()).transpose()
    }

    /// Q of the module's heading from T.
    fn turn(&self, t: &DMatrix<C64>) -> DMatrix<C64> {
        DMatrix::from_fn(t.nrows(), t.ncols(), |m, i| {
            if m == i { C64::from(0.0) } else { t[(m, i)] / (self.lambda[i] - self.lambda[m]) }
        })
    }
}

/// Largest number of `W (A V - V diag(lambda))`, relative to the largest pole.
fn left_over(a: &DMatrix<f64>, lambda: &[C64], v: &DMatrix<C64>, w: &DMatrix<C64>) -> f64 {
    let mut left = complex_real(&v.transpose(), &a.transpose()).transpose();
    for (j, pole) in lambda.iter().enumerate() {
        left.column_mut(j).axpy(-pole, &v.column(j), C64::from(1.0));
    }
    let size = lambda.iter().map(|pole| pole.norm()).fold(f64::MIN_POSITIVE, f64::max);
    (w * left).iter().map(|x| x.norm()).fold(0.0, f64::max) / size
}

fn complex_real(z: &DMatrix<C64>, m: &DMatrix<f64>) -> DMatrix<C64> {
    let (re, im) = (z.map(|x| x.re) * m, z.map(|x| x.im) * m);
    re.zip_map(&im, C64::new)
}

/// Smallest distance of two poles relative to their distance from the pole at rest.
fn gap(lambda: &[C64], rest: f64) -> f64 {
    let between = |x: &C64, y: &C64| {
        let size = (x - rest).norm().max((y - rest).norm());
        if size > 0.0 { (x - y).norm() / size } else { 0.0 }
    };
    let pairs = lambda.iter().enumerate().flat_map(|(i, x)| lambda[..i].iter().map(move |y| between(x, y)));
    pairs.fold(f64::INFINITY, f64::min)
}

/// Poles of a loop in 1/s; those of a digital loop are `ln(mu)/dt` of the poles of the sampled loop.
///
/// # Errors
/// As [`crate::lft::Lft::close`] and [`discretise`].
pub fn poles(model: &Model, theta: &[f64]) -> Result<Vec<C64>> {
    if !model.controller.as_ref().is_some_and(Controller::feeds_back) {
        return eigenvalues(&model.lft.close_at_rest(theta)?.a);
    }
    let (sampled, _) = discretise(model, theta, &[])?;
    Ok(eigenvalues(&sampled.a)?.into_iter().map(|mu| mu.ln() / model.dt).collect())
}
