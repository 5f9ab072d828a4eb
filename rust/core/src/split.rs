//! Splits a loop into the parts that do not act on each other, such as the two planes of a rotor at rest.

use nalgebra::DMatrix;

use crate::lft::Lft;
use crate::model::{Controller, Model};

/// An independent part of a loop, and which inputs and outputs of the whole are its own.
#[derive(Debug, Clone)]
pub struct Part {
    pub model: Model,
    pub inputs: Vec<usize>,
    pub outputs: Vec<usize>,
}

/// Disjoint sets with path halving.
struct Sets(Vec<usize>);

impl Sets {
    fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.find(i), self.find(j));
        self.0[i.max(j)] = i.min(j);
    }

    /// Joins row node `rows + i` with column node `columns + j` wherever `m` is not zero.
    fn join_pattern(&mut self, m: &DMatrix<f64>, rows: impl Fn(usize) -> usize, columns: impl Fn(usize) -> usize) {
        for j in 0..m.ncols() {
            for i in 0..m.nrows() {
                if m[(i, j)] != 0.0 {
                    self.join(rows(i), columns(j));
                }
            }
        }
    }
}

/// The independent parts of a loop; a part without an output is left out.
pub fn split(model: &Model) -> Vec<Part> {
    let lft = &model.lft;
    let (n, nu, ny, k) = (lft.a.nrows(), lft.inputs(), lft.outputs(), lft.gains.len());
    let nc = model.controller.as_ref().map_or(0, |c| c.a.nrows());
    // nodes: states, inputs, outputs, entries of Delta (gains, then blocks), controller states
    let entries = k + lft.blocks.len();
    let (input, output, entry, control) = (n, n + nu, n + nu + ny, n + nu + ny + entries);
    let mut sets = Sets((0..control + nc).collect());
    let reader = readers(lft);
    let column = |j: usize| if j < nu { input + j } else { entry + j - nu };
    let row = |i: usize| if i < ny { output + i } else { entry + reader[i - ny] };
    sets.join_pattern(&lft.a, |i| i, |j| j);
    sets.join_pattern(&lft.b, |i| i, column);
    sets.join_pattern(&lft.c, row, |j| j);
    sets.join_pattern(&lft.d, row, column);
    if let Some(c) = &model.controller {
        sets.join_pattern(&c.a, |i| control + i, |j| control + j);
        sets.join_pattern(&c.b, |i| control + i, |j| output + j);
        sets.join_pattern(&c.c, |i| input + i, |j| control + j);
        sets.join_pattern(&c.d, |i| input + i, |j| output + j);
        for i in 0..c.channels() {
            sets.join(input + i, output + i);
        }
    }
    let mut roots: Vec<usize> = (0..ny).map(|i| sets.find(output + i)).collect();
    roots.sort_unstable();
    roots.dedup();
    roots
        .into_iter()
        .map(|root| {
            let mut members = |from: usize, count: usize| -> Vec<usize> {
                (0..count).filter(|i| sets.find(from + i) == root).collect()
            };
            let (states, inputs, outputs) = (members(0, n), members(input, nu), members(output, ny));
            let (entries, controls) = (members(entry, entries), members(control, nc));
            part(model, &states, inputs, outputs, &entries, &controls)
        })
        .collect()
}

/// For each signal z, the entry of Delta that reads it.
fn readers(lft: &Lft) -> Vec<usize> {
    let k = lft.gains.len();
    let blocks = lft.blocks.iter().enumerate().flat_map(|(i, block)| std::iter::repeat_n(k + i, block.inputs()));
    (0..k).chain(blocks).collect()
}

fn part(
    model: &Model,
    states: &[usize],
    inputs: Vec<usize>,
    outputs: Vec<usize>,
    entries: &[usize],
    controls: &[usize],
) -> Part {
    let lft = &model.lft;
    let (nu, ny, k) = (lft.inputs(), lft.outputs(), lft.gains.len());
    let columns: Vec<usize> = inputs.iter().copied().chain(entries.iter().map(|e| nu + e)).collect();
    let signals = readers(lft).into_iter().enumerate().filter(|(_, entry)| entries.contains(entry));
    let rows: Vec<usize> = outputs.iter().copied().chain(signals.map(|(z, _)| ny + z)).collect();
    let (gains, blocks) = entries.split_at(entries.partition_point(|e| *e < k));
    let sub = Lft {
        a: select(&lft.a, states, states),
        b: select(&lft.b, states, &columns),
        c: select(&lft.c, &rows, states),
        d: select(&lft.d, &rows, &columns),
        gains: gains.iter().map(|e| lft.gains[*e]).collect(),
        blocks: blocks.iter().map(|e| lft.blocks[*e - k].clone()).collect(),
    };
    let mut own_inputs = inputs.clone();
    let controller = model.controller.as_ref().map(|c| {
        if c.noise {
            own_inputs.extend(inputs.iter().map(|i| i + c.channels()));
        }
        Controller {
            a: select(&c.a, controls, controls),
            b: select(&c.b, controls, &inputs),
            c: select(&c.c, &inputs, controls),
            d: select(&c.d, &inputs, &inputs),
            ..*c
        }
    });
    Part { model: Model { lft: sub, controller, ..*model }, inputs: own_inputs, outputs }
}

fn select(m: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])])
}
