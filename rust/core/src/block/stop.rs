//! A stop at a distance around the centre.

/// `w = -(r - c)+ (1 + a r') x1 / r`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    pub clearance: f64,
    pub damping: f64,
    pub smoothing: f64,
}

impl Stop {
    #[inline(always)]
    pub fn evaluate(&self, [x1, v1, x2, v2]: [f64; 4], by_coefficient: &mut [f64]) -> (f64, [f64; 4]) {
        let radius = x1.hypot(x2);
        let (depth, slope) = ramp(radius - self.clearance, self.smoothing);
        if depth == 0.0 || radius == 0.0 {
            by_coefficient.fill(0.0);
            return (0.0, [0.0; 4]);
        }
        let onto = [x1 / radius, x2 / radius];
        let rate = v1 * onto[0] + v2 * onto[1];
        let damped = 1.0 + self.damping * rate;
        by_coefficient.copy_from_slice(&[slope * damped * onto[0], -depth * rate * onto[0]]);
        let by_rate = -depth * self.damping * onto[0];
        let by_place = |v: f64, own: f64| {
            let along = (depth / radius - slope) * damped * own - depth / radius * self.damping * (v - rate * own);
            along * onto[0]
        };
        (
            -depth * damped * onto[0],
            [
                by_place(v1, onto[0]) - depth / radius * damped,
                by_rate * onto[0],
                by_place(v2, onto[1]),
                by_rate * onto[1],
            ],
        )
    }
}

/// Zero below `-e`, z above `e`, twice smooth between; and its slope.
#[inline(always)]
fn ramp(z: f64, e: f64) -> (f64, f64) {
    let t = ((z + e) / (2.0 * e)).clamp(0.0, 1.0);
    let rest = (z - e).max(0.0);
    (2.0 * e * t * t * t * (1.0 - 0.5 * t) + rest, t * t * (3.0 - 2.0 * t))
}
