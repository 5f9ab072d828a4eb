"""A rig file that is updated by errors of its values: without errors it responds as the old one with them."""

import tomllib

import numpy as np
import pytest

from ambid import Model, Rig, prbs
from ambid.effects.known import KNOWN
from ambid.loop.geometry import rotor_of
from ambid.rig import MatrixRotor, ModalRotor, StateSpaceController, TransferFunctionController
from ambid.rotor import assemble
from places import BENCH, LEVITATOR

OFFSET = 3e-5
"""Of a place [m], small enough that its square, which a first-order formula leaves, is nothing."""


def analog() -> Rig:
    """The bench as an analog machine of which nothing is exact."""
    rig = Rig.load(BENCH)
    controller = rig.controller.model_copy(update={"implementation": "analog", "delay_samples": 0.0})
    return rig.replace(controller=controller, tolerance={})


def computed() -> Rig:
    """The same whose bending frequencies are those of its finite elements."""
    rig = analog()
    return rig.replace(rotor=rig.rotor.model_copy(update={"bending_frequencies_hz": None}))


def by_modes() -> Rig:
    """The same by its modes, the rigid ones mixed."""
    rig = analog()
    found = rotor_of(rig)
    mix = np.eye(4)
    mix[:2, :2] = [[0.8, 0.6], [-0.6, 0.8]]
    rotor = ModalRotor(
        frequencies_hz=found.frequencies_rad_s / (2.0 * np.pi),
        damping=found.damping,
        positions=found.positions,
        shapes=mix @ found.shapes.T,
    )
    return rig.replace(rotor=rotor)


def by_matrices() -> Rig:
    """The same by the matrices of few elements."""
    rig = analog()
    places = [z for b in rig.bearings for z in (b.position, b.sensor_position)]
    coarse = rig.rotor.model_copy(update={"flexible_modes": 1, "bending_frequencies_hz": None})
    model = assemble(coarse, places)
    rotor = MatrixRotor(node_positions=model.z, M=model.M, K=model.K, G=model.G, flexible_modes=1, modal_damping=0.004)
    return rig.replace(rotor=rotor)


def levitator(**changes) -> Rig:
    return Rig.load(LEVITATOR).replace(tolerance={}, **changes)


def in_state_space() -> Rig:
    rig = Rig.load(LEVITATOR)
    a, b, c, d = rig.controller.state_space(1, rig.sample_rate)
    return levitator(controller=StateSpaceController(implementation="analog", A=a, B=b, C=c, D=d))


def by_polynomials() -> Rig:
    lead = {"numerator": [60.0, 15000.0], "denominator": [1e-4, 1.0]}
    return levitator(controller=TransferFunctionController(implementation="analog", **lead))


MACHINES = {
    own.__name__: own for own in (analog, computed, by_modes, by_matrices, levitator, in_state_space, by_polynomials)
}
WITHOUT_KEY = {"sensor_angle", "sensor_gain", "current_gain", "excitation_gain", "instant"}
SHAFT = {"mass", "inertia"}
"""Have no key in a rig file of sections and disks."""


def off(model: Model, seed: int = 1) -> Model:
    """The model with errors of half a tolerance or so; the same for every amplifier."""
    draw = np.random.default_rng(seed)
    errors = {p.name: 0.5 * p.prior * draw.uniform(-1.0, 1.0) for p in model.tolerances}
    errors |= {p.name: draw.uniform(-OFFSET, OFFSET) for p in model.tolerances if p.unit == "m"}
    return model.with_values({n: 0.02 if n.startswith("amplifier") else e for n, e in errors.items()})


def of_keys(model: Model, update) -> Model:
    """The model with those errors alone that keys hold."""
    return model.with_values({own.name: own.error if not own.why else 0.0 for own in update.values})


