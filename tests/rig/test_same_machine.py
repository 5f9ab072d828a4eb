"""One machine said in other words: rotors by matrices and modes, controllers by matrices and polynomials."""

import control
import numpy as np
import pytest
from scipy.linalg import matrix_balance
from scipy.signal import cont2discrete, tf2ss

import ambid
from ambid.rig import MatrixRotor, ModalRotor, PidController, Rig, StateSpaceController, TransferFunctionController
from ambid.rotor import assemble, reduced_rotor
from places import BENCH


@pytest.fixture(scope="module")
def rig(request):
    rig = Rig.load(BENCH)
    return rig.replace(actuator={"time_constant": 2.5e-4})


@pytest.fixture(scope="module")
def i_e():
    return ambid.prbs(7, amplitude=1.0, hold=3, axes=4)


def places(rig: Rig) -> list[float]:
    return [z for bearing in rig.bearings for z in (bearing.position, bearing.sensor_position)]


def assert_same(one: Rig, other: Rig, i_e, tolerance: float) -> None:
    a, b = (ambid.Model(Rig.from_toml(rig.to_toml())).simulate(i_e) for rig in (one, other))
    for x, y in ((a.y, b.y), (a.i_c, b.i_c)):
        np.testing.assert_allclose(x, y, atol=tolerance * np.abs(y).max())


def test_rotor_by_its_matrices(rig, i_e):
    turning = rig.replace(speed=500.0)
    spec = turning.rotor
    model = assemble(spec, places(rig))
    matrices = MatrixRotor(
        flexible_modes=spec.flexible_modes,
        modal_damping=spec.modal_damping,
        bending_frequencies_hz=spec.bending_frequencies_hz,
        node_positions=model.z.tolist(),
        M=model.M.tolist(),
        K=model.K.tolist(),
        G=model.G.tolist(),
    )
    assert_same(turning.replace(rotor=matrices), turning, i_e, 1e-6)


def test_rotor_by_its_modes(rig, i_e):
    found = reduced_rotor(rig.rotor, places(rig))
    modes = ModalRotor(
        frequencies_hz=(found.frequencies_rad_s / (2.0 * np.pi)).tolist(),
        damping=found.damping.tolist(),
        positions=found.positions.tolist(),
        shapes=found.shapes.T.tolist(),
    )
    assert_same(rig.replace(rotor=modes), rig, i_e, 1e-9)


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_controller_by_its_matrices_and_polynomials(rig, i_e, implementation):
    given = rig.controller.model_dump(exclude_none=True) | {"implementation": implementation}
    pid = rig.replace(controller=PidController(**given))
    a, b, c, d = (m.tolist() for m in pid.controller.state_space(4, rig.sample_rate))
    matrices = StateSpaceController(implementation=implementation, A=a, B=b, C=c, D=d)
    assert_same(rig.replace(controller=matrices), pid, i_e, 1e-9)
    one = control.ss(*pid.controller.state_space(1, rig.sample_rate))
    numerator, denominator = control.tfdata(control.ss2tf(one))
    polynomials = TransferFunctionController(
        implementation=implementation,
        numerator=np.ravel(numerator[0][0]).tolist(),
        denominator=np.ravel(denominator[0][0]).tolist(),
    )
    assert_same(rig.replace(controller=polynomials), pid, i_e, 1e-6)


@pytest.mark.filterwarnings("ignore:An ill-conditioned matrix")  # what makes the matrices what they are here
@pytest.mark.parametrize("rate", [2e4, 4e4])
def test_controller_by_matrices_as_scipy_makes_them(rig, rate):
    """A PID with roll-off by `tf2ss` and `cont2discrete` has states of very unlike size; the loop is the same."""
    pid, corner = rig.controller, 2.0 * np.pi * 8e3
    lag = pid.derivative_time_constant
    numerator = [pid.proportional * lag + pid.derivative, pid.proportional + pid.integral * lag, pid.integral]
    denominator = np.polymul([lag, 1.0, 0.0], [corner**-2.0, 1.4 / corner, 1.0])
    a, b, c, d = tf2ss(numerator, denominator)
    balanced, scale = matrix_balance(a, permute=False)
    i_e = ambid.prbs(8, amplitude=0.1, axes=4)
    machines = []
    for system in ((a, b, c, d), (balanced, np.linalg.solve(scale, b), c @ scale, d)):
        sampled = cont2discrete(system, 1.0 / rate, method="bilinear")[:4]
        matrices = {key: np.kron(np.eye(4), m).tolist() for key, m in zip("ABCD", sampled, strict=True)}
        controller = StateSpaceController(implementation="digital", sample_rate=rate, delay_samples=0.5, **matrices)
        machines.append(rig.replace(controller=controller))
    unlike = [np.abs(machine.controller.A).max() for machine in machines]
    assert unlike[0] > 1e6 * unlike[1]
    assert [ambid.Model(machine).is_stable for machine in machines] == [True, True]
    assert ambid.check(machines[0]).is_sound
    assert_same(*machines, i_e, 1e-9)
