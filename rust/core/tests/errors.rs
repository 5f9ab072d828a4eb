//! Every wrong input is an error that names its cause; nothing panics.

mod common;

use ambid_core::{
    Block, ClosedLoop, Coefficient, Controller, Data, Error, Gain, GainError, Law, Lft, Model, Result, Stepper,
    normal_equations,
};
use common::loops::{Problem, lags};
use common::machine::machine;
use nalgebra::{Complex, DMatrix};

fn lag() -> Problem {
    lags(&[0.7], &[&[]], &[0])
}

fn shape<T>(result: Result<T>) -> bool {
    matches!(result, Err(Error::Shape { .. }))
}

fn not_finite<T>(result: Result<T>) -> bool {
    matches!(result, Err(Error::NotFinite { .. }))
}

fn singular<T>(result: Result<T>) -> bool {
    matches!(result, Err(Error::Singular { .. }))
}

#[test]
fn unstable_loops() {
    let mut p = machine(0.0, 0.02);
    p.theta[..4].fill(1.0); // next to no force: the bearings do not levitate
    let system = p.system();
    let u = vec![0.0; 40];
    let data = Data::new(&system, u.clone(), vec![0.0; 80], vec![1.0; 8], 0).unwrap();
    let unstable = |e: Error| matches!(e, Error::Unstable { growth, .. } if growth > 1.0 && growth.is_finite());
    assert!(unstable(system.simulate(&p.theta, &u).unwrap_err()));
    assert!(unstable(system.sensitivity(&p.theta, &p.free(), &u).unwrap_err()));
    assert!(unstable(normal_equations(&system, &p.theta, &p.free(), &[&data]).unwrap_err()));
    // its poles, its matrices and a run of it are still to be had
    let poles = system.poles(&p.theta).unwrap();
    let Err(Error::Unstable { rate, frequency_hz, .. }) = system.simulate(&p.theta, &u) else { panic!("unstable") };
    let stated = Complex::new(rate, frequency_hz * std::f64::consts::TAU);
    assert!(poles.iter().any(|p| (p - stated).norm() < 1e-9 * p.norm()), "{stated} is none of {poles:?}");
    assert!(system.discrete(&p.theta).is_ok());
    assert!(Stepper::new(&system, &p.theta).is_ok());
}

/// A pole at the stability limit, alone and double.
#[test]
fn integrators_are_unstable() {
    for n in [1, 2] {
        let (b, c) = (DMatrix::from_element(n, 1, 1.0), DMatrix::from_element(1, n, 1.0));
        let lft = Lft::new(DMatrix::zeros(n, n), b, c, DMatrix::zeros(1, 1), vec![]).unwrap();
        let system = ClosedLoop::new(Model::new(lft, 0.1, None).unwrap(), 0).unwrap();
        assert!(matches!(system.simulate(&[], &[1.0]), Err(Error::Unstable { .. })), "{n} integrators");
    }
}

#[test]
fn parameters_that_are_not_finite() {
    let system = lag().system();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(not_finite(system.simulate(&[bad], &[1.0])));
        assert!(not_finite(system.poles(&[bad])));
        assert!(not_finite(system.discrete(&[bad])));
        assert!(not_finite(normal_equations(&system, &[bad], &[0], &[])));
    }
}

/// Whatever finite numbers an optimiser tries, the answer is finite or an error.
#[test]
fn parameters_out_of_all_proportion() {
    for p in [lag(), lags(&[0.7, 0.7], &[&[], &[0]], &[1]), machine(0.0, 0.02), machine(50.0, 0.02)] {
        let system = p.system();
        let u = vec![1.0; 30 * system.inputs()];
        for bad in [0.0, -0.0, 1e-320, 1e-200, 1e-12, 1e12, 1e200, f64::MAX, -1e-3, -1e300] {
            for j in p.free() {
                let mut theta = p.theta.clone();
                theta[j] = bad;
                if let Ok((y, jacobian)) = system.sensitivity(&theta, &p.free(), &u) {
                    assert!(y.iter().chain(&jacobian).all(|v| v.is_finite()), "parameter {j} at {bad:e}");
                }
                if let Ok(poles) = system.poles(&theta) {
                    assert!(poles.iter().all(|p| p.re.is_finite()), "parameter {j} at {bad:e}");
                }
                let _ = system.discrete(&theta);
            }
        }
    }
    assert!(singular(lag().system().simulate(&[0.0], &[1.0])), "a time constant of zero");
}