@pytest.mark.parametrize("machine", MACHINES)
def test_the_updated_rig_responds_as_the_old_one_with_errors(machine):
    rig = MACHINES[machine]()
    nominal = Model(rig).with_tolerances()
    update = off(nominal).updated_rig()
    left = {own.name.partition(".")[0] for own in update.values if own.why}
    assert left <= WITHOUT_KEY | SHAFT | {"position", "sensor_position"}
    assert left >= {own.name.partition(".")[0] for own in update.values} & WITHOUT_KEY
    assert bool(left & SHAFT) == (machine in ("analog", "computed"))
    assert ("position" in left) == (machine == "by_matrices")
    i_e = prbs(7, amplitude=0.1, hold=2, axes=len(rig.axes), periods=2)
    expected = of_keys(off(nominal), update).simulate(i_e).outputs
    found = Model(update.rig.exact()).simulate(i_e).outputs
    size = np.abs(expected).max(axis=0)
    assert np.abs((found - nominal.simulate(i_e).outputs) / size).max() > 1e-3
    np.testing.assert_allclose(found / size, expected / size, rtol=0.0, atol=1e-6)


def test_every_error_is_in_a_key_or_says_why_not():
    for effect in KNOWN:
        assert effect.no_key or effect.key in ("bending_frequency", "modal_damping", "controller_gain"), effect.key
    update = off(Model(analog()).with_tolerances()).updated_rig()
    assert [own.name for own in update.values] == [p.name for p in Model(analog()).with_tolerances().tolerances]
    assert {f.values["name"] for f in update.findings} == WITHOUT_KEY | SHAFT
    assert {f.code for f in update.findings} == {"rig_key_missing"}


def test_what_sets_amplifiers_apart_is_left_over():
    rig = analog()
    values = dict(zip((f"amplifier_time_constant.{axis}" for axis in rig.axes), (0.04, 0.0, 0.02, 0.02), strict=True))
    update = Model(rig).with_tolerances().with_values(values).updated_rig()
    assert update.rig.amplifier.time_constant == pytest.approx(1.02 * rig.amplifier.time_constant)
    own = {v.name: v for v in update.values if v.name in values}
    for name, error in values.items():
        assert 1.02 * (1.0 + own[name].left) == pytest.approx(1.0 + error)
        assert bool(own[name].why) == (error != 0.02)


def test_a_place_that_would_be_off_the_shaft_stays():
    rig = analog()
    ends = [b.model_copy(update={"sensor_position": 0.0}) if b.name == "A" else b for b in rig.bearings]
    rig = rig.replace(bearings=tuple(ends))
    model = Model(rig).with_tolerances().with_values({"sensor_position.A": -2e-4, "sensor_position.B": 1e-4})
    update = model.updated_rig()
    assert update.rig.bearings[0] == rig.bearings[0]
    assert update.rig.bearings[1].sensor_position == rig.bearings[1].sensor_position + 1e-4
    (own,) = (v for v in update.values if v.name == "sensor_position.A")
    assert own.left == own.error == -2e-4
    assert "shaft" in own.why


def test_it_is_as_well_known_as_it_was():
    rig = computed()
    update = Model(rig).with_tolerances().with_values({"bending_frequency.1": 0.003}).updated_rig()
    assert len(update.rig.rotor.bending_frequencies_hz) == 2
    assert update.rig.known_to("bending_frequency") == rig.known_to("bending_frequency") == 0.01
    assert update.rig.known_to("mass") == rig.known_to("mass")


def test_a_rig_without_errors_is_itself():
    rig = analog()
    assert Model(rig).with_tolerances().updated_rig().rig == rig
    assert Model(rig.exact()).updated_rig().values == ()


def test_the_file_reads_back_and_says_what_it_holds(tmp_path, golden):
    rig = analog()
    model = (
        Model(rig).with_tolerances().with_values({"sensor_position.A": 3e-4, "sensor_gain.A_zeta": 0.004, "mass": 1e-3})
    )
    model = model.with_covariance(np.diag([(0.1 * (p.prior or p.value)) ** 2 for p in model.parameters]))
    model.updated_rig().save(tmp_path / "new.toml")
    text = (tmp_path / "new.toml").read_text()
    assert Rig.load(tmp_path / "new.toml") == model.updated_rig().rig
    assert tomllib.loads(text)["bearing"][0]["sensor_position"] == rig.bearings[0].sensor_position + 3e-4
    golden.holds(text.partition("\nname =")[0])
