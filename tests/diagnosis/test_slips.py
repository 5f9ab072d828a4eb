"""Wrong gains in a rig file and a wrong scale of i_e are named, beside the physics; physics is not taken for them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ambid
from ambid.diagnosis import diagnose
from ambid.effects import channels, find, slips
from ambid.rig import StateSpaceController
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS, record
from tiers import first_fast

MACHINES = {"one axis": ONE_AXIS, "two bearings": BENCHES["bench"]}


ORDERS = {"one axis": 9, "two bearings": 7}
"""Of the PRBS."""


@cache
def nothing_hidden(machine, order=None):
    own = MACHINES[machine]
    i_e = ambid.prbs(order or ORDERS[machine], amplitude=1.0, hold=4, axes=len(own.rig.axes), periods=4)
    return measured(own.rig, i_e, {}, seed=1, **own.truth)


def with_gains(rig, **factors):
    changed = {key: factor * getattr(rig.controller, key) for key, factor in factors.items()}
    return rig.replace(controller=rig.controller.model_copy(update=changed))


def named(found):
    return {*found.effects, *(name for names in found.ambiguous_sets for name in names)}


def values(found):
    return {p.name: p.value for p in found.model.parameters}


@pytest.mark.parametrize(
    ("machine", "channel", "samples"),
    first_fast(
        [
            ("one axis", "y", 0.3),
            ("one axis", "i_e", -1.0),
            ("one axis", "y", -7.3),
            ("two bearings", "y", 3.2),
            ("two bearings", "i_e", -3.0),
        ]
    ),
)
def test_a_channel_that_is_recorded_late_is_named(machine, channel, samples):
    own = MACHINES[machine]
    clean = nothing_hidden(machine)
    late = {"y": {"y": samples}, "i_e": {"y": -samples, "i_c": -samples}}[channel]
    moved = {name: shifted(getattr(clean, name), late.get(name, 0.0)) for name in ("y", "i_c")}
    record = replace(clean, **moved)
    found = diagnose(own.rig, record)
    assert (found.verdict, found.effects) == ("explained", ("channel_delay",)), found
    (effect,) = found.model.effects
    assert effect.signal == channel
    assert values(found)["channel_delay.delay"] == pytest.approx(samples / own.rig.sample_rate, rel=0.01)
    assert values(found)["K_i.A_zeta"] == pytest.approx(own.K_i[0], rel=0.01)
    (wrong,) = [finding for finding in found.findings if finding.code == "channel_late"]
    assert wrong.where.channel == channel


def with_column(signal, k, factor):
    return signal * np.where(np.arange(signal.shape[1]) == k, factor, 1.0)


def exchanged(signal, a, b):
    order = np.arange(signal.shape[1])
    order[[a, b]] = b, a
    return signal[:, order]


# channels that a record holds wrongly: settings of the effect, how, and the gain that is found
WRONG = {
    "y turned": ("channel_sign", {"channel": "y"}, {"y": lambda x: -x}),
    "i_c turned": ("channel_sign", {"channel": "i_c"}, {"i_c": lambda x: -x}),
    "i_e turned": ("channel_sign", {"channel": "i_e"}, {"i_e": lambda x: -x}),
    "y scaled": ("channel_gain", {"channel": "y"}, {"y": lambda x: 1.3 * x}),
    "y in mm": ("channel_gain", {"channel": "y"}, {"y": lambda x: 1e3 * x}),
    "i_c scaled": ("channel_gain", {"channel": "i_c"}, {"i_c": lambda x: 0.8 * x}),
}
OF_ONE_AXIS = {
    "one y turned": ("channel_sign", {"channel": "y.B_zeta"}, {"y": lambda x: with_column(x, 2, -1.0)}),
    "one i_e turned": ("channel_sign", {"channel": "i_e.A_zeta"}, {"i_e": lambda x: with_column(x, 0, -1.0)}),
    "one y scaled": ("channel_gain", {"channel": "y.B_zeta"}, {"y": lambda x: with_column(x, 2, 1.1)}),
    "one i_e scaled": ("channel_gain", {"channel": "i_e.A_eta"}, {"i_e": lambda x: with_column(x, 1, 0.7)}),
    "y exchanged": (
        "channels_exchanged",
        {"signal": "y", "first": "A_eta", "second": "B_zeta"},
        {"y": lambda x: exchanged(x, 1, 2)},
    ),
    "i_c exchanged": (
        "channels_exchanged",
        {"signal": "i_c", "first": "A_zeta", "second": "A_eta"},
        {"i_c": lambda x: exchanged(x, 0, 1)},
    ),
    "i_e exchanged": (
        "channels_exchanged",
        {"signal": "i_e", "first": "A_eta", "second": "B_eta"},
        {"i_e": lambda x: exchanged(x, 1, 3)},
    ),
}


@pytest.mark.parametrize(
    ("machine", "case"),
    first_fast(
        [
            ("one axis", "y turned"),
            ("one axis", "i_c scaled"),
            *(("one axis", case) for case in WRONG if case not in ("y turned", "i_c scaled")),
            *(("two bearings", case) for case in [*OF_ONE_AXIS][::8]),
        ]
    ),
)
def test_a_channel_that_is_recorded_wrongly_is_named_and_mended(machine, case):
    """Whatever the base model makes of it: a sign is no gain, and an exchange no pile of cross couplings."""
    own, clean = MACHINES[machine], nothing_hidden(machine)
    name, settings, makes = (WRONG | OF_ONE_AXIS)[case]
    record = replace(clean, **{signal: make(getattr(clean, signal)) for signal, make in makes.items()})
    found = diagnose(own.rig, record)
    assert (found.verdict, found.effects) == ("explained", (name,)), found
    (effect,) = found.model.effects
    assert effect == find(name, settings)
    assert found.to_json()["probabilities"][name] > 0.9
    assert values(found)["K_i.A_zeta"] == pytest.approx(own.K_i[0], rel=0.01)
    (wrong,) = found.findings
    assert wrong.where.channel.split(".")[0] in makes
    mended = effect.mended(record, {p.name: values(found)[effect.slot(p.name)] for p in effect.parameters(own.rig)})
    for signal in makes:
        assert getattr(mended, signal) == pytest.approx(getattr(clean, signal), rel=2e-3)
    assert diagnose(own.rig, mended).verdict == "adequate"


def shifted(signal, samples):
    """Of whole periods, turned in phase: exact for whole samples, and for y, which is smooth."""
    lines = np.fft.rfftfreq(len(signal))
    return np.fft.irfft(
        np.fft.rfft(signal, axis=0) * np.exp(-2j * np.pi * lines * samples)[:, None], len(signal), axis=0
    )


@pytest.mark.parametrize(
    ("machine", "gain", "factor"),
    first_fast(
        [("one axis", "proportional", 0.7), ("one axis", "derivative", 1.4), ("two bearings", "proportional", 1.4)]
    ),
)
def test_a_wrong_gain_of_the_rig_file_is_named(machine, gain, factor):
    rig = MACHINES[machine].rig
    found = diagnose(with_gains(rig, **{gain: factor}), nothing_hidden(machine))
    assert found.verdict == "explained", found
    assert found.effects == ("controller_gain_error",)
    assert found.history[0].ranking.candidates[0].effect.name == "controller_gain_error"
    assert values(found)[f"controller_gain_error.{gain}"] == pytest.approx(1.0 / factor - 1.0, rel=0.01)
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.05)
    own = getattr(rig.controller, gain)
    (wrong,) = found.findings  # gains that are right are not reported
    assert (wrong.code, wrong.where.key) == ("controller_gain_wrong", f"controller.{gain}")
    assert wrong.values["in_file"] == pytest.approx([factor * own])
    assert wrong.values["by_data"] == pytest.approx([own], rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "factor"), [("integral", 0.9), ("proportional", 1.2), ("derivative", 0.9)])
def test_a_gain_that_is_off_by_less(gain, factor):
    found = diagnose(with_gains(ONE_AXIS.rig, **{gain: factor}), nothing_hidden("one axis"))
    assert found.effects == ("controller_gain_error",), found
    assert values(found)[f"controller_gain_error.{gain}"] == pytest.approx(1.0 / factor - 1.0, rel=0.02)


def test_a_controller_given_by_its_matrices():
    rig = ONE_AXIS.rig
    A, B, C, D = rig.controller.state_space(1, rig.sample_rate)
    wrong = StateSpaceController(implementation="analog", A=A, B=B, C=1.2 * C, D=1.2 * D)
    found = diagnose(rig.replace(controller=wrong), nothing_hidden("one axis"))
    assert found.effects == ("controller_gain_error",), found
    assert found.findings[0].code == "controller_wrong"
    assert found.findings[0].values["factor"] == pytest.approx(1.0 / 1.2, rel=2e-4)


@pytest.mark.slow
def test_a_digital_controller_at_twice_the_rate():
    digital = {"implementation": "digital", "delay_samples": 1.0, "sample_rate": 2e4}
    rig = ONE_AXIS.rig.replace(controller=ONE_AXIS.rig.controller.model_copy(update=digital))
    right = measured(rig, ONE_AXIS.excitation(1.0), {}, seed=1, **ONE_AXIS.truth)
    found = diagnose(with_gains(rig, derivative=0.7), right)
    assert found.effects == ("controller_gain_error",), found
    assert found.findings[0].where.key == "controller.derivative"
    assert found.findings[0].values == {"in_file": [pytest.approx(31.5)], "by_data": [pytest.approx(45.0, rel=0.01)]}


@pytest.mark.slow
def test_a_slip_beside_physics_and_both_slips_at_once():
    rig = with_gains(ONE_AXIS.rig, derivative=0.8)
    found = diagnose(rig, record({"loop_delay": {"seconds": 5e-5}}, 1))
    assert {"controller_gain_error", "loop_delay"} <= named(found), found
    right = nothing_hidden("one axis")
    found = diagnose(rig, replace(right, i_e=1.2 * right.i_e))
    assert set(found.effects) == {"controller_gain_error", "excitation_gain_error"}, found
    assert {own.code for own in found.findings} == {"controller_gain_wrong", "excitation_scale_wrong"}


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "factor"), [("one axis", 0.8), ("two bearings", 1.25)])
def test_a_wrong_scale_of_the_excitation_is_named(machine, factor):
    right = nothing_hidden(machine)
    found = diagnose(MACHINES[machine].rig, replace(right, i_e=factor * right.i_e))
    assert found.effects == ("excitation_gain_error",), found
    assert values(found)["excitation_gain_error.scale"] == pytest.approx(1.0 / factor - 1.0, rel=0.01)
    assert found.findings[0].code == "excitation_scale_wrong"
    assert found.findings[0].values["factor"] == pytest.approx(1.0 / factor, rel=0.01)


@pytest.mark.slow
def test_without_i_c_the_two_slips_are_one():
    """A common factor on the controller and its inverse on all K_i are a scale of i_e, as far as y goes."""
    right = nothing_hidden("two bearings", 9)
    few = [*slips.EFFECTS, *channels.EFFECTS, find("sensor_gain_error"), find("loop_delay")]
    found = diagnose(BENCHES["bench"].rig, replace(right, i_e=1.25 * right.i_e, i_c=None), catalogue=few)
    assert "excitation_gain_error" in named(found), found  # which has fewer parameters
    assert "controller_gain_error" in found.families["excitation_gain_error"].members


@pytest.mark.parametrize(
    "hidden",
    first_fast(
        [
            {"back_emf": {"coefficient": 10.0}},
            {"sensor_lag": {"tau": 3e-5}, "loop_delay": {"seconds": 5e-5}},
            {"amplifier_voltage_limit": {"slew": 4e3}},
        ]
    ),
    ids=lambda hidden: " and ".join(hidden),
)
def test_physics_that_looks_like_wrong_gains_is_named(hidden):
    found = diagnose(ONE_AXIS.rig, record(hidden, 1))
    assert set(hidden) <= named(found), found


@pytest.mark.slow
def test_a_slew_limit_at_a_short_hold_passes_the_gate():
    i_e = ambid.prbs(9, amplitude=1.0, hold=2, periods=4)
    hidden = {"amplifier_voltage_limit": {"slew": 4e3}}
    found = diagnose(ONE_AXIS.rig, measured(ONE_AXIS.rig, i_e, hidden, seed=1, **ONE_AXIS.truth))
    assert "amplifier_voltage_limit" in named(found), found
