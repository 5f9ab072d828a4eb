//! The slowest of ten million steps: `cargo run --release -p ambid-core --example worst_step -- FILE.stepper...`.
//!
//! The files are those of `ambid export MODEL --stepper FILE`. Each step is timed by itself, the clock's own time in it.
//! A million steps are taken ten times from rest on: the slowest is then often one that the system interrupted; the
//! slowest of the steps at their best is what the work itself takes.

use std::time::{Duration, Instant};

use ambid_core::{Packed, Stepper};

const STEPS: usize = 1_000_000;
const ROUNDS: usize = 10;
/// Amplitude of the excitation in A, large enough to saturate.
const AMPLITUDE: f64 = 1.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("{:>9} {:>9} {:>9} {:>11} {:>13}  ns a step", "median", "99.9 %", "99.999 %", "slowest", "at their best");
    for path in std::env::args().skip(1) {
        let packed = Packed::from_bytes(&std::fs::read(&path)?)?;
        let mut stepper = Stepper::new(&packed.system()?, &packed.theta)?;
        let (mut u, mut y) = (vec![0.0; stepper.inputs()], vec![0.0; stepper.outputs()]);
        let (mut best, mut all) = (vec![u32::MAX; STEPS], Vec::with_capacity(ROUNDS * STEPS));
        for _ in 0..ROUNDS {
            stepper.reset();
            let mut register = 1_u32;
            for best in &mut best {
                for u in &mut u {
                    // maximal-length shift register of 15 bits, taps 15 and 14
                    let bit = (register ^ (register >> 1)) & 1;
                    register = (register >> 1) | (bit << 14);
                    *u = if bit == 1 { AMPLITUDE } else { -AMPLITUDE };
                }
                let start = Instant::now();
                stepper.step(&u, &mut y)?;
                let time = start.elapsed().min(Duration::from_secs(4)).as_nanos() as u32;
                *best = time.min(*best);
                all.push(time);
            }
        }
        all.sort_unstable();
        let at = |share: f64| all[(share * (all.len() - 1) as f64) as usize];
        let (median, most, nearly, slowest) = (at(0.5), at(0.999), at(0.99999), at(1.0));
        let best = best.into_iter().max().unwrap_or(0);
        println!("{median:>9} {most:>9} {nearly:>9} {slowest:>11} {best:>13}  {path}");
    }
    Ok(())
}
