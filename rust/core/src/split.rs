//! Splits a loop into the parts that do not act on each other, such as the two planes of a rotor at rest.

use nalgebra::DMatrix;

use crate::lft::Lft;
use crate::model::{Controller, GainError, Model};
use crate::reading::Late;

/// An independent part of a loop, the inputs of the whole that act on it, and the outputs that are its own.
///
/// Several parts may share an input, unless a digital controller drives it.
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
    let (n, m, nu, ny) = (lft.a.nrows(), model.commands(), lft.inputs(), lft.outputs());
    let nc = model.controller.as_ref().map_or(0, |c| c.a.nrows());
    let nr = model.controller.as_ref().map_or(0, Controller::signals);
    // nodes: states, commands, outputs, entries of Delta (gains, then blocks), controller states, signals it reads
    let entries = lft.gains.len() + lft.blocks.len();
    let (command, output, entry, control) = (n, n + m, n + m + ny, n + m + ny + entries);
    let read = control + nc;
    let mut sets = Sets((0..read + nr).collect());
    let reader = readers(lft);
    let row = |i: usize| if i < ny { output + i } else { entry + reader[i - ny] };
    sets.join_pattern(&lft.a, |i| i, |j| j);
    sets.join_pattern(&lft.c, row, |j| j);
    for (first, count, node) in [(0, m, command), (nu, entries, entry)] {
        sets.join_pattern(&lft.b.columns(first, count).into_owned(), |i| i, |j| node + j);
        sets.join_pattern(&lft.d.columns(first, count).into_owned(), row, |j| node + j);
    }
    if let Some(c) = &model.controller {
        sets.join_pattern(&c.a, |i| control + i, |j| control + j);
        sets.join_pattern(&c.b, |i| control + i, |j| read + j);
        sets.join_pattern(&c.c, |i| command + i, |j| control + j);
        sets.join_pattern(&c.d, |i| command + i, |j| read + j);
        sets.join_pattern(&c.reads, |i| read + i, |j| output + j);
        sets.join_pattern(&c.excitation, |i| command + i, |j| command + j);
        for error in &c.errors {
            sets.join_pattern(&error.excitation, |i| command + i, |j| command + j);
            sets.join_pattern(&error.c, |i| command + i, |j| control + j);
            sets.join_pattern(&error.d, |i| command + i, |j| read + j);
        }
        for i in 0..m {
            sets.join(command + i, output + i);
        }
    }
    let mut roots: Vec<usize> = (0..model.outputs()).map(|i| sets.find(output + i)).collect();
    roots.sort_unstable();
    roots.dedup();
    roots
        .into_iter()
        .map(|root| {
            let mut members = |from: usize, count: usize| -> Vec<usize> {
                (0..count).filter(|i| sets.find(from + i) == root).collect()
            };
            let (states, commands, outputs) = (members(0, n), members(command, m), members(output, ny));
            let (entries, controls, reads) = (members(entry, entries), members(control, nc), members(read, nr));
            part(model, &states, &commands, outputs, &entries, [&controls, &reads])
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
    commands: &[usize],
    mut outputs: Vec<usize>,
    entries: &[usize],
    [controls, reads]: [&[usize]; 2],
) -> Part {
    let lft = &model.lft;
    outputs.retain(|o| *o < model.outputs() || !commands.is_empty()); // nobody else reads what is hidden
    let (nu, ny, k) = (lft.inputs(), lft.outputs(), lft.gains.len());
    let signals = readers(lft).into_iter().enumerate().filter(|(_, entry)| entries.contains(entry));
    let rows: Vec<usize> = outputs.iter().copied().chain(signals.map(|(z, _)| ny + z)).collect();
    let taken = |j: usize| model.controller.as_ref().is_some_and(|c| reads.iter().any(|i| c.takes[(*i, j)] != 0.0));
    let acts = |j: &usize| {
        states.iter().any(|i| lft.b[(*i, *j)] != 0.0) || rows.iter().any(|i| lft.d[(*i, *j)] != 0.0) || taken(*j)
    };
    let further = (model.commands()..nu).filter(acts);
    let inputs: Vec<usize> = commands.iter().copied().chain(further).collect();
    let columns: Vec<usize> = inputs.iter().copied().chain(entries.iter().map(|e| nu + e)).collect();
    let (gains, blocks) = entries.split_at(entries.partition_point(|e| *e < k));
    let sub = Lft {
        a: select(&lft.a, states, states),
        b: select(&lft.b, states, &columns),
        c: select(&lft.c, &rows, states),
        d: select(&lft.d, &rows, &columns),
        gains: gains.iter().map(|e| lft.gains[*e]).collect(),
        blocks: blocks.iter().map(|e| lft.blocks[*e - k].clone()).collect(),
    };
    let hidden = outputs.iter().filter(|o| **o >= model.outputs()).count();
    let controller = model.controller.as_ref().filter(|_| !commands.is_empty()).map(|c| {
        let error = |error: &GainError| GainError {
            c: select(&error.c, commands, controls),
            d: select(&error.d, commands, reads),
            excitation: select(&error.excitation, commands, commands),
            parameter: error.parameter,
        };
        let acts = |e: &GainError| e.c.iter().chain(&e.d).chain(&e.excitation).any(|x| *x != 0.0);
        Controller {
            a: select(&c.a, controls, controls),
            b: select(&c.b, controls, reads),
            c: select(&c.c, commands, controls),
            d: select(&c.d, commands, reads),
            reads: select(&c.reads, reads, &outputs),
            hidden,
            takes: select(&c.takes, reads, &inputs),
            excitation: select(&c.excitation, commands, commands),
            errors: c.errors.iter().map(error).filter(acts).collect(),
            ..*c
        }
    });
    let place = |output: usize| outputs.iter().position(|o| *o == output);
    let late = model.late.iter().filter_map(|late| place(late.output).map(|output| Late { output, ..*late })).collect();
    outputs.truncate(outputs.len() - hidden);
    Part { model: Model { lft: sub, dt: model.dt, controller, substeps: model.substeps, late }, inputs, outputs }
}

fn select(m: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])])
}
