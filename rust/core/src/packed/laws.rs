//! Nonlinear blocks as bytes.
//!
//! ```text
//! 0 force law     curve (0 unsaturated, 1 power, 2 tanh), single (flag), bias, held, level
//! 1 limit
//! 2 Bouc-Wen      smoothing of the rate, of the state
//! 3 table         list of axes (first, spacing, nodes), list of values, a row per node of the first axis
//! 4 polynomial    number of signals, list of pairs of exponents
//!
//! coefficient: 0, index of its parameter (count); or 1, its value
//! ```

use std::sync::Arc;

use crate::block::{Block, Coefficient, Curve, Law, Table};
use crate::error::Result;
use crate::packed::part::{Part, Source};

impl Part for Block {
    fn put(&self, out: &mut Vec<u8>) {
        let (law, coefficients) = self.content();
        law.put(out);
        coefficients.to_vec().put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        Self::new(source.take()?, source.take()?)
    }
}

impl Part for Coefficient {
    fn put(&self, out: &mut Vec<u8>) {
        match self {
            Self::Parameter(index) => (false, *index).put(out),
            Self::Constant(value) => (true, *value).put(out),
        }
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok(if source.take()? { Self::Constant(source.take()?) } else { Self::Parameter(source.take()?) })
    }
}

impl Part for Law {
    fn put(&self, out: &mut Vec<u8>) {
        match self {
            Self::Force { curve, single, bias, held, level } => {
                (0_u8, *curve).put(out);
                single.put(out);
                [bias, held, level].into_iter().for_each(|value| value.put(out));
            }
            Self::Limit => 1_u8.put(out),
            Self::BoucWen { coordinates, rate_smoothing, state_smoothing } => {
                (2_u8, *coordinates).put(out);
                (*rate_smoothing, *state_smoothing).put(out);
            }
            Self::Table(table) => (3_u8, (table.grid(), table.values())).put(out),
            Self::Polynomial { inputs, exponents } => {
                let exponents: Vec<_> = exponents.iter().map(|[a, b]| (*a, *b)).collect();
                (4_u8, (*inputs, exponents)).put(out);
            }
            Self::Stop { coordinates, smoothing } => (5_u8, (*coordinates, *smoothing)).put(out),
        }
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok(match source.take::<u8>()? {
            0 => Self::Force {
                curve: source.take()?,
                single: source.take()?,
                bias: source.take()?,
                held: source.take()?,
                level: source.take()?,
            },
            1 => Self::Limit,
            2 => Self::BoucWen {
                coordinates: source.take()?,
                rate_smoothing: source.take()?,
                state_smoothing: source.take()?,
            },
            3 => {
                let axes: Vec<(f64, (f64, usize))> = source.take()?;
                let grid: Vec<_> = axes.into_iter().map(|(first, (spacing, nodes))| (first, spacing, nodes)).collect();
                Self::Table(Arc::new(Table::new(&grid, &source.take::<Vec<f64>>()?)?))
            }
            4 => {
                let (inputs, exponents): (usize, Vec<(u32, u32)>) = source.take()?;
                Self::Polynomial { inputs, exponents: exponents.into_iter().map(|(a, b)| [a, b]).collect() }
            }
            5 => Self::Stop { coordinates: source.take()?, smoothing: source.take()? },
            _ => return Err(source.error("a law is not known to this version")),
        })
    }
}

impl Part for Curve {
    fn put(&self, out: &mut Vec<u8>) {
        let number: u8 = match self {
            Self::Unsaturated => 0,
            Self::Power => 1,
            Self::Tanh => 2,
            Self::RootUnsaturated => 3,
            Self::RootPower => 4,
        };
        number.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        match source.take::<u8>()? {
            0 => Ok(Self::Unsaturated),
            1 => Ok(Self::Power),
            2 => Ok(Self::Tanh),
            3 => Ok(Self::RootUnsaturated),
            4 => Ok(Self::RootPower),
            _ => Err(source.error("a curve is not known to this version")),
        }
    }
}

impl<A: Part, B: Part> Part for (A, B) {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
        self.1.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok((source.take()?, source.take()?))
    }
}
