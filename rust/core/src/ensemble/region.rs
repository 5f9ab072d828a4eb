//! The quadratic form of a descent in coordinates that shrink towards its bounds, and the step that stays between them.

use nalgebra::{DMatrix, DVector};

/// About one x: with `d` the roots of the distances to the bounds, steps are `d p`.
pub struct Region<'a> {
    x: &'a DVector<f64>,
    lower: &'a DVector<f64>,
    upper: &'a DVector<f64>,
    d: DVector<f64>,
    gradient: DVector<f64>,
    /// By p.
    pub jacobian: DMatrix<f64>,
    /// What the shrinking adds to the diagonal of J'J.
    pub curvature: DVector<f64>,
    /// Part of the way to a bound that a step may go.
    back: f64,
}

impl<'a> Region<'a> {
    /// `v` are distances to the bounds, `dv` their derivatives, `slope` is the largest of the gradient times `v`.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        x: &'a DVector<f64>,
        gradient: &DVector<f64>,
        jacobian: &DMatrix<f64>,
        v: DVector<f64>,
        dv: &DVector<f64>,
        lower: &'a DVector<f64>,
        upper: &'a DVector<f64>,
        slope: f64,
    ) -> Self {
        let d = v.map(f64::sqrt);
        let curvature = gradient.component_mul(dv);
        let jacobian = jacobian * DMatrix::from_diagonal(&d);
        let gradient = gradient.component_mul(&d);
        Self { x, lower, upper, d, gradient, jacobian, curvature, back: (1.0 - slope).max(0.995) }
    }

    /// The best of a step `p`, its reflection at the bound that it meets, and the steepest way: step, p, and its fall.
    pub fn step(&self, p: DVector<f64>, radius: f64) -> (DVector<f64>, DVector<f64>, f64) {
        let step = self.d.component_mul(&p);
        let end = self.x + &step;
        if (0..end.len()).all(|i| end[i] >= self.lower[i] && end[i] <= self.upper[i]) {
            let fall = -self.value(&p);
            return (step, p, fall);
        }
        let (stride, hit) = self.to_bound(self.x, &step);
        let mut turned = DVector::from_fn(p.len(), |i, _| if hit[i] { -p[i] } else { p[i] });
        let p = p * stride;
        let reflected = self.d.component_mul(&turned);
        let on_bound = self.x + step * stride;
        let to_edge = to_radius(&p, &turned, radius);
        let (to_bound, _) = self.to_bound(&on_bound, &reflected);
        let most = to_bound.min(to_edge);
        let (low, high) = match most {
            most if most > 0.0 => {
                ((1.0 - self.back) * stride / most, if most == to_bound { self.back * to_bound } else { to_edge })
            }
            _ => (0.0, -1.0),
        };
        let mut value_turned = f64::INFINITY;
        if low <= high {
            let best;
            (best, value_turned) = self.along(&p, &turned, low, high);
            turned = turned * best + &p;
        }
        let p = p * self.back;
        let value = self.value(&p);
        let steepest = -&self.gradient;
        let to_edge = radius / steepest.norm();
        let (to_bound, _) = self.to_bound(self.x, &self.d.component_mul(&steepest));
        let most = if to_bound < to_edge { self.back * to_bound } else { to_edge };
        let (best, value_steepest) = self.along(&DVector::zeros(p.len()), &steepest, 0.0, most);
        let (chosen, value) = if value < value_turned && value < value_steepest {
            (p, value)
        } else if value_turned < value && value_turned < value_steepest {
            (turned, value_turned)
        } else {
            (steepest * best, value_steepest)
        };
        (self.d.component_mul(&chosen), chosen, -value)
    }

    /// Change of half the sum of squares.
    fn value(&self, p: &DVector<f64>) -> f64 {
        0.5 * self.product(p, p) + self.gradient.dot(p)
    }

    fn product(&self, a: &DVector<f64>, b: &DVector<f64>) -> f64 {
        (&self.jacobian * a).dot(&(&self.jacobian * b)) + a.component_mul(&self.curvature).dot(b)
    }

    /// The least value on `from + t way` for t from `low` to `high`, and that t before it.
    fn along(&self, from: &DVector<f64>, way: &DVector<f64>, low: f64, high: f64) -> (f64, f64) {
        let a = 0.5 * self.product(way, way);
        let b = self.gradient.dot(way) + self.product(from, way);
        let begin = self.value(from);
        let lowest = -0.5 * b / a;
        let middle = (low < lowest && lowest < high).then_some(lowest);
        let tried = [Some(low), Some(high), middle].into_iter().flatten().map(|t| (t, t * (a * t + b) + begin));
        tried.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((low, begin))
    }

    /// How many times `step` leads from `x` to the first bound, and which bounds that are.
    fn to_bound(&self, x: &DVector<f64>, step: &DVector<f64>) -> (f64, Vec<bool>) {
        let one = |i: usize| match step[i] {
            0.0 => f64::INFINITY,
            s => ((self.lower[i] - x[i]) / s).max((self.upper[i] - x[i]) / s),
        };
        let each: Vec<f64> = (0..x.len()).map(one).collect();
        let least = each.iter().copied().fold(f64::INFINITY, f64::min);
        (least, each.iter().map(|own| *own == least).collect())
    }
}

/// The positive t at which `from + t way` leaves the trust region.
fn to_radius(from: &DVector<f64>, way: &DVector<f64>, radius: f64) -> f64 {
    let (a, b) = (way.norm_squared(), from.dot(way));
    let c = (from.norm_squared() - radius * radius).min(0.0);
    let root = (b * b - a * c).sqrt();
    let q = -(b + root.copysign(b));
    if q == 0.0 { 0.0 } else { (q / a).max(c / q) }
}

/// For each x -1 on its lower bound, 1 on its upper one, else 0.
pub fn on_bound<'a>(
    x: &'a DVector<f64>,
    lower: &'a DVector<f64>,
    upper: &'a DVector<f64>,
    part: f64,
) -> impl Iterator<Item = i8> + 'a {
    (0..x.len()).map(move |i| {
        let (below, above) = (x[i] - lower[i], upper[i] - x[i]);
        let near = |bound: f64| if bound.is_finite() { part * bound.abs().max(1.0) } else { f64::NEG_INFINITY };
        if above <= below.min(near(upper[i])) {
            1
        } else if below <= above.min(near(lower[i])) {
            -1
        } else {
            0
        }
    })
}

/// x strictly between its bounds, by a part of them, or by the next number where `part` is zero.
pub fn feasible(x: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>, part: f64) -> DVector<f64> {
    let sides: Vec<i8> = on_bound(x, lower, upper, part).collect();
    DVector::from_fn(x.len(), |i, _| {
        let away = |bound: f64| part * bound.abs().max(1.0);
        let own = match sides[i] {
            -1 if part == 0.0 => lower[i].next_up(),
            1 if part == 0.0 => upper[i].next_down(),
            -1 => lower[i] + away(lower[i]),
            1 => upper[i] - away(upper[i]),
            _ => x[i],
        };
        if own < lower[i] || own > upper[i] { 0.5 * (lower[i] + upper[i]) } else { own }
    })
}
