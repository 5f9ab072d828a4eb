//! Nonlinear blocks of Delta, given as dictionaries.

use std::collections::BTreeMap;
use std::sync::Arc;

use ambid_core::{Block, Coefficient, Curve, Law, Table};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::{ModelError, raise};

/// A law, which of its coefficients are parameters, and its constants.
#[derive(FromPyObject)]
pub struct NonlinearBlock<'py> {
    #[pyo3(item)]
    law: String,
    #[pyo3(item, default)]
    curve: Option<String>,
    #[pyo3(item, default)]
    single: bool,
    #[pyo3(item, default)]
    parameters: BTreeMap<String, Option<usize>>,
    #[pyo3(item, default)]
    constants: BTreeMap<String, f64>,
    #[pyo3(item, default)]
    values: Option<PyReadonlyArrayDyn<'py, f64>>,
    #[pyo3(item, default)]
    first: Vec<f64>,
    #[pyo3(item, default)]
    spacing: Vec<f64>,
    #[pyo3(item, default)]
    exponents: Vec<Vec<u32>>,
}

impl NonlinearBlock<'_> {
    pub fn compile(&self) -> PyResult<Block> {
        let (law, own) = self.law()?;
        let names = law.coefficients();
        if let Some(unknown) = self.parameters.keys().find(|key| !names.contains(key)) {
            return Err(self.error(&format!("has no parameter {unknown:?}; it has {}", names.join(", "))));
        }
        let known = |key: &&String| names.contains(key) || own.contains(&key.as_str());
        if let Some(unknown) = self.constants.keys().find(|key| !known(key)) {
            let all: Vec<&str> = own.iter().copied().chain(names.iter().map(String::as_str)).collect();
            return Err(self.error(&format!("has no constant {unknown:?}; it has {}", all.join(", "))));
        }
        let coefficient = |name: &String| match self.parameters.get(name) {
            Some(Some(index)) => Ok(Coefficient::Parameter(*index)),
            _ => self.constant(name).map(Coefficient::Constant),
        };
        let coefficients = names.iter().map(coefficient).collect::<PyResult<_>>()?;
        Block::new(law, coefficients).map_err(raise)
    }

    /// The law, and the names of its own constants.
    fn law(&self) -> PyResult<(Law, &'static [&'static str])> {
        Ok(match self.law.as_str() {
            "force_law" => {
                let or = |name: &str, usual: f64| self.constants.get(name).copied().unwrap_or(usual);
                let (bias, held, level) = (self.constant("bias")?, or("held", 0.0), or("level", 1.0));
                (
                    Law::Force { curve: self.curve()?, single: self.single, bias, held, level },
                    &["bias", "held", "level"],
                )
            }
            "limit" => (Law::Limit, &[]),
            "bouc_wen" => {
                let [rate_smoothing, state_smoothing] =
                    [self.constant("rate_smoothing")?, self.constant("state_smoothing")?];
                (
                    Law::BoucWen { coordinates: self.coordinates()?, rate_smoothing, state_smoothing },
                    &["coordinates", "rate_smoothing", "state_smoothing"],
                )
            }
            "stop" => {
                let smoothing = self.constant("smoothing")?;
                (Law::Stop { coordinates: self.coordinates()?, smoothing }, &["coordinates", "smoothing"])
            }
            "table" => (Law::Table(Arc::new(self.table()?)), &[]),
            "polynomial" => (self.polynomial()?, &[]),
            _ => {
                let known = "force_law, limit, bouc_wen, stop, table, polynomial";
                return Err(self.error(&format!("is not known; there are {known}")));
            }
        })
    }

    fn curve(&self) -> PyResult<Curve> {
        match self.curve.as_deref() {
            Some("unsaturated") => Ok(Curve::Unsaturated),
            Some("power") => Ok(Curve::Power),
            Some("tanh") => Ok(Curve::Tanh),
            Some("root_unsaturated") => Ok(Curve::RootUnsaturated),
            Some("root_power") => Ok(Curve::RootPower),
            found => Err(self.error(&format!(
                "has the curve {found:?}; allowed are unsaturated, power, tanh, root_unsaturated, root_power"
            ))),
        }
    }

    fn table(&self) -> PyResult<Table> {
        let values = self.values.as_ref().ok_or_else(|| self.error("needs an array 'values'"))?;
        let shape = values.shape();
        if self.first.len() != shape.len() || self.spacing.len() != shape.len() {
            let found = format!("{} and {}", self.first.len(), self.spacing.len());
            return Err(self.error(&format!(
                "needs 'first' and 'spacing' of length {}, one per axis of 'values'; found {found}",
                shape.len()
            )));
        }
        let grid: Vec<_> = (0..shape.len()).map(|i| (self.first[i], self.spacing[i], shape[i])).collect();
        let values = values.as_slice().map_err(|_| self.error("needs 'values' that are C-contiguous"))?;
        Table::new(&grid, values).map_err(raise)
    }

    fn polynomial(&self) -> PyResult<Law> {
        let wrong = || self.error("needs 'exponents', a row per term, all rows of length 1 or all of length 2");
        let inputs = self.exponents.first().ok_or_else(wrong)?.len();
        let terms = self.exponents.iter().map(|term| match term[..] {
            [a] if inputs == 1 => Ok([a, 0]),
            [a, b] if inputs == 2 => Ok([a, b]),
            _ => Err(wrong()),
        });
        Ok(Law::Polynomial { inputs, exponents: terms.collect::<PyResult<_>>()? })
    }

    fn coordinates(&self) -> PyResult<usize> {
        let found = self.constant("coordinates")?;
        let whole = [1_u8, 2].into_iter().find(|count| f64::from(*count) == found);
        whole.map(usize::from).ok_or_else(|| self.error(&format!("has {found} coordinates; allowed are 1 and 2")))
    }

    fn constant(&self, name: &str) -> PyResult<f64> {
        let missing = || self.error(&format!("needs {name:?} among its parameters or constants"));
        self.constants.get(name).copied().ok_or_else(missing)
    }

    fn error(&self, what: &str) -> PyErr {
        ModelError::new_err(format!("the law {:?} of a nonlinear block {what}", self.law))
    }
}
