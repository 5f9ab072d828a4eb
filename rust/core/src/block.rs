//! What a nonlinear block of Delta computes: one number w from a few signals z, without memory.

mod curve;
mod element;
mod elementary;
mod force;
mod hysteresis;
mod stop;
mod table;

use std::sync::Arc;

use crate::error::{Error, Result, check_finite, check_len};

pub use curve::Curve;
pub(crate) use element::Element;
pub use table::Table;

/// A number of a law: one of the parameters, or a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coefficient {
    /// Index into the parameter vector.
    Parameter(usize),
    /// Its value.
    Constant(f64),
}

/// Most signals z of a block.
pub(crate) const SIGNALS: usize = 4;

/// What the block computes. Every law is zero where its strength is.
#[derive(Debug, Clone, PartialEq)]
pub enum Law {
    /// What the magnetic force adds to `K_i i + K_s s`; z = (i, s), current in A and displacement in m.
    ///
    /// Coefficients `K_i`, `K_s`, `nu`, and those of the curve: `sigma`, `n`. With `i0 = bias / nu` and
    /// `s0 = K_i i0 / K_s`, `f = K_i i0 / (2 (B^2)'(1)) (B^2(x+) - B^2(x-))`, `x+- = (1 +- i/i0) / (1 -+ s/s0)`: near
    /// rest f is `K_i i + K_s s`, for any curve and any `nu`. `nu` is 1 at the nominal bias and 0 for the linear law,
    /// where w vanishes as `nu^2`. A magnet does not push: x is zero beyond the bias. The gap closes to a fiftieth.
    /// With the root of a curve, f is K_i i0 / B'(1) times half the difference of the fluxes themselves, which Hall
    /// sensors read. A single magnet holds a constant load: `f = K_i i0 / (B^2)'(1) (B^2(x+) - B^2(1))`; its w vanishes as `nu`.
    /// Source: Schweitzer, Maslen (2009), "Magnetic Bearings", chapter 4.
    Force {
        /// Flux against magnetomotive force, both relative to rest.
        curve: Curve,
        /// Whether there is no opposite magnet; then the bias is the current that holds the load.
        single: bool,
        /// Bias current in A.
        bias: f64,
        /// Current in A that holds a constant load, such as the weight; i counts from it.
        held: f64,
        /// `sigma` of this magnet over the one of the parameter, which may be stated for another bias; above zero.
        level: f64,
    },
    /// What a limit R takes away from a signal z, such as a rate or a command.
    ///
    /// Coefficients `inverse_limit` = 1/R, and `noise`, the standard deviation of a Gaussian noise beside z, above zero:
    /// w is the mean of what the limit takes away, whose corners that noise rounds.
    Limit,
    /// Rate of a hysteresis state by its input u, vectors of one or two coordinates of which the first is w:
    /// z = (u1', h1, u2', h2), `w = A u1' - (beta |v| + gamma v) |h|^(n-1) h1` with `v = u' h / |h|`.
    ///
    /// Coefficients `A`, `beta`, `gamma`, `inverse_n` = 1/n in 0..1: with `beta + gamma = A` the state ends at one, in
    /// an exponential for n = 1, and like a slider on a spring for n without limit. `|v|` is `sqrt(v^2 + e^2) - e`, and
    /// `|h|` is `sqrt(h^2 + e^2)`; beyond one the power goes on as a straight line. The state itself belongs to G.
    /// Source: Wen (1976), "Method for random vibration of hysteretic systems"; Park, Wen, Ang (1986), "Random
    /// vibration of hysteretic systems under bi-directional ground motions".
    BoucWen {
        /// One or two.
        coordinates: usize,
        /// e of the rate, in its unit.
        rate_smoothing: f64,
        /// e of the state.
        state_smoothing: f64,
    },
    /// What a stop does, over its stiffness, to a body of one or two coordinates of which the first is w:
    /// z = (x1, x1', x2, x2'), `w = -(r - c)+ (1 + a r') x1 / r` with `r = |x|`.
    ///
    /// Coefficients `clearance` = c, `damping` = a.
    /// Source: Hunt, Crossley (1975), "Coefficient of restitution interpreted as damping in vibroimpact".
    Stop {
        /// One or two.
        coordinates: usize,
        /// Half width of the bend between free and in touch, in m.
        smoothing: f64,
    },
    /// `w = g F(z)` with a tabulated function of one or two signals; coefficient `g`.
    Table(Arc<Table>),
    /// `w = sum_k c_k z1^a_k z2^b_k`; coefficients `c0`, `c1`, ...
    Polynomial {
        /// Number of signals, 1 or 2.
        inputs: usize,
        /// `[a_k, b_k]`.
        exponents: Vec<[u32; 2]>,
    },
}