#[test]
fn an_algebraic_loop_without_solution() {
    // z = w, w = theta z
    let (a, b, c) = (DMatrix::from_element(1, 1, -1.0), DMatrix::zeros(1, 2), DMatrix::zeros(2, 1));
    let d = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 1.0]);
    let lft = Lft::new(a, b, c, d, vec![Gain { parameter: 0, scale: 1.0, power: 1 }]).unwrap();
    let system = ClosedLoop::new(Model::new(lft, 0.1, None).unwrap(), 1).unwrap();
    assert!(singular(system.simulate(&[1.0], &[1.0])));
    assert!(system.simulate(&[0.5], &[1.0]).is_ok());
}

#[test]
fn wrong_lengths() {
    let p = machine(0.0, 0.02);
    let system = p.system();
    let u = vec![0.0; 4 * 10];
    assert!(shape(system.simulate(&p.theta[1..], &u)), "theta");
    assert!(shape(system.simulate(&p.theta, &u[1..])), "excitation");
    assert!(shape(system.sensitivity(&p.theta, &[0, 9], &u)), "a parameter that does not exist");
    assert!(shape(ClosedLoop::new(p.model.clone(), 8)), "gains beyond the parameters");
    let data =
        |u: usize, z: usize, w: usize, first| Data::new(&system, vec![0.0; u], vec![0.0; z], vec![1.0; w], first);
    assert!(data(40, 80, 8, 9).is_ok());
    assert!(shape(data(39, 80, 8, 0)), "excitation");
    assert!(shape(data(40, 79, 8, 0)), "measurement");
    assert!(shape(data(40, 80, 7, 0)), "weights");
    assert!(shape(data(40, 80, 8, 10)), "first");
    assert!(shape(data(0, 0, 8, 0)), "no samples");
    let foreign = Data::new(&lag().system(), vec![0.0; 10], vec![0.0; 10], vec![1.0], 0).unwrap();
    assert!(shape(normal_equations(&system, &p.theta, &[0], &[&foreign])), "a record of another loop");
    let mut stepper = Stepper::new(&system, &p.theta).unwrap();
    assert!(shape(stepper.step(&[0.0; 3], &mut [0.0; 8])));
    assert!(shape(stepper.step(&[0.0; 4], &mut [0.0; 7])));
}

#[test]
fn records_that_are_not_finite() {
    let system = lag().system();
    let data = |u, z, w| Data::new(&system, vec![u; 2], vec![z; 2], vec![w], 0);
    assert!(data(1.0, 1.0, 1.0).is_ok());
    assert!(not_finite(data(f64::NAN, 1.0, 1.0)));
    assert!(not_finite(data(1.0, f64::INFINITY, 1.0)));
    assert!(not_finite(data(1.0, 1.0, f64::NAN)));
}

#[test]
fn excitations_that_are_not_finite() {
    let digital = lag().under_digital(0.1, 0.1, 0.5);
    for p in [lag(), lags(&[0.7, 0.7], &[&[], &[0]], &[1]), digital] {
        let system = p.system();
        let mut stepper = Stepper::new(&system, &p.theta).unwrap();
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(not_finite(system.simulate(&p.theta, &[1.0, bad, 1.0])));
            assert!(not_finite(system.sensitivity(&p.theta, &[0], &[1.0, bad, 1.0])));
            let mut y = [0.0];
            assert!(not_finite(stepper.step(&[bad], &mut y)));
            assert_eq!(y, [0.0], "nothing moved");
        }
    }
}

#[test]
fn models_that_do_not_fit() {
    let zeros = DMatrix::<f64>::zeros;
    let lft = |a, b, c, d| Lft::new(a, b, c, d, vec![Gain { parameter: 0, scale: 1.0, power: 1 }]);
    assert!(lft(zeros(2, 2), zeros(2, 2), zeros(3, 2), zeros(3, 2)).is_ok());
    assert!(shape(lft(zeros(2, 1), zeros(2, 2), zeros(3, 2), zeros(3, 2))), "A");
    assert!(shape(lft(zeros(2, 2), zeros(1, 2), zeros(3, 2), zeros(3, 2))), "B");
    assert!(shape(lft(zeros(2, 2), zeros(2, 0), zeros(3, 2), zeros(3, 0))), "no column for the gain");
    assert!(shape(lft(zeros(2, 2), zeros(2, 2), zeros(0, 2), zeros(0, 2))), "no row for the gain");
    assert!(shape(lft(zeros(2, 2), zeros(2, 2), zeros(3, 2), zeros(2, 2))), "D");
    assert!(not_finite(lft(zeros(2, 2).add_scalar(f64::NAN), zeros(2, 2), zeros(3, 2), zeros(3, 2))));
    for dt in [0.0, -0.1, f64::NAN, f64::INFINITY] {
        assert!(not_finite(Model::new(lag().model.lft, dt, None)), "dt {dt}");
    }
}

