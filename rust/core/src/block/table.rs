//! A user's function of one or two signals, tabulated on a uniform grid: natural cubic splines, straight beyond.
//!
//! In one variable the function is `sum of weights * [v0, s0, v1, s1]`, values and slopes at the two nearest nodes;
//! in two variables it is the tensor product of that.

use crate::error::{Error, Result, check_finite, check_len};

/// A uniform grid of one variable.
#[derive(Debug, Clone, PartialEq)]
struct Axis {
    first: f64,
    spacing: f64,
    nodes: usize,
}

/// A tabulated function with two continuous derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    axes: Vec<Axis>,
    /// Per node of the first, then of the second axis: value, slope by the first, slope by the second, mixed slope.
    ///
    /// Slopes are per interval.
    nodes: Vec<[f64; 4]>,
}

impl Table {
    /// `values` row by row, a row per node of the first variable; `grid` is first node, spacing and number of nodes.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`], [`Error::Block`] where a grid has less than three nodes or no spacing.
    pub fn new(grid: &[(f64, f64, usize)], values: &[f64]) -> Result<Self> {
        let axes: Vec<Axis> = grid.iter().map(|&(first, spacing, nodes)| Axis { first, spacing, nodes }).collect();
        for axis in &axes {
            check_finite("grid of a table", &[axis.first, axis.spacing])?;
            if axis.nodes < 3 || axis.spacing <= 0.0 {
                return Err(Error::Block { what: "a table needs three nodes or more, and a spacing above zero" });
            }
        }
        if axes.is_empty() || axes.len() > 2 {
            return Err(Error::Block { what: "a table is a function of one or two variables" });
        }
        check_len("values of a table", values.len(), axes.iter().map(|a| a.nodes).product())?;
        check_finite("values of a table", values)?;
        let rows = axes[0].nodes;
        let columns = values.len() / rows;
        let mut nodes: Vec<[f64; 4]> = values.iter().map(|v| [*v, 0.0, 0.0, 0.0]).collect();
        let mut fill = |from: usize, to: usize, count: usize, place: &dyn Fn(usize) -> usize| {
            let line: Vec<f64> = (0..count).map(|i| nodes[place(i)][from]).collect();
            spline_slopes(&line).into_iter().enumerate().for_each(|(i, slope)| nodes[place(i)][to] = slope);
        };
        for column in 0..columns {
            fill(0, 1, rows, &|row| row * columns + column);
        }
        if axes.len() == 2 {
            for row in 0..rows {
                fill(0, 2, columns, &|column| row * columns + column);
                fill(1, 3, columns, &|column| row * columns + column);
            }
        }
        Ok(Self { axes, nodes })
    }

    /// Number of variables.
    pub fn inputs(&self) -> usize {
        self.axes.len()
    }

    /// First node, spacing and number of nodes of each variable.
    pub(crate) fn grid(&self) -> Vec<(f64, (f64, usize))> {
        self.axes.iter().map(|axis| (axis.first, (axis.spacing, axis.nodes))).collect()
    }

    /// The values that it was made of.
    pub(crate) fn values(&self) -> Vec<f64> {
        self.nodes.iter().map(|node| node[0]).collect()
    }

    /// The function and its derivatives.
    pub(crate) fn evaluate(&self, z: [f64; 2]) -> (f64, [f64; 2]) {
        let (row, first, first_slope) = self.axes[0].weights(z[0]);
        if self.axes.len() == 1 {
            let data = [0, 1].map(|i| self.nodes[row + i]);
            let sum = |w: &[f64; 4]| w[0] * data[0][0] + w[1] * data[0][1] + w[2] * data[1][0] + w[3] * data[1][1];
            return (sum(&first), [sum(&first_slope), 0.0]);
        }
        let (column, second, second_slope) = self.axes[1].weights(z[1]);
        let columns = self.axes[1].nodes;
        let sum = |w: &[f64; 4], v: &[f64; 4]| -> f64 {
            let mut sum = 0.0;
            for i in 0..2 {
                for j in 0..2 {
                    let [value, by_first, by_second, mixed] = self.nodes[(row + i) * columns + column + j];
                    let (w, v) = (&w[2 * i..2 * i + 2], &v[2 * j..2 * j + 2]);
                    sum += v[0] * (w[0] * value + w[1] * by_first) + v[1] * (w[0] * by_second + w[1] * mixed);
                }
            }
            sum
        };
        (sum(&first, &second), [sum(&first_slope, &second), sum(&first, &second_slope)])
    }
}

impl Axis {
    /// The node to the left of z, the weights of `[v0, s0, v1, s1]` from there, and their derivatives by z.
    fn weights(&self, z: f64) -> (usize, [f64; 4], [f64; 4]) {
        let last = (self.nodes - 1) as f64;
        let place = (z - self.first) / self.spacing;
        let per = 1.0 / self.spacing;
        if place <= 0.0 {
            return (0, [1.0, place, 0.0, 0.0], [0.0, per, 0.0, 0.0]);
        }
        if place >= last {
            return (self.nodes - 2, [0.0, 0.0, 1.0, place - last], [0.0, 0.0, 0.0, per]);
        }
        let node = (place as usize).min(self.nodes - 2);
        let t = place - node as f64;
        let u = 1.0 - t;
        let weights = [u * u * (1.0 + 2.0 * t), u * u * t, t * t * (3.0 - 2.0 * t), -t * t * u];
        let bend = 6.0 * t * u;
        (node, weights, [-bend, u * (1.0 - 3.0 * t), bend, t * (3.0 * t - 2.0)].map(|slope| slope * per))
    }
}

/// Slopes per interval of the natural cubic spline: `s_(i-1) + 4 s_i + s_(i+1) = 3 (v_(i+1) - v_(i-1))`.
fn spline_slopes(values: &[f64]) -> Vec<f64> {
    let last = values.len() - 1;
    let right = |i: usize| 3.0 * (values[(i + 1).min(last)] - values[i.saturating_sub(1)]);
    let diagonal = |i: usize| if i == 0 || i == last { 2.0 } else { 4.0 };
    let (mut pivots, mut slopes) = (vec![diagonal(0)], vec![right(0)]);
    for i in 1..=last {
        slopes.push(right(i) - slopes[i - 1] / pivots[i - 1]);
        pivots.push(diagonal(i) - 1.0 / pivots[i - 1]);
    }
    slopes[last] /= pivots[last];
    for i in (0..last).rev() {
        slopes[i] = (slopes[i] - slopes[i + 1]) / pivots[i];
    }
    slopes
}
