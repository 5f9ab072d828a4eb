"""Models out to SciPy, python-control and MATLAB; controllers from there, rotors from ROSS."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.io
import scipy.signal
from numpy.testing import assert_allclose

from ambid import check, interop
from ambid.errors import InputError, ModelError, RigError
from ambid.excitation import prbs
from ambid.interop import controller_from, controller_from_mat, rotor_from_ross, to_control, to_mat, to_scipy
from ambid.model import Model
from ambid.rig import FiniteElementRotor, PidController, Rig, StateSpaceController
from ambid.rotor import assemble, reduced_rotor
from places import BENCH as BENCH_FILE
from validated import of_peak

RIG = Rig.load(BENCH_FILE)
PLACES = [z for bearing in RIG.bearings for z in (bearing.position, bearing.sensor_position)]
I_E = prbs(7, amplitude=0.2, hold=3, axes=4)


def rig(implementation):
    pid = RIG.controller.model_dump(exclude_none=True) | {"implementation": implementation}
    if implementation == "digital":
        pid["delay_samples"] = 0.3
    return RIG.replace(controller=PidController(**pid), actuator={"time_constant": 2.5e-4}, speed=300.0)


@pytest.fixture(params=["analog", "digital"])
def model(request):
    """With linear effects, so that effects are exported too."""
    return Model(rig(request.param)).add("sensor_lag", {"time_constant": 1e-5}).add("loop_delay", {"delay": 5e-6})


def assert_same(outputs, model):
    record = model.simulate(I_E)
    for found, expected in ((outputs[:, :4], record.y), (outputs[:, 4:], record.i_c)):
        assert_allclose(found, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_to_scipy(model):
    system = to_scipy(model)
    assert isinstance(system, scipy.signal.StateSpace)
    assert system.dt == 1e-4
    assert (system.input_names, system.output_names) == (model.loop.inputs, model.loop.outputs)
    assert_same(scipy.signal.dlsim(system, I_E)[1], model)


def test_to_control(model, validated):
    control = pytest.importorskip("control")
    system = to_control(model)
    assert system.dt == 1e-4
    assert system.input_labels == ["i_e_A_zeta", "i_e_A_eta", "i_e_B_zeta", "i_e_B_eta"]
    assert system.output_labels[4:] == ["i_c_A_zeta", "i_c_A_eta", "i_c_B_zeta", "i_c_B_eta"]
    outputs, record = control.forced_response(system, U=I_E.T).outputs.T, model.simulate(I_E)
    validated(
        "Exported loop, analog and digital, with effects: error relative to the peak",
        "response by python-control {control}",
        of_peak(outputs, np.hstack([record.y, record.i_c])),
        1e-10,
    )


def test_control_is_optional(monkeypatch, golden):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(interop.importlib, "import_module", missing)
    with golden.raises(InputError):
        to_control(Model(RIG))


def test_to_mat_closed_loop(model, tmp_path):
    to_mat(model, tmp_path / "model.mat")
    content = scipy.io.loadmat(tmp_path / "model.mat", squeeze_me=True)
    system = scipy.signal.StateSpace(*(content[key] for key in "ABCD"), dt=content["dt"])
    assert_same(scipy.signal.dlsim(system, I_E)[1], model)
    assert tuple(content["inputs"]) == model.loop.inputs
    assert tuple(content["outputs"]) == model.loop.outputs
    assert tuple(content["inputs_plant"]) == tuple(f"i_ref.{axis}" for axis in RIG.axes)
    assert content["parameters"]["K_s_B_eta"] == model.parameters[7].value
    assert content["parameters"]["sensor_lag_time_constant"] == 1e-5


@pytest.mark.parametrize("effect", [("sensor_lag", "time_constant"), ("loop_delay", "delay")])
def test_to_mat_plant(tmp_path, effect):
    """Closed around the exported plant, the controller gives the poles of the loop."""
    name, parameter = effect
    model = Model(rig("analog")).add(name, {parameter: 1e-5})
    to_mat(model, tmp_path / "model.mat")
    content = scipy.io.loadmat(tmp_path / "model.mat")
    a, b, c, d = (content[f"{key}_plant"] for key in "ABCD")
    assert not d.any()
    assert tuple(name.item() for name in content["outputs_plant"].ravel()) == model.loop.outputs
    assert tuple(name.item() for name in content["inputs_plant"].ravel()) == tuple(f"i_ref.{axis}" for axis in RIG.axes)
    a_k, b_k, c_k, d_k = RIG.controller.state_space(4, RIG.sample_rate)
    y = c[:4]
    closed = np.block([[a - b @ d_k @ y, -b @ c_k], [b_k @ y, a_k]])
    poles = np.linalg.eigvals(closed)
    for pole in model.poles():
        assert np.abs(poles - pole).min() < 1e-6 * abs(pole)
    unstable = np.linalg.eigvals(a).real.max()
    assert unstable > 10.0, "without its controller the rotor falls"


def test_suffix_of_mat(tmp_path, golden):
    with golden.raises(ModelError):
        to_mat(Model(RIG), tmp_path / "model.m")


@pytest.mark.parametrize("export", [to_scipy, to_control, lambda model: to_mat(model, "model.mat")])
def test_what_is_not_linear_is_refused(export, golden):
    model = Model(RIG).add("force_nonlinearity")
    with golden.raises(ModelError):
        export(model)
    assert to_scipy(model.without("force_nonlinearity")).dt == 1e-4


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_controller_round_trip(implementation, tmp_path):
    here = rig(implementation)
    a, b, c, d = here.controller.state_space(4, here.sample_rate)
    dt = 0.0 if implementation == "analog" else 1e-4
    delay = here.controller.delay_samples
    scipy.io.savemat(tmp_path / "K.mat", {"A": a, "B": b, "C": c, "D": d, "dt": dt})
    in_time = {"dt": dt} if dt else {}
    for controller in (
        controller_from_mat(tmp_path / "K.mat", delay),
        controller_from(scipy.signal.StateSpace(a, b, c, d, **in_time), delay),
    ):
        assert isinstance(controller, StateSpaceController)
        assert_same(_outputs(Model(here.replace(controller=controller))), Model(here))


def _outputs(model):
    record = model.simulate(I_E)
    return np.hstack([record.y, record.i_c])


def test_controller_gain_alone(tmp_path):
    scipy.io.savemat(
        tmp_path / "K.mat", {"A": np.zeros((0, 0)), "B": np.zeros((0, 1)), "C": np.zeros((1, 0)), "D": 3e4}
    )
    assert controller_from_mat(tmp_path / "K.mat").D == ((3e4,),)


CONTROLLERS = {
    "no D": {"A": 1.0, "B": 1.0, "C": 1.0, "other": 2.0},
    "dt": {"A": 1.0, "B": 1.0, "C": 1.0, "D": 1.0, "dt": -1.0},
    "shape": {"A": np.eye(2), "B": 1.0, "C": 1.0, "D": 1.0},
}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controllers_that_are_refused(name, tmp_path, golden):
    path = tmp_path / "K.mat"
    scipy.io.savemat(path, CONTROLLERS[name])
    with golden.raises(RigError):
        controller_from_mat(path)


def test_controller_files_that_cannot_be_read(tmp_path, golden):
    with golden.raises(RigError):
        controller_from_mat(tmp_path / "none.mat")
    (tmp_path / "K.mat").write_bytes(np.random.default_rng(0).bytes(500))
    with golden.raises(RigError):
        controller_from_mat(tmp_path / "K.mat")


@dataclass(frozen=True)
class LikeRoss:
    """What of a ross.Rotor is read; `test_rotor_of_ross_itself` has the real one."""

    mass: np.ndarray
    stiffness: np.ndarray
    gyroscopic: np.ndarray
    nodes_pos: list[float]
    damping: np.ndarray | None = None
    bearing_elements: tuple = ()

    def C(self, frequency):
        """Damping matrix at a frequency."""
        return np.zeros_like(self.mass) if self.damping is None else self.damping

    def M(self, frequency=None):
        """Mass matrix."""
        return self.mass

    def K(self, frequency):
        """Stiffness matrix at a frequency."""
        return self.stiffness

    def G(self):
        """Gyroscopic matrix."""
        return self.gyroscopic


def like_ross(freedoms, stiffness=0.0, links=0):
    """A rotor of our finite elements as Ross has it; K may hold bearings."""
    beam = assemble(RIG.rotor, PLACES)
    nodes = len(beam.z)
    kept = (freedoms * np.arange(nodes)[:, None] + {4: [0, 1, 2, 3], 6: [0, 1, 3, 4]}[freedoms]).ravel()
    size = freedoms * (nodes + links)

    def spread(matrix, others):
        full = others * np.eye(size)
        full[np.ix_(kept, kept)] = matrix
        return full

    held = beam.K.copy()
    held[0, 0] += stiffness
    return LikeRoss(spread(beam.M, 1.0), spread(held, 1e8), spread(beam.G, 0.0), list(beam.z))


@pytest.mark.parametrize("freedoms", [4, 6])
def test_rotor_from_ross(freedoms):
    spec = RIG.rotor
    rotor = rotor_from_ross(
        like_ross(freedoms),
        flexible_modes=spec.flexible_modes,
        modal_damping=spec.modal_damping,
        bending_frequencies_hz=spec.bending_frequencies_hz,
    )
    assert_same(_outputs(Model(rig("analog").replace(rotor=rotor))), Model(rig("analog")))


def test_rotor_of_ross_itself():
    """A real ross.Rotor against our finite elements on the same shaft, one element a section."""
    ross = pytest.importorskip("ross")
    material = {"density": 7850.0, "youngs_modulus": 2.06e11, "poisson_ratio": 0.3}
    steel = ross.Material(name="steel", rho=7850.0, E=2.06e11, Poisson=0.3)
    shaft = [ross.ShaftElement(L=0.05, idl=0.0, odl=0.06, material=steel) for _ in range(16)]
    disk = ross.DiskElement(n=6, m=5.0, Id=0.01, Ip=0.018)
    ours = RIG.rotor.model_validate(
        {
            "flexible_modes": 2,
            "material": material,
            "section": [{"length": 0.8, "outer_diameter": 0.06}],
            "disk": [{"position": 0.3, "mass": 5.0, "transverse_inertia": 0.01, "polar_inertia": 0.018}],
        }
    )
    theirs = rotor_from_ross(ross.Rotor(shaft, [disk]), flexible_modes=2)
    one, other = (reduced_rotor(rotor, [0.0, 0.3, 0.8]) for rotor in (theirs, ours))
    assert_allclose(one.frequencies_rad_s, other.frequencies_rad_s, rtol=5e-3, atol=1e-3)
    assert_allclose(one.gyroscopic, other.gyroscopic, atol=5e-3 * np.abs(other.gyroscopic).max())


@dataclass(frozen=True)
class BearingLikeRoss:
    """What of a bearing element of ROSS is read."""

    n: int
    stiffness: tuple
    damping: tuple = ((0.0, 0.0), (0.0, 0.0))
    mass: float = 0.0
    kxx: tuple = (0.0,)
    tag: str = "Brg"

    def M(self, frequency):
        """Mass matrix."""
        return np.diag([self.mass, self.mass, 0.0])

    def K(self, frequency):
        """Stiffness matrix at a frequency."""
        return np.pad(self.stiffness, (0, 1))

    def C(self, frequency):
        """Damping matrix at a frequency."""
        return np.pad(self.damping, (0, 1))


def held_like_ross(bearings, alpha=0.0, beta=0.0, uneven=0.0):
    """A rotor of our finite elements as ROSS has it, with bearings, and damping in proportion to M and K."""
    free = like_ross(6)
    stiffness, mass = free.stiffness.copy(), free.mass.copy()
    damping = alpha * free.mass + beta * free.stiffness
    damping[0, 0] += uneven
    for own in bearings:
        places = np.ix_(*[6 * own.n + np.array([0, 1, 2])] * 2)
        for matrix, part in ((mass, own.M(0.0)), (stiffness, own.K(0.0)), (damping, own.C(0.0))):
            matrix[places] += part
    return LikeRoss(mass, stiffness, free.gyroscopic, free.nodes_pos, damping, tuple(bearings))


PLAIN = BearingLikeRoss(3, ((2e5, 0.0), (0.0, 2e5)), ((30.0, 0.0), (0.0, 30.0)))


def test_damping_and_plain_bearings_of_ross_are_taken_over():
    """As supports, a rate of the whole rotor, and the ratio beta w / 2 of each mode."""
    taken = rotor_from_ross(held_like_ross([PLAIN], alpha=2.5, beta=1e-6), flexible_modes=2)
    plain = rotor_from_ross(like_ross(6), flexible_modes=2)
    assert not taken.findings
    assert taken.mass_damping == pytest.approx(2.5, rel=1e-9)
    (support,) = taken.support
    assert (support.position, support.stiffness, support.damping) == (plain.node_positions[3], 2e5, 30.0)
    w = reduced_rotor(plain, []).frequencies_rad_s[2:]
    assert_allclose(taken.modal_damping, 1e-6 * w / 2.0, rtol=1e-6)
    assert_allclose(taken.K, plain.K, atol=1e-6 * np.abs(plain.K).max())
    assert rotor_from_ross(held_like_ross([], beta=1e-6), flexible_modes=2, modal_damping=0.01).modal_damping == 0.01


LEFT_OUT = {
    "not alike": BearingLikeRoss(3, ((2e5, 0.0), (0.0, 1e5))),
    "cross-coupling": BearingLikeRoss(3, ((2e5, 3e4), (-3e4, 2e5))),
    "inertia": BearingLikeRoss(3, PLAIN.stiffness, mass=2.0),
    "frequency": BearingLikeRoss(3, PLAIN.stiffness, kxx=(2e5, 3e5)),
    "negative damping": BearingLikeRoss(3, PLAIN.stiffness, ((-3.0, 0.0), (0.0, -3.0))),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_what_is_left_out_of_ross_is_a_finding(name, golden):
    rotor = rotor_from_ross(held_like_ross([LEFT_OUT[name]]), flexible_modes=2)
    assert not rotor.support
    plain = rotor_from_ross(like_ross(6), flexible_modes=2)
    assert_allclose(rotor.M, plain.M, atol=1e-12 * np.abs(plain.M).max())
    assert_allclose(rotor.K, plain.K, atol=1e-12 * np.abs(plain.K).max())
    (finding,) = rotor.findings
    assert finding.code == "ross_bearing_left_out"
    golden.holds(finding.line())
    assert finding in check(RIG.replace(rotor=rotor)).findings


def test_damping_of_ross_that_no_mode_has_is_taken_over():
    """A damper that acts on one plane at one end, beside damping in proportion to the mass: all of C."""
    theirs = held_like_ross([], alpha=2.5, uneven=50.0)
    rotor = rotor_from_ross(theirs, flexible_modes=2)
    assert not rotor.findings
    ours = reduced_rotor(rotor, [])
    n, w = len(ours.frequencies_rad_s), np.tile(ours.frequencies_rad_s, 2)
    ends = np.zeros((8, 8))
    ends[:n, :n] = 50.0 * np.outer(ours.shape(0.0), ours.shape(0.0))
    found = np.diag(2.0 * np.tile(ours.damping, 2) * w + ours.mass_damping) + ours.coupling(0.0)
    assert_allclose(found, 2.5 * np.eye(2 * n) + ends, atol=1e-9 * np.abs(ends).max())
    slowest = Model(rig("analog").replace(rotor=rotor)).poles().real.max()
    undamped = Model(rig("analog").replace(rotor=rotor_from_ross(like_ross(6), flexible_modes=2))).poles().real.max()
    assert slowest != pytest.approx(undamped, rel=1e-3)


def test_a_damped_and_held_cone_of_ross_itself():
    """Poles on springs without magnets: our cones on their supports against a ross.Rotor that was taken over."""
    ross = pytest.importorskip("ross")
    steel = ross.Material(name="steel", rho=7850.0, E=2.06e11, Poisson=0.3)
    ends = np.linspace(0.08, 0.05, 33)
    shaft = [
        ross.ShaftElement(L=0.025, idl=0.0, odl=a, idr=0.0, odr=b, material=steel, alpha=3.0)
        for a, b in zip(ends[:-1], ends[1:], strict=True)
    ]
    plain, seal = (ross.BearingElement(n=n, kxx=3e5, kyy=k, cxx=40.0) for n, k in ((8, 3e5), (16, 4e5)))
    bearings = [plain, seal]
    theirs = rotor_from_ross(ross.Rotor(shaft, [], bearings), flexible_modes=2)
    (finding,) = theirs.findings
    assert finding.code == "ross_bearing_left_out"
    (support,) = theirs.support
    assert (support.position, support.stiffness, support.damping) == (pytest.approx(0.2), 3e5, 40.0)
    assert theirs.mass_damping == pytest.approx(3.0, rel=1e-9)
    section = {"length": 0.8, "outer_diameter": 0.08, "outer_diameter_end": 0.05}
    material = {"density": 7850.0, "youngs_modulus": 2.06e11, "poisson_ratio": 0.3}
    ours = FiniteElementRotor(flexible_modes=2, material=material, section=[section])
    one, other = (reduced_rotor(rotor, [0.0, 0.2, 0.8]) for rotor in (theirs, ours))
    assert_allclose(one.frequencies_rad_s, other.frequencies_rad_s, rtol=1e-3, atol=1e-3)
    assert_allclose([one.shape(z) for z in (0.0, 0.2, 0.8)], [other.shape(z) for z in (0.0, 0.2, 0.8)], rtol=1e-3)


ROTORS = {
    "another object": object,
    "with bearings": lambda: like_ross(6, stiffness=1e4),
    "with links": lambda: like_ross(6, links=1),
}


@pytest.mark.parametrize("name", ROTORS)
def test_rotors_that_are_refused(name, golden):
    with golden.raises(RigError):
        rotor_from_ross(ROTORS[name]())


@pytest.mark.parametrize("keys", [{}, {"smooth": True}, {"dt": 1e-4}])
def test_a_frequency_response_is_no_controller(keys, golden):
    control = pytest.importorskip("control")
    response = control.frd(np.array([1.0, 0.5 - 0.5j, -0.5j]), np.array([1.0, 10.0, 100.0]), **keys)
    with golden.raises(RigError):
        controller_from(response)


def test_what_makes_no_state_space_says_why(golden):
    class Other:
        def to_ss(self):
            raise ArithmeticError("improper")

    with golden.raises(RigError):
        controller_from(Other())