#[test]
fn controllers_that_do_not_fit() {
    let zeros = DMatrix::<f64>::zeros;
    let good = || Controller { delay: 0.5, ..Controller::new(zeros(2, 2), zeros(2, 1), zeros(1, 2), zeros(1, 1)) };
    let model = |controller| Model::new(lag().model.lft, 0.1, Some(controller));
    assert!(model(good()).is_ok());
    assert!(shape(model(Controller { a: zeros(2, 3), ..good() })));
    assert!(shape(model(Controller { b: zeros(3, 1), ..good() })));
    assert!(shape(model(Controller { c: zeros(1, 3), ..good() })));
    assert!(shape(model(Controller { b: zeros(2, 2), c: zeros(2, 2), d: zeros(2, 2), ..good() })), "two channels");
    assert!(not_finite(model(Controller { d: zeros(1, 1).add_scalar(f64::NAN), ..good() })));
    assert!(not_finite(model(Controller { delay: -1.0, ..good() })));
    assert!(not_finite(model(Controller { delay: f64::NAN, ..good() })));
    assert!(not_finite(model(Controller { steps: 0, ..good() })));
    assert!(not_finite(model(Controller { excitation: zeros(1, 1).add_scalar(f64::NAN), ..good() })));
    let with =
        |c, d, excitation| model(Controller { errors: vec![GainError { parameter: 0, c, d, excitation }], ..good() });
    assert!(shape(model(Controller { excitation: zeros(2, 1), ..good() })));
    assert!(with(zeros(1, 2), zeros(1, 1), zeros(1, 1)).is_ok());
    assert!(shape(with(zeros(1, 3), zeros(1, 1), zeros(1, 1))));
    assert!(shape(with(zeros(1, 2), zeros(2, 1), zeros(1, 1))));
    assert!(shape(with(zeros(1, 2), zeros(1, 1), zeros(1, 2))));
    assert!(not_finite(with(zeros(1, 2).add_scalar(f64::NAN), zeros(1, 1), zeros(1, 1))));
    assert!(not_finite(with(zeros(1, 2), zeros(1, 1), zeros(1, 1).add_scalar(f64::INFINITY))));
    // inputs and outputs beyond those of the controller are the plant's own
    let mut wide = lag().model.lft;
    wide.b = wide.b.insert_column(1, 1.0);
    wide.c = wide.c.insert_row(1, 1.0);
    wide.d = wide.d.insert_column(1, 1.0).insert_row(1, 1.0);
    assert_eq!(Model::new(wide, 0.1, Some(good())).unwrap().inputs(), 2);
    // a displacement that follows the command at once, in G or through Delta
    let mut direct = lag().model.lft;
    direct.d[(0, 0)] = 1.0;
    assert!(singular(Model::new(direct, 0.1, Some(good()))));
    let mut through = lag().model.lft;
    through.d[(0, 1)] = 1.0;
    let system = ClosedLoop::new(Model::new(through, 0.1, Some(good())).unwrap(), 1).unwrap();
    assert!(singular(system.simulate(&[0.7], &[1.0])));
}

