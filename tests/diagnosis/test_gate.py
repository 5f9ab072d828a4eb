"""Records that a diagnosis must not trust: refused or flagged in words, never mis-diagnosed with confidence."""

from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.checking import check
from ambid.diagnosis import diagnose
from ambid.diagnosis.messages import not_determined
from ambid.effects import channels, find, slips
from ambid.errors import RecordError
from hidden.bench import simulate
from hidden.families import BENCHES
from tiers import first_fast

TRUTH = BENCHES["bench"].truth


@pytest.fixture(scope="module")
def measured(rig):
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=4, periods=4)
    return simulate(rig, i_e, {}, seed=1, **TRUTH)


def loaded(rig, measured, **changed):
    signals = {"y": measured.y, "i_e": measured.i_e, "i_c": measured.i_c} | changed
    return ambid.Record.from_arrays(**signals, sample_rate=rig.sample_rate, axes=rig.axes, rig=rig)


def refusal(rig, record):
    found = diagnose(rig, record)
    assert found.verdict == "not_informative", found
    assert found.effects == ()
    assert found.to_json()["verdict"] == "not_informative"
    return {own.code for own in found.findings}


def test_sound_records_pass(rig, measured):
    assert diagnose(rig, loaded(rig, measured)).verdict == "adequate"


def test_too_few_periods(rig, measured):
    short = 511 * 4
    record = loaded(rig, measured, y=measured.y[:short], i_e=measured.i_e[:short], i_c=measured.i_c[:short])
    assert "one_period" in refusal(rig, replace(record, period=short))


@pytest.mark.slow
def test_controller_of_another_day_is_no_refusal(rig, measured):
    other = with_proportional(rig, 1.3)
    few = [*slips.EFFECTS, *channels.EFFECTS, find("loop_delay"), find("sensor_gain_error")]
    assert diagnose(other, loaded(other, measured), catalogue=few).effects == ("controller_gain_error",)


@pytest.mark.slow
def test_excitation_of_another_record(rig, measured):
    """Another seed of a maximum-length sequence is the same sequence, shifted by more than any card is late."""
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=4, periods=4, seed=77)
    found = diagnose(rig, loaded(rig, measured, i_e=i_e), catalogue=[channels.ExcitationGainError()])
    assert (found.verdict, found.effects) == ("none_of_the_candidates", ()), found
    assert "excitation_shifted" in {own.code for own in found.findings}


def test_displacement_in_micrometres(rig, measured):
    with pytest.raises(RecordError, match="y"):
        loaded(rig, measured, y=1e6 * measured.y)


def test_no_excitation(rig, measured):
    with pytest.raises(RecordError, match="i_e"):
        loaded(rig, measured, i_e=np.zeros_like(measured.i_e))


def test_clipped_channel_is_flagged(rig, measured):
    limit = 0.5 * np.abs(measured.y[:, 0]).max()
    y = measured.y.copy()
    y[:, 0] = np.clip(y[:, 0], -limit, limit)
    with pytest.raises(RecordError, match="clip"):
        loaded(rig, measured, y=y)


def turned(seed):
    """Sensors that are turned against their magnets, and an integral of which a short record tells nothing."""
    own = replace(BENCHES["compressor"], order=7, periods=4)
    slow = own.rig.replace(controller=own.rig.controller.model_copy(update={"integral": 3e4}))
    hidden = {"sensor_misalignment": {"degrees": [0.9, -0.5]}}
    i_e = own.excitation(own.amplitude, seed)
    return slow, simulate(slow, i_e, hidden, seed=seed, period=own.period, **own.truth, **own.noise)


@pytest.mark.parametrize("seed", first_fast(range(3)))
def test_sensors_that_are_turned_are_no_wrong_integral(seed):
    rig, record = turned(seed)
    assert not [found for found in check(rig, record).findings if found.where.record]
    (wrong,) = check(with_proportional(rig, 1.3), record).errors
    assert (wrong.code, set(wrong.values["factors"])) == ("gains_differ", {"proportional"})


def with_proportional(rig, factor):
    gain = factor * np.asarray(rig.controller.proportional)
    return rig.replace(controller=rig.controller.model_copy(update={"proportional": gain}))


@pytest.mark.slow
def test_they_pass_the_gate_and_are_named():
    few = [find(name) for name in ("sensor_misalignment", "controller_gain_error", "sensor_gain_error", "seal_forces")]
    found = diagnose(*turned(0), catalogue=few)
    assert (found.verdict, found.effects) == ("explained", ("sensor_misalignment",)), found


def test_what_is_not_determined_is_named_by_its_direction(golden):
    directions = [{"K_i.A_zeta": 1.0, "K_s.A_zeta": 0.97}, {"tau_e": 1.0}]
    found = list(not_determined(directions, 10.0))
    assert [own.code for own in found] == ["not_determined", "not_determined", "single_frequency"]
    assert [own.values["changes_percent"] for own in found[:2]] == directions
    golden.holds("\n".join(own.line() for own in found))
