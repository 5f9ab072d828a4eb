//! What tests and benchmarks share: seeded loops of every kind, and a reference that shares no code with the core.
#![allow(dead_code, reason = "each test binary uses its own share")]

pub mod loops;
pub mod machine;
pub mod random;
pub mod reference;
pub mod spectrum;

/// Largest error of a response, relative to the largest value of its output.
///
/// Both arrays are samples x `outputs`, row by row. An output that is expected to be zero must be zero.
pub fn deviation(found: &[f64], expected: &[f64], outputs: usize) -> f64 {
    worst(found, expected, &largest(expected, outputs))
}

/// Largest error of a Jacobian (samples x outputs x parameters), relative to the largest effect of its parameter.
///
/// Effects are compared with each other in units of the largest value of their output in `y`.
pub fn slope_deviation(found: &[f64], expected: &[f64], y: &[f64], outputs: usize) -> f64 {
    let units = largest(y, outputs);
    let parameters = expected.len() / y.len();
    let effects = largest(expected, outputs * parameters);
    let effect = |j: usize| units.iter().enumerate().map(move |(o, unit)| (o, unit, j));
    let relative =
        |(o, unit, j): (usize, &f64, usize)| if *unit > 0.0 { effects[o * parameters + j] / unit } else { 0.0 };
    let of_parameter: Vec<f64> = (0..parameters).map(|j| effect(j).map(relative).fold(0.0, f64::max)).collect();
    let sizes: Vec<f64> = units.iter().flat_map(|unit| of_parameter.iter().map(move |e| e * unit)).collect();
    worst(found, expected, &sizes)
}

fn largest(values: &[f64], columns: usize) -> Vec<f64> {
    let of = |c| values.iter().skip(c).step_by(columns).fold(0.0_f64, |a, b| a.max(b.abs()));
    (0..columns).map(of).collect()
}

fn worst(found: &[f64], expected: &[f64], sizes: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len(), "the arrays differ in length");
    let errors = found.iter().zip(expected).zip(sizes.iter().cycle());
    let relative = errors.map(|((f, e), size)| if f == e { 0.0 } else { (f - e).abs() / size });
    relative.fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { b.max(a) })
}