/// `x' = command - x + w_2`, read as `x + w_1`, `w_1 = theta command`; w_2 is a nonlinear block without strength.
fn nonlinear() -> Lft {
    let (a, b) = (DMatrix::from_element(1, 1, -1.0), DMatrix::from_row_slice(1, 3, &[1.0, 0.0, 1.0]));
    let c = DMatrix::from_row_slice(3, 1, &[1.0, 0.0, 1.0]);
    let d = DMatrix::from_row_slice(3, 3, &[0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let law = Law::Polynomial { inputs: 1, exponents: vec![[2, 0]] };
    let block = Block::new(law, vec![Coefficient::Constant(0.0)]).unwrap();
    let gain = Gain { parameter: 0, scale: 1.0, power: 1 };
    Lft::with_blocks(a, b, c, d, vec![gain], vec![block]).unwrap()
}

/// A command that no displacement follows yet, but would with another value of a free parameter.
#[test]
fn a_free_gain_from_command_to_displacement() {
    let zeros = DMatrix::<f64>::zeros;
    let (a, b, c, d) = (zeros(0, 0), zeros(0, 1), zeros(1, 0), DMatrix::from_element(1, 1, 0.1));
    let controller = Controller { delay: 0.5, ..Controller::new(a, b, c, d) };
    let system = ClosedLoop::new(Model::new(nonlinear(), 0.1, Some(controller)).unwrap(), 1).unwrap();
    assert!(system.simulate(&[0.0], &[1.0, 1.0]).is_ok());
    assert!(singular(system.sensitivity(&[0.0], &[0], &[1.0, 1.0])));
    assert!(singular(system.simulate(&[0.1], &[1.0, 1.0])));
}

/// A delay that is a parameter has bounds of its own.
#[test]
fn a_delay_out_of_reach() {
    let (a, b) = (DMatrix::from_element(1, 1, -1.0), DMatrix::from_element(1, 1, 1.0));
    let (c, d) = (b.clone(), DMatrix::zeros(1, 1));
    let lft = Lft::new(a, b, c, d, vec![]).unwrap();
    let empty = DMatrix::<f64>::zeros;
    let (a, b, c, d) = (empty(0, 0), empty(0, 1), empty(1, 0), empty(1, 1));
    let controller = Controller { delay: 0.5, late: Some(0), ..Controller::new(a, b, c, d) };
    let system = ClosedLoop::new(Model::new(lft, 0.1, Some(controller)).unwrap(), 1).unwrap();
    assert!(system.simulate(&[0.0], &[1.0]).is_ok());
    assert!(system.simulate(&[-0.05], &[1.0]).is_ok());
    assert!(singular(system.simulate(&[-0.06], &[1.0])));
    assert!(singular(system.simulate(&[1e9], &[1.0])));
    assert!(singular(Stepper::new(&system, &[1e300]).map(|_| ())));
}

/// A controller without channels leaves all inputs to the plant.
#[test]
fn a_controller_of_nothing() {
    let zeros = DMatrix::<f64>::zeros;
    let nothing = Controller::new(zeros(0, 0), zeros(0, 0), zeros(0, 0), zeros(0, 0));
    let controller = Controller { delay: 0.5, steps: 2, ..nothing };
    let system = |controller| ClosedLoop::new(Model::new(nonlinear(), 0.1, controller).unwrap(), 1).unwrap();
    let (idle, analog) = (system(Some(controller)), system(None));
    assert_eq!(idle.sensitivity(&[0.3], &[0], &[1.0, 2.0]), analog.sensitivity(&[0.3], &[0], &[1.0, 2.0]));
    let (mut y, mut expected) = ([0.0], [0.0]);
    Stepper::new(&idle, &[0.3]).unwrap().step(&[1.0], &mut y).unwrap();
    Stepper::new(&analog, &[0.3]).unwrap().step(&[1.0], &mut expected).unwrap();
    assert_eq!(y, expected);
}

/// Loops without states, inputs, outputs or samples answer with what is left.
#[test]
fn empty_loops() {
    let empty = |n: usize, inputs: usize, outputs: usize| {
        let d = DMatrix::from_element(outputs, inputs, 2.0);
        let lft = Lft::new(-DMatrix::identity(n, n), DMatrix::zeros(n, inputs), DMatrix::zeros(outputs, n), d, vec![]);
        ClosedLoop::new(Model::new(lft.unwrap(), 0.1, None).unwrap(), 0).unwrap()
    };
    assert_eq!(empty(0, 1, 1).simulate(&[], &[1.0, 3.0]).unwrap(), [2.0, 6.0]);
    assert_eq!(empty(2, 0, 1).simulate(&[], &[]).unwrap(), []);
    assert_eq!(empty(2, 1, 0).simulate(&[], &[1.0]).unwrap(), []);
    assert_eq!(empty(2, 1, 1).simulate(&[], &[]).unwrap(), []);
    assert!(shape(empty(2, 0, 1).simulate(&[], &[1.0])));
    assert!(shape(Data::new(&empty(1, 1, 0), vec![], vec![], vec![], 0)));
}
