//! The slowest of ten million steps: `cargo run --release -p ambid-core --example worst_step -- FILE.stepper...`.
//!
//! The files are those of `ambid export MODEL --stepper FILE`. Each step is timed by itself, the clock's own time in it.

use std::time::{Duration, Instant};

use ambid_core::{Packed, Stepper};

const STEPS: usize = 10_000_000;
/// Amplitude of the excitation in A, large enough to saturate.
const AMPLITUDE: f64 = 1.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("{:>10} {:>10} {:>10} {:>10} {:>8}  of a sample", "median ns", "99.9 %", "99.9999 %", "worst", "mean");
    for path in std::env::args().skip(1) {
        let packed = Packed::from_bytes(&std::fs::read(&path)?)?;
        let mut stepper = Stepper::new(&packed.system()?, &packed.theta)?;
        let (mut u, mut y) = (vec![0.0; stepper.inputs()], vec![0.0; stepper.outputs()]);
        let (mut times, mut register, all) = (vec![0_u32; STEPS], 1_u32, Instant::now());
        for time in &mut times {
            for u in &mut u {
                // maximal-length shift register of 15 bits, taps 15 and 14
                let bit = (register ^ (register >> 1)) & 1;
                register = (register >> 1) | (bit << 14);
                *u = if bit == 1 { AMPLITUDE } else { -AMPLITUDE };
            }
            let start = Instant::now();
            stepper.step(&u, &mut y)?;
            *time = start.elapsed().min(Duration::from_secs(4)).as_nanos() as u32;
        }
        let each = all.elapsed().as_nanos() as f64 / STEPS as f64;
        times.sort_unstable();
        let at = |share: f64| times[(share * (STEPS - 1) as f64) as usize];
        let (worst, sample) = (at(1.0), 1e9 * packed.model.dt);
        let share = 100.0 * f64::from(worst) / sample;
        println!(
            "{:>10} {:>10} {:>10} {worst:>10} {each:>8.0}  {share:.2} %  {path}, largest output {:.1e}",
            at(0.5),
            at(0.999),
            at(0.999_999),
            y.iter().fold(0.0_f64, |a, y| a.max(y.abs()))
        );
    }
    Ok(())
}
