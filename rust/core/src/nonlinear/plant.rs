//! The plant of a nonlinear loop at one parameter set: gains closed, the ports of the blocks open.

use nalgebra::DMatrix;

use crate::block::Element;
use crate::error::{Error, Result};
use crate::model::Model;

/// `x' = A x + B [u; w; g]`, `[y; z] = C x + D [u; w; g]`: w and z of the blocks, g at the ports of free gains.
#[derive(Debug, Clone)]
pub struct Plant {
    pub a: DMatrix<f64>,
    /// How much smaller the states are than those of the model.
    pub sizes: Vec<f64>,
    pub b: DMatrix<f64>,
    pub c_y: DMatrix<f64>,
    pub c_z: DMatrix<f64>,
    /// What the free gains read.
    pub c_g: DMatrix<f64>,
    pub d_y: DMatrix<f64>,
    pub d_z: DMatrix<f64>,
    pub d_g: DMatrix<f64>,
    pub inputs: usize,
    /// How many of them a digital controller drives, the first.
    pub driven: usize,
    /// In an order in which every block reads only w of those before.
    pub blocks: Vec<Placed>,
    pub gains: Vec<FreeGain>,
    /// Row of the derivative by the delay of the commands, where that is free.
    pub late: Option<usize>,
    /// The value, and one derivative per free parameter.
    pub rows: usize,
}

/// A block and where its signals stand.
#[derive(Debug, Clone)]
pub struct Placed {
    pub element: Element,
    /// Its w.
    pub place: usize,
    /// Its first z, and how many.
    pub first: usize,
    pub inputs: usize,
    /// Coefficients that are free parameters: row, place among the coefficients.
    pub free: Vec<(usize, usize)>,
    pub coefficients: usize,
    /// Signals z that follow its w at once, and how much.
    pub feeds: Vec<(usize, f64)>,
}

/// A gain of Delta whose parameter is free: in its row it adds `slope z` to w.
#[derive(Debug, Clone, Copy)]
pub struct FreeGain {
    pub row: usize,
    pub slope: f64,
}

impl Plant {
    /// # Errors
    /// [`Error::Singular`] where the blocks make an algebraic loop, and as [`crate::Lft::close`].
    pub fn new(model: &Model, theta: &[f64], free: &[usize]) -> Result<Self> {
        let lft = &model.lft;
        let mut closed = lft.close(theta)?;
        let sizes = closed.balance();
        let (nu, ny, nq) = (lft.inputs(), lft.outputs(), lft.signals());
        let row = |parameter: usize| free.iter().position(|f| *f == parameter).map(|j| 1 + j);
        let (ports, gains): (Vec<usize>, Vec<FreeGain>) = lft
            .gains
            .iter()
            .enumerate()
            .filter_map(|(k, g)| row(g.parameter).map(|row| (k, FreeGain { row, slope: g.slope(theta) })))
            .unzip();
        let beside = |left: DMatrix<f64>, right: &DMatrix<f64>| {
            let at = left.ncols();
            let mut out = left.resize_horizontally(at + ports.len(), 0.0);
            ports.iter().enumerate().for_each(|(j, k)| out.set_column(at + j, &right.column(*k)));
            out
        };
        let d = beside(closed.d_yu, &closed.d_yw);
        let d_z = d.rows(ny, nq).into_owned();
        let blocks = place(model, theta, &row, &d_z)?;
        let plant = Self {
            b: beside(closed.b_u, &closed.b_w),
            c_y: closed.c_y.rows(0, ny).into_owned(),
            c_z: closed.c_y.rows(ny, nq).into_owned(),
            c_g: closed.c_z.select_rows(&ports),
            d_y: d.rows(0, ny).into_owned(),
            d_z,
            d_g: closed.d_zu.select_rows(&ports),
            a: closed.a,
            sizes,
            inputs: nu,
            driven: model.commands(),
            blocks,
            gains,
            late: model.controller.as_ref().and_then(|k| k.late).and_then(row),
            rows: 1 + free.len(),
        };
        if model.controller.as_ref().is_some_and(|k| plant.read_follows_command(&k.reads)) {
            let what = "what a controller reads follows a command at once, through a nonlinear block or a free gain";
            return Err(Error::Singular { what });
        }
        Ok(plant)
    }

    /// First column and number of the inputs that a digital controller drives.
    pub fn commands(&self) -> (usize, usize) {
        (0, self.driven)
    }

    /// First column and number of the other inputs.
    pub fn further(&self) -> (usize, usize) {
        (self.driven, self.inputs - self.driven)
    }

    /// First column and number of w of the blocks.
    pub fn block_ports(&self) -> (usize, usize) {
        (self.inputs, self.blocks.len())
    }

    /// First column and number of the ports of free gains.
    pub fn gain_ports(&self) -> (usize, usize) {
        (self.inputs + self.blocks.len(), self.gains.len())
    }

    /// Whether a signal that a digital controller reads follows a command at once, through a block or a free gain.
    fn read_follows_command(&self, reads: &DMatrix<f64>) -> bool {
        let commanded = |d: &DMatrix<f64>| -> Vec<bool> {
            d.columns(0, self.driven).row_iter().map(|r| r.iter().any(|d| *d != 0.0)).collect()
        };
        let read = |column: usize| (reads * self.d_y.column(column)).iter().any(|d| *d != 0.0);
        let through_gain = |(k, moved): (usize, bool)| moved && read(self.gain_ports().0 + k);
        let mut moved = commanded(&self.d_z);
        let mut through_block = |block: &Placed| {
            let moves = (block.first..block.first + block.inputs).any(|z| moved[z]);
            block.feeds.iter().for_each(|(z, _)| moved[*z] |= moves);
            moves && read(self.inputs + block.place)
        };
        commanded(&self.d_g).into_iter().enumerate().any(through_gain) || self.blocks.iter().any(&mut through_block)
    }
}

/// The blocks, each after those whose w it reads at once.
fn place(
    model: &Model,
    theta: &[f64],
    row: &impl Fn(usize) -> Option<usize>,
    d_z: &DMatrix<f64>,
) -> Result<Vec<Placed>> {
    let nu = model.lft.inputs();
    let mut waiting = Vec::new();
    let mut first = 0;
    for (place, block) in model.lft.blocks.iter().enumerate() {
        let column = d_z.column(nu + place);
        waiting.push(Placed {
            element: block.at(theta)?,
            place,
            first,
            inputs: block.inputs(),
            free: block.parameters().filter_map(|(place, parameter)| row(parameter).map(|r| (r, place))).collect(),
            coefficients: block.coefficients(),
            feeds: column.iter().copied().enumerate().filter(|(_, d)| *d != 0.0).collect(),
        });
        first += block.inputs();
    }
    let mut placed = Vec::new();
    while !waiting.is_empty() {
        let fed = |b: &Placed| {
            (b.first..b.first + b.inputs).any(|z| waiting.iter().any(|w| w.feeds.iter().any(|f| f.0 == z)))
        };
        let ready = waiting.iter().position(|b| !fed(b));
        let ready = ready.ok_or(Error::Singular { what: "the nonlinear blocks make an algebraic loop" })?;
        placed.push(waiting.remove(ready));
    }
    Ok(placed)
}
