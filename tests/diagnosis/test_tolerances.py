"""Diagnoses of machines that are off from their rig files by ordinary tolerances: nothing is named for that."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import diagnose, identify, prbs
from ambid.diagnosis import rank
from ambid.effects import find
from ambid.identification.minimum import refit
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from hidden.tolerances import machine_off
from tiers import first_fast

FEW = [find(name) for name in ("loop_delay", "eddy_currents")]
HIDDEN = [None, "eddy_currents", "loop_delay"]
SIZES = {"eddy_currents": {"tau": 1.5e-5}, "loop_delay": {"seconds": 4e-5}}
QUIET = {"sensor_noise": 30e-9, "current_noise": 2e-3}


def diagnosed(own, seed, effect, i_e, period, sizes, noise, catalogue):
    """The verdict, its effects, and by how many standard errors every K_i and K_s is off."""
    machine = machine_off(own.rig, seed)
    record = machine.record(i_e, seed, {effect: sizes[effect]} if effect else None, **own.truth, **noise)
    found = diagnose(machine.known, replace(record, period=period), catalogue=catalogue)
    truth = {f"{k}.{axis}": v for k in ("K_i", "K_s") for axis, v in zip(own.rig.axes, own.truth[k], strict=True)}
    off = [(found.parameters[name].value - value) / found.parameters[name].std_error for name, value in truth.items()]
    return found, np.abs(off)


@pytest.mark.parametrize("effect", HIDDEN)
@pytest.mark.parametrize("seed", first_fast(range(3)))
def test_of_one_axis(seed, effect):
    i_e = prbs(7, amplitude=0.2, hold=3, periods=6, seed=seed)
    found, off = diagnosed(ONE_AXIS, seed, effect, i_e, 381, SIZES, QUIET, FEW)
    assert found.verdict == ("explained" if effect else "adequate"), found
    assert found.effects == ((effect,) if effect else ()), found
    assert (off < 4.0).all()


@pytest.mark.parametrize("seed", first_fast(range(4)))
def test_errors_of_the_rig_file_are_found_beside_an_effect_where_no_period_is_noted(seed):
    """The base model misses so much that it is fitted as if the rig file were exact; with the effect it need not be."""
    i_e = prbs(8, amplitude=0.2, hold=2, periods=8, seed=seed)
    sizes = {"loop_delay": {"seconds": 8e-5}}
    found, off = diagnosed(ONE_AXIS, seed, "loop_delay", i_e, None, sizes, QUIET, FEW[:1])
    assert found.effects == ("loop_delay",), found
    assert found.fit.misfit < 1.1
    assert (off < 4.0).all()


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "seed"), [(None, 0), ("seal_forces", 1)])
def test_of_four_axes(seed, effect):
    own = replace(BENCHES["small"], order=7)
    sizes = {"seal_forces": {"z": own.middle, "direct": 2e5, "cross": 1.5e5, "damping": 80.0}}
    few = [find(name) for name in ("seal_forces", "loop_delay", "sensor_position_error")]
    found, off = diagnosed(own, seed, effect, own.excitation(own.amplitude, seed), own.period, sizes, own.noise, few)
    assert found.verdict == ("explained" if effect else "adequate"), found
    assert found.effects == ((effect,) if effect else ()), found
    assert (off < 4.0).all()


def test_what_a_tolerance_does_too_has_the_score_that_a_refit_finds():
    """A sensor whose gain is off by ten tolerances: the effect takes what the prior costs, and nothing of the response.

    The record begins at rest: derivatives of J by tolerances hold that of its transient, changes by effects do not.
    """
    bench = BENCHES["bench"]
    off = machine_off(bench.rig, 1)
    first, *others = off.hidden["sensor_gain_error"]["gain"]
    i_e = prbs(8, amplitude=bench.amplitude, hold=4, axes=4, periods=4)
    worse = {"sensor_gain_error": {"gain": [first + 0.1, *others]}}
    train = off.record(i_e, 1, worse, period=1020, **bench.truth, **bench.noise)
    fit = identify(off.known, train).comparison
    candidate = rank(fit, [find("sensor_gain_error")]).candidates[0]
    end = refit(fit.of(fit.model.add(candidate.effect, candidate.start)))
    assert fit.cost - end.cost == pytest.approx(candidate.score, rel=0.1)
    assert candidate.score > 30.0
