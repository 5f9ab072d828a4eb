"""Records of one machine at several speeds and bias currents, fitted and diagnosed together."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import ambid
from ambid.diagnosis import diagnose
from ambid.errors import ModelError, RecordError
from ambid.model import Model
from ambid.rig import Rig
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

HIGHER = 1.5
"""Bias current of the other point over that of the rig file."""
TRUTH = BENCHES["bench"].truth
TAU_E = TRUTH["tau_e"]


def truth_at_higher(truth: dict) -> dict:
    """K_i and K_s grow with the bias current, tau_e does not."""
    return truth | {"K_i": 1.45 * truth["K_i"], "K_s": 2.1 * truth["K_s"]}


def higher(rig: Rig) -> Rig:
    """The same machine at a higher bias current, its controller tuned for it."""
    bearings = [
        b.model_copy(
            update={
                "bias_current": HIGHER * b.bias_current,
                "force_current": tuple(1.4 * k for k in b.force_current),
                "force_displacement": tuple(2.0 * k for k in b.force_displacement),
            }
        )
        for b in rig.bearings
    ]
    controller = rig.controller.model_copy(update={"proportional": 1.3 * rig.controller.proportional})
    return rig.replace(name="higher bias", bearings=tuple(bearings), controller=controller)


@pytest.fixture(scope="module")
def i_e():
    return ambid.prbs(9, amplitude=1.0, hold=4, axes=4, periods=4)


def at_both(rig, i_e, hidden, seed=1):
    point = higher(rig)
    other = measured(point, i_e, hidden, seed=seed + 1, **truth_at_higher(TRUTH)).at(point)
    return [measured(rig, i_e, hidden, seed=seed, **TRUTH), other]


@pytest.mark.slow
def test_every_bias_current_has_its_own_gains_and_all_share_tau_e(rig, i_e):
    both = at_both(rig, i_e, {})
    estimate = ambid.identify(rig, both)
    truth = {"tau_e": TAU_E}
    end = f"@{HIGHER * rig.bearings[0].bias_current:g}A"
    for here, suffix in ((TRUTH, ""), (truth_at_higher(TRUTH), end)):
        truth |= {
            f"{kind}.{axis}{suffix}": value
            for kind in ("K_i", "K_s")
            for axis, value in zip(rig.axes, here[kind], strict=True)
        }
    assert set(estimate.parameters) == set(truth)
    errors = [
        (estimate.parameters[name].value - value) / estimate.parameters[name].std_error for name, value in truth.items()
    ]
    assert np.abs(errors).max() < 4.0
    single = ambid.identify(rig, both[0])
    assert estimate.parameters["tau_e"].std_error < single.parameters["tau_e"].std_error
    comparison = ambid.compare(estimate.model, both)
    assert [r.misfit for r in comparison.records] == pytest.approx([1.0, 1.0], abs=0.06)


@pytest.mark.parametrize("effect", ["flux_saturation", "force_nonlinearity", "eddy_currents"])
def test_the_joint_model_at_a_point_is_the_model_of_that_point(rig, i_e, effect):
    point = higher(rig)
    both = [Model(rig).simulate(i_e), Model(point).simulate(i_e).at(point)]
    values = {"flux_saturation": {"level": 0.6, "sharpness": 2.5}}.get(effect, {})
    joint = Model(rig).covering(both).add(effect, values)
    alone = Model(point).add(effect, values | ({"level": 0.6 * HIGHER} if effect == "flux_saturation" else {}))
    assert_allclose(joint.response(both[1]), alone.loop.simulate(alone.theta, i_e), rtol=1e-9, atol=1e-15)
    here = Model(rig).add(effect, values)
    assert_allclose(joint.response(both[0]), here.loop.simulate(here.theta, i_e), rtol=1e-9, atol=1e-15)


def test_derivative_by_a_parameter_that_points_share(rig, i_e):
    point = higher(rig)
    both = [Model(rig).simulate(i_e), Model(point).simulate(i_e).at(point)]
    joint = Model(rig).covering(both).add("flux_saturation", {"level": 0.6}).with_substeps(4)
    k, step = joint.names.index("flux_saturation.level"), 1e-5
    _, slopes = joint.sensitivity(both[1], [k, 0])
    ends = [joint.with_values({"flux_saturation.level": 0.6 + sign * step}).response(both[1]) for sign in (1, -1)]
    difference = (ends[0] - ends[1]) / (2.0 * step)
    assert_allclose(slopes[..., 0], difference, atol=1e-5 * np.abs(difference).max())
    assert not slopes[..., 1].any()  # K_i of the other bias current


@pytest.mark.slow
def test_a_second_bias_current_tells_saturation():
    """Small records at each bias alone are linear; the force law goes with the bias."""
    hidden = [{"flux_saturation": {"level": level}} for level in (0.55, 0.55 * HIGHER)]
    rig, point = ONE_AXIS.rig, higher(ONE_AXIS.rig)
    truth, truth_there = ONE_AXIS.truth, truth_at_higher(ONE_AXIS.truth)
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=1, periods=4)
    train = [
        measured(rig, i_e, hidden[0], seed=1, **truth),
        measured(point, i_e, hidden[1], seed=2, **truth_there).at(point),
    ]
    validate = [measured(point, 0.5 * i_e, hidden[1], seed=3, **truth_there).at(point)]
    found = diagnose(rig, train, validate=validate)
    assert found.effects == ("flux_saturation",)
    first, last = found.history[0], found.history[-1]
    assert last.misfit < 1.2 < 2.0 < first.misfit
    assert last.validation_misfit < 1.3
    assert found.model.at(point).rig == point


def test_a_joint_model_is_saved_with_its_points(rig, i_e, tmp_path):
    both = at_both(rig, i_e[:2000], {}, seed=1)
    joint = Model(rig).covering(both).add("loop_delay", {"delay": 3e-5})
    joint.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    assert again.names == joint.names
    for one in both:
        assert_allclose(again.response(one), joint.response(one), rtol=1e-12)


def test_what_does_not_belong_together_is_refused(rig, i_e, golden):
    point = higher(rig)
    other = Model(point).simulate(i_e).at(point)
    own = Model(rig).simulate(i_e)
    with golden.raises(ModelError):
        Model(rig).response(other)
    with golden.raises(ModelError):
        diagnose(rig, own, validate=[other])
    heavier = rig.replace(rotor=rig.rotor.model_copy(update={"modal_damping": 0.02}), speed=100.0)
    with golden.raises(ModelError):
        ambid.identify(rig, [own, own.at(heavier)])
    renamed = rig.replace(bearings=tuple(b.model_copy(update={"name": f"{b.name}2"}) for b in rig.bearings))
    with golden.raises(RecordError):
        own.at(renamed)


@pytest.mark.slow
def test_a_rig_file_among_the_records_opens_another_point(rig, i_e, command, tmp_path, golden):
    point = higher(rig)
    both = at_both(rig, i_e, {})
    for name, one in (("6A", rig), ("9A", point)):
        (tmp_path / f"{name}.toml").write_text(one.to_toml())
    for name, one in zip(("6A", "9A"), both, strict=True):
        one.save(tmp_path / f"{name}.csv")
    files = [tmp_path / name for name in ("6A.toml", "6A.csv", "9A.toml", "9A.csv")]
    result = command("identify", *files)
    assert result.code == 0, result.err
    assert "K_i.A_zeta@9A" in result.out
    result = command("identify", *files[:3])
    assert result.code == 2
    golden.holds(result.err)
