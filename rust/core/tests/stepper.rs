//! Sample by sample is the same as all at once.

mod common;

use ambid_core::Stepper;
use common::deviation;
use common::loops::Problem;
use common::machine::{digital, machine, saturating};
use common::random::Random;

fn run(stepper: &mut Stepper, u: &[f64]) -> Vec<f64> {
    let (inputs, outputs) = (stepper.inputs(), stepper.outputs());
    let mut y = vec![0.0; u.len() / inputs * outputs];
    for (u, y) in u.chunks_exact(inputs).zip(y.chunks_exact_mut(outputs)) {
        stepper.step(u, y).expect("sizes fit");
    }
    y
}

fn assert_equal(p: &Problem, random: &mut Random) {
    let system = p.system();
    let u = random.signal(400 * system.inputs());
    let mut stepper = Stepper::new(&system, &p.theta).expect("regular");
    let y = run(&mut stepper, &u);
    assert!(deviation(&y, &system.simulate(&p.theta, &u).expect("stable"), system.outputs()) < 1e-10);
    stepper.reset();
    assert_eq!(run(&mut stepper, &u), y, "a reset stepper starts from rest");
}

#[test]
fn steps_of_random_loops() {
    let mut random = Random(41);
    for _ in 0..30 {
        let p = random.analog_loop();
        assert_equal(&p, &mut random);
    }
    for delay in [0.0, 0.3, 1.0, 2.5] {
        for steps in [1, 2] {
            let p = random.digital_loop(delay, steps);
            assert_equal(&p, &mut random);
        }
    }
}

#[test]
fn steps_of_machines() {
    for gyroscopic in [0.0, 100.0] {
        assert_equal(&machine(gyroscopic, 0.02), &mut Random(42));
    }
}

#[test]
fn a_wrong_length_leaves_the_state_alone() {
    let p = machine(0.0, 0.02);
    let system = p.system();
    let mut stepper = Stepper::new(&system, &p.theta).expect("regular");
    let u = Random(43).signal(40);
    let (before, after) = u.split_at(20);
    let mut y = run(&mut stepper, before);
    assert!(stepper.step(&[1.0; 5], &mut [0.0; 8]).is_err());
    y.extend(run(&mut stepper, after));
    let mut undisturbed = Stepper::new(&system, &p.theta).expect("regular");
    assert_eq!(run(&mut undisturbed, &u), y);
}

#[test]
fn the_outputs_of_now_are_those_of_the_step_and_time_stands_still() {
    let mut random = Random(44);
    let mut problems = vec![machine(0.0, 0.02), saturating(100.0, 4, None), digital(0.0, 0.3)];
    problems.extend([0.0, 0.3, 1.0, 2.5].map(|delay| random.digital_loop(delay, 2)));
    for p in problems {
        let system = p.system();
        let u = random.signal(50 * system.inputs());
        let [mut stepper, mut undisturbed] = [0, 1].map(|_| Stepper::new(&system, &p.theta).expect("regular"));
        for u in u.chunks_exact(system.inputs()) {
            let [mut now, mut y] = [0, 1].map(|_| vec![f64::NAN; system.outputs()]);
            stepper.outputs_now(&vec![1.0; u.len()], &mut now).expect("sizes fit");
            stepper.outputs_now(u, &mut now).expect("sizes fit");
            assert_eq!(run(&mut stepper, u), now);
            undisturbed.step(u, &mut y).expect("sizes fit");
            assert_eq!(now, y);
        }
    }
}
