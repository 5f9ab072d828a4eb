"""The model: simulation against independent physics, values and structure, and its file."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ambid.errors import ModelError, RigError, UnstableLoopError
from ambid.identification import identify
from ambid.model import Model, Parameter
from ambid.rig import Rig
from validated import of_peak
from virtual import AXES, NAMES, VirtualBench


@pytest.fixture
def model(bench):
    return Model(bench.rig())


@pytest.mark.parametrize("tilt", [0.0, 30.0, -110.0])
def test_simulation_follows_independent_physics(tilt, i_e, validated):
    bench = VirtualBench(tilt=tilt)
    record = Model(bench.rig()).simulate(i_e[:1500])
    expected = bench.respond(i_e[:1500])[:, :, 0]
    found = np.hstack([record.y, record.i_c])
    validated(
        "Response of four axes with a bending mode: error relative to the peak",
        "centre of mass, tilt and mode by matrix exponential (SciPy {scipy})",
        of_peak(found, expected),
        1e-9,
    )
    assert record.axes == AXES
    assert record.sample_rate == bench.sample_rate
    assert_array_equal(record.i_e, i_e[:1500])


def test_sensor_noise_goes_round_the_loop_as_in_independent_physics(bench, model, i_e):
    """The same noise through both: the package draws the displacements' first, then the currents'."""
    quiet = np.zeros_like(i_e)
    record = model.virtual_experiment(quiet, sensor_noise=1e-7, current_noise=0.0, seed=5)
    noise = 1e-7 * np.random.default_rng(5).standard_normal(i_e.shape)
    expected = bench.respond(quiet, noise[:, :, None])[:, :, 0]
    assert_allclose(np.hstack([record.y, record.i_c]), expected, atol=1e-9 * np.abs(expected).max())


def test_virtual_experiments_repeat_with_their_seed(model, i_e):
    one, same, other = (model.virtual_experiment(i_e, seed=seed) for seed in (1, 1, 2))
    assert_array_equal(one.y, same.y)
    assert_array_equal(one.i_c, same.i_c)
    assert np.abs(one.y - other.y).std() > 0.0


@pytest.mark.parametrize(("name", "value"), [("sensor_noise", -1.0), ("current_noise", np.inf), ("seed", -1)])
def test_wrong_noise(model, i_e, name, value, golden):
    with golden.raises(ModelError):
        model.virtual_experiment(i_e, **{name: value})


def test_one_sample_at_a_time_is_the_same(model, i_e):
    record, simulator = model.simulate(i_e[:300]), model.simulator()
    steps = np.array([simulator.step(u) for u in i_e[:300]])
    expected = np.hstack([record.y, record.i_c])
    assert_allclose(steps, expected, atol=1e-10 * np.abs(expected).max())


def test_poles_are_those_of_independent_physics(bench, model):
    expected = np.linalg.eigvals(bench.continuous()[0])
    found = model.poles()
    assert found.shape == (28,)
    assert max(np.abs(expected - pole).min() / abs(pole) for pole in found) < 1e-8
    assert np.all(np.diff(found.real) <= 1e-9)
    assert model.is_stable


def test_a_loop_that_is_too_slow_is_unstable(model, i_e):
    slow = model.with_values({"tau_e": 2e-3})
    assert not slow.is_stable
    with pytest.raises(UnstableLoopError):
        slow.simulate(i_e)


def test_nominal_values_are_the_rigs(bench, model):
    assert model.names == NAMES
    assert_allclose(model.theta, list(bench.truth.values()), rtol=1e-15)
    assert [p.unit for p in model.parameters] == ["N/A"] * 4 + ["N/m"] * 4 + ["s"]


def test_changes_make_new_models(model):
    theta = model.theta
    other = model.with_values({"K_i.A_eta": 100.0, "tau_e": 1e-4})
    assert other.theta[1] == 100.0
    assert other.theta[8] == 1e-4
    theta[0] = 0.0
    assert model.theta[0] == 190.0
    assert_array_equal(model.theta[2:8], other.theta[2:8])


def test_nonlinear_effects_are_left_out_and_linear_ones_stay(model):
    both = model.add("loop_delay", {"delay": 2e-5}).add("force_nonlinearity")
    linear = both.without_nonlinear()
    assert [effect.name for effect in linear.effects] == ["loop_delay"]
    assert linear.is_linear
    assert not both.is_linear
    assert linear.without_nonlinear().names == linear.names


def test_shared_values_start_from_their_mean(model, i_e):
    shared = model.share("K_i.A", ["K_i.A_*"])
    assert shared.names == ("K_i.A", *NAMES[2:])
    assert shared.theta[0] == 197.5
    same = model.with_values({"K_i.A_zeta": 197.5, "K_i.A_eta": 197.5})
    assert_allclose(shared.simulate(i_e).y, same.simulate(i_e).y, rtol=1e-12, atol=1e-18)


def test_split_values_start_from_the_shared_one(model, i_e, golden):
    split = model.per_axis("tau_e")
    assert split.names == (*NAMES[:8], *(f"tau_e.{axis}" for axis in AXES))
    assert_allclose(split.simulate(i_e).y, model.simulate(i_e).y, rtol=1e-9, atol=1e-15)
    assert model.share("K_i", ["K_i"]).share("K_s", ["K_s"]).per_axis("K_*").names == NAMES
    with golden.raises(ModelError):
        split.per_axis("tau_e")


@pytest.mark.parametrize(
    ("patterns", "chosen"),
    [
        (["K_i"], [0, 1, 2, 3]),
        (["K_?.B_zeta"], [2, 6]),
        (["tau_e", "K_s.A_eta"], [5, 8]),
        (["*"], list(range(9))),
    ],
)
def test_patterns_select_parameters(model, patterns, chosen):
    assert model.index(patterns) == chosen


WRONG_CHANGES = {
    "unknown": lambda m: m.with_values({"K_x": 1.0}),
    "out of range": lambda m: m.with_values({"tau_e": 0.0}),
    "NaN": lambda m: m.with_values({"tau_e": np.nan}),
    "units": lambda m: m.share("K", ["K_i.A_zeta", "tau_e"]),
    "name": lambda m: m.share("tau_e", ["K_i.A_*"]),
    "without a value": lambda m: Model(m.rig, m.parameters[:8]),
    "twice": lambda m: Model(m.rig, [*m.parameters, m.parameters[0]]),
    "another rig's": lambda m: Model(m.rig, [*m.parameters, Parameter("c", 1.0, "s", ("c",))]),
}


@pytest.mark.parametrize("name", WRONG_CHANGES)
def test_wrong_changes(model, name, golden):
    with golden.raises(ModelError):
        WRONG_CHANGES[name](model)


def test_repr_names_rig_values_and_units(model, golden):
    golden.holds(str(model))


@pytest.mark.parametrize(
    "structure",
    [
        lambda m: m,
        lambda m: m.per_axis("tau_e"),
        lambda m: m.share("K_i.A", ["K_i.A_*"]).with_values({"K_i.A": 1.0 / 3.0 * 600.0}),
    ],
    ids=["plain", "per axis", "shared"],
)
def test_a_saved_model_is_the_same(model, structure, tmp_path, i_e):
    saved = structure(model)
    saved.save(tmp_path / "model.json")
    loaded = Model.load(tmp_path / "model.json")
    assert loaded.parameters == saved.parameters
    assert loaded.rig == saved.rig
    assert_array_equal(loaded.simulate(i_e).y, saved.simulate(i_e).y)


def test_an_estimate_is_saved_with_its_covariance(model, run, tmp_path):
    estimate = identify(model, run, free=["tau_e", "K_i.A_*"])
    estimate.save(tmp_path / "model.json")
    content = json.loads((tmp_path / "model.json").read_text())
    matrix = np.array(content["covariance"], dtype=float)
    free = [0, 1, 8]
    assert_array_equal(matrix[np.ix_(free, free)], estimate.covariance)
    assert np.isnan(matrix).sum() == 81 - 9
    assert content["effects"] == []
    assert_array_equal(Model.load(tmp_path / "model.json").theta, estimate.model.theta)


def test_another_rig_may_take_the_place_of_the_stored_one(model, tmp_path):
    model.save(tmp_path / "model.json")
    other = model.rig.replace(name="another day")
    assert Model.load(tmp_path / "model.json", other).rig.name == "another day"


def test_a_rig_of_other_axes_is_refused(model, demo_rig, tmp_path, golden):
    model.save(tmp_path / "model.json")
    renamed = Rig.from_toml(demo_rig.to_toml().replace('name = "B"', 'name = "C"'))
    with golden.raises(ModelError):
        Model.load(tmp_path / "model.json", renamed)


BROKEN_FILES = {
    "cut": lambda text: text[:-40],
    "a list": lambda text: "[]",
    "version": lambda text: text.replace("ambid model 1", "ambid model 9"),
    "no parameters": lambda text: text.replace('"parameters"', '"values"'),
    "no unit": lambda text: text.replace('"unit"', '"units"'),
    "key": lambda text: text.replace("air_gap", "air_gpa"),
    "range": lambda text: text.replace('"value": 0.00022', '"value": -1'),
    "text": lambda text: text.replace('"value": 0.00022', '"value": "long"'),
    "twice": lambda text: text.replace('"tau_e.A_eta"', '"tau_e.A_zeta"'),
}


@pytest.mark.parametrize("name", BROKEN_FILES)
def test_broken_files(model, tmp_path, name, golden):
    path = tmp_path / "model.json"
    model.save(path)
    text = path.read_text()
    path.write_text(BROKEN_FILES[name](text))
    assert path.read_text() != text
    with golden.raises(ModelError, RigError):
        Model.load(path)


def test_a_file_that_is_not_there(tmp_path, golden):
    with golden.raises(ModelError):
        Model.load(tmp_path / "model.json")