/// A nonlinear block of Delta: a law and its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    law: Law,
    coefficients: Vec<Coefficient>,
}

impl Law {
    /// Number of signals z.
    pub fn inputs(&self) -> usize {
        match self {
            Self::Force { .. } => 2,
            Self::BoucWen { coordinates, .. } | Self::Stop { coordinates, .. } => 2 * coordinates,
            Self::Limit => 1,
            Self::Table(table) => table.inputs(),
            Self::Polynomial { inputs, .. } => *inputs,
        }
    }

    /// Names of the coefficients, in order.
    pub fn coefficients(&self) -> Vec<String> {
        let names: &[&str] = match self {
            Self::Force { curve: Curve::Unsaturated | Curve::RootUnsaturated, .. } => &["K_i", "K_s", "nu"],
            Self::Force { curve: Curve::Tanh, .. } => &["K_i", "K_s", "nu", "sigma"],
            Self::Force { curve: Curve::Power | Curve::RootPower, .. } => &["K_i", "K_s", "nu", "sigma", "n"],
            Self::Limit => &["inverse_limit", "noise"],
            Self::BoucWen { .. } => &["A", "beta", "gamma", "inverse_n"],
            Self::Stop { .. } => &["clearance", "damping"],
            Self::Table(_) => &["g"],
            Self::Polynomial { exponents, .. } => return (0..exponents.len()).map(|k| format!("c{k}")).collect(),
        };
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    fn check(&self) -> Result<()> {
        let allowed = match self {
            Self::Force { bias, held, level, .. } => {
                *bias > 0.0 && bias.is_finite() && held.abs() < *bias && *level > 0.0 && level.is_finite()
            }
            Self::BoucWen { coordinates, rate_smoothing, state_smoothing } => {
                (1..=2).contains(coordinates)
                    && [rate_smoothing, state_smoothing].iter().all(|e| **e > 0.0 && e.is_finite())
            }
            Self::Stop { coordinates, smoothing } => {
                (1..=2).contains(coordinates) && *smoothing > 0.0 && smoothing.is_finite()
            }
            Self::Table(_) | Self::Limit => true,
            Self::Polynomial { inputs, exponents } => {
                *inputs == 2 || (*inputs == 1 && exponents.iter().all(|[_, b]| *b == 0))
            }
        };
        let what = match self {
            Self::Force { .. } => {
                "a force law needs a finite bias and level above zero, and a holding current below the bias"
            }
            Self::BoucWen { .. } | Self::Stop { .. } => {
                "a hysteresis or a stop has one or two coordinates, and finite smoothings above zero"
            }
            _ => "a polynomial has one or two inputs, and no exponent of an input that it lacks",
        };
        if allowed { Ok(()) } else { Err(Error::Block { what }) }
    }
}

impl Block {
    /// `coefficients` in the order of [`Law::coefficients`].
    ///
    /// # Errors
    /// [`Error::Shape`] for a wrong number of coefficients, [`Error::NotFinite`], [`Error::Block`].
    pub fn new(law: Law, coefficients: Vec<Coefficient>) -> Result<Self> {
        law.check()?;
        check_len("coefficients of a block", coefficients.len(), law.coefficients().len())?;
        for coefficient in &coefficients {
            if let Coefficient::Constant(value) = coefficient {
                check_finite("constants of a block", &[*value])?;
            }
        }
        Ok(Self { law, coefficients })
    }

    /// Number of signals z; there is always one w.
    pub fn inputs(&self) -> usize {
        self.law.inputs()
    }

    /// Number of coefficients.
    pub fn coefficients(&self) -> usize {
        self.coefficients.len()
    }

    /// What it was made of.
    pub(crate) fn content(&self) -> (&Law, &[Coefficient]) {
        (&self.law, &self.coefficients)
    }

    /// The parameters that the block depends on: place among its coefficients, index into the parameter vector.
    pub fn parameters(&self) -> impl Iterator<Item = (usize, usize)> {
        self.coefficients.iter().enumerate().filter_map(|(place, c)| match c {
            Coefficient::Parameter(index) => Some((place, *index)),
            Coefficient::Constant(_) => None,
        })
    }

    /// The block at one parameter set.
    ///
    /// # Errors
    /// [`Error::Singular`] where its constants are not finite there.
    pub(crate) fn at(&self, theta: &[f64]) -> Result<Element> {
        let value = |c: &Coefficient| match c {
            Coefficient::Parameter(index) => theta[*index],
            Coefficient::Constant(value) => *value,
        };
        let values: Vec<f64> = self.coefficients.iter().map(value).collect();
        Element::new(&self.law, values)
    }
}
