//! A mass levitated by one magnet under digital PID, run in real time: `cargo run --release --example embedded`.
//!
//! Plant: `m x'' = K_i i + K_s x` (the magnet pulls harder the closer the mass), `tau_e i' = command - i`.
//! Controller: `command = -PID(x) + excitation`, computed at 20 kHz, one sample late.

use std::time::Instant;

use ambid_core::{ClosedLoop, Controller, Gain, Lft, Model, Result, Stepper};
use nalgebra::DMatrix;

const SAMPLE: f64 = 1.0 / 20_000.0; // s
const MASS: f64 = 2.5; // kg
const K_I: f64 = 80.0; // N/A
const K_S: f64 = 4e5; // N/m, destabilising
const TAU_E: f64 = 3e-4; // s

/// Known: mass and wiring. Uncertain: the gains K_i, K_s and 1/tau_e, each between a port z and a port w.
fn plant() -> Result<Lft> {
    // states x, v, i; inputs command, w_1 = K_i i, w_2 = K_s x, w_3 = (command - i) / tau_e
    let a = DMatrix::from_row_slice(3, 3, &[0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let force = 1.0 / MASS;
    let b = DMatrix::from_row_slice(3, 4, &[0.0, 0.0, 0.0, 0.0, 0.0, force, force, 0.0, 0.0, 0.0, 0.0, 1.0]);
    // outputs x, i, then z_1 = i, z_2 = x, z_3 = command - i
    let rows = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
    let c = DMatrix::from_row_slice(5, 3, rows.as_flattened());
    let mut d = DMatrix::zeros(5, 4);
    d[(4, 0)] = 1.0;
    let gain = |parameter, power| Gain { parameter, scale: 1.0, power };
    Lft::new(a, b, c, d, vec![gain(0, 1), gain(1, 1), gain(2, -1)])
}

/// PID with filtered derivative, `P + I/s + D s/(T s + 1)`, discretised by backward differences.
fn controller() -> Controller {
    let (p, i, d, filter) = (2e4, 2e5, 40.0, 5e-5); // A/m, A/(m s), A s/m, s
    let decay = filter / (filter + SAMPLE);
    let rate = d / (filter + SAMPLE);
    // states: the integral, and the last displacement with what is left of the last derivative
    let a = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, decay]);
    let b = DMatrix::from_row_slice(2, 1, &[i * SAMPLE, rate * (decay - 1.0)]);
    let c = DMatrix::from_row_slice(1, 2, &[1.0, 1.0]);
    let d = DMatrix::from_element(1, 1, p + i * SAMPLE + rate);
    Controller { delay: 1.0, ..Controller::new(a, b, c, d) }
}

fn main() -> Result<()> {
    let theta = [K_I, K_S, TAU_E];
    let system = ClosedLoop::new(Model::new(plant()?, SAMPLE, Some(controller()))?, theta.len())?;
    let slowest = system.poles(&theta)?.iter().map(|p| p.re).fold(f64::NEG_INFINITY, f64::max);
    println!("slowest pole: {slowest:.1} 1/s (negative: the mass levitates)");

    // all memory is taken here; every step is the same few multiplications
    let mut stepper = Stepper::new(&system, &theta)?;
    let mut register = 1_u32;
    let mut excitation = || {
        // maximal-length shift register of 15 bits, taps 15 and 14
        let bit = (register ^ (register >> 1)) & 1;
        register = (register >> 1) | (bit << 14);
        if bit == 1 { 0.2 } else { -0.2 }
    };
    let mut outputs = [0.0; 2];
    println!("{:>8} {:>12} {:>10}", "t in ms", "x in um", "i in A");
    for k in 0..200 {
        stepper.step(&[excitation()], &mut outputs)?;
        if k % 20 == 0 {
            println!("{:>8.2} {:>12.4} {:>10.4}", 1e3 * SAMPLE * f64::from(k), 1e6 * outputs[0], outputs[1]);
        }
    }
    let (steps, start) = (1_000_000_u32, Instant::now());
    for _ in 0..steps {
        stepper.step(&[excitation()], &mut outputs)?;
    }
    let each = start.elapsed().as_secs_f64() / f64::from(steps);
    println!("{:.0} ns per step, {:.2} % of a sample", 1e9 * each, 100.0 * each / SAMPLE);
    Ok(())
}
