"""Diagnoses of frequency responses: alone, from files, beside records, and made from half of a record."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import FrequencyResponse, Model, Record, diagnose, localise, rank
from ambid.effects import find
from ambid.noise import compare
from ambid.report import write_report
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS, record
from hidden.sizes import sized
from tiers import first_fast

RIG = ONE_AXIS.rig
FURTHER = ("amplifier_bandwidth", "foundation_resonance", "back_emf", "sampling_skew")
F = np.geomspace(5.0, 0.4 * RIG.sample_rate, 250)


def measured(effect=None, values=None, seed=0, share=0.005):
    """What an analyser would measure of the rig, with an effect hidden."""
    model = Model(RIG) if effect is None else Model(RIG).add(effect, values)
    loop = model.loop
    h = loop.transfer(model.theta, np.exp(2j * np.pi * F * loop.sample_time))[:, :, :1]
    std = share * np.abs(h) + 1e-3 * np.abs(h).max(axis=0)
    random = np.random.default_rng(seed).standard_normal((2, *h.shape))
    noisy = h + std * (random[0] + 1j * random[1]) / np.sqrt(2.0)
    return FrequencyResponse("frf", F, noisy, std, loop.outputs, ("i_e.A_zeta",))


def half(own: Record) -> Record:
    """The first whole periods of a record."""
    length = own.periods // 2 * own.period
    return own.rows(0, length)


def named(found):
    return {*found.effects, *(name for names in found.ambiguous_sets for name in names)}


@pytest.fixture(scope="module")
def late():
    """A diagnosis of responses alone."""
    late, other = (measured("loop_delay", {"delay": 5e-5}, seed) for seed in (0, 1))
    return diagnose(RIG, late, validate=[other])


@pytest.mark.slow
def test_a_report_of_responses_alone_is_written(late, tmp_path):
    path = write_report(late, tmp_path / "report.html")
    assert "<code>y.A_zeta, i_c.A_zeta</code>" in path.read_text(encoding="utf-8")


def test_a_hidden_effect_is_named_from_responses_alone(late):
    found = late
    assert found.verdict in ("explained", "ambiguous"), found
    assert "loop_delay" in named(found)
    assert found.history[0].misfit > 2.0
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.15)
    assert found.history[-1].validation_misfit < 1.2
    assert "response_of_small_motion" in {own.code for own in found.findings}
    shown = found.to_json()
    assert {"verdict", "effects", "where", "parameters", "misfit", "not_tried"} <= set(shown)
    assert shown["where"]


@pytest.mark.parametrize("seed", first_fast(range(3)))
def test_nothing_hidden_is_adequate(seed):
    found = diagnose(RIG, measured(seed=seed))
    assert found.verdict == "adequate", found


def test_what_a_response_cannot_show_is_not_tried():
    comparison = compare(Model(RIG), measured())
    why = {own.values["effect"]: own.code for own in rank(comparison).findings}
    for effect in ("force_nonlinearity", "flux_saturation", "magnetic_hysteresis"):
        assert why[effect] == "effect_of_large_motion"
    assert why["periodic_disturbance"] == "effect_not_in_responses"


def test_where_a_response_is_missed():
    """The reading of the current is late by a sample fraction: the misfit is mapped, and no drift or tone is sought."""
    where = localise(compare(Model(RIG), measured("sampling_skew", {"current_late": 2e-5})))
    assert where.maps[0].channels == ("y.A_zeta", "i_c.A_zeta")
    assert where.maps[0].edges_hz[0] == pytest.approx(F[0])
    assert np.nanmax(where.maps[0].misfit) > 2.0
    assert (where.tones, where.change, where.growth) == ((), None, ())
    assert {port.name for port in where.ports} == {"force", "current", "sensor", "reading"}
    assert where.findings


@pytest.mark.parametrize("effect", first_fast(["loop_delay", *FURTHER], 0))
def test_half_of_a_record_as_a_response_names_what_the_record_does(effect):
    own = record({effect: NAMED[effect]}, 1)
    in_time, response = diagnose(RIG, own), diagnose(RIG, half(own).frequency_response())
    assert named(response) & named(in_time), (response, in_time)
    values, others = in_time.parameters, response.parameters
    for name in ("K_i.A_zeta", "K_s.A_zeta", "tau_e"):
        if in_time.effects == response.effects:
            apart = abs(values[name].value - others[name].value)
            assert apart < 3.5 * np.hypot(values[name].std_error, others[name].std_error), name


@pytest.mark.slow
def test_the_misfit_of_a_right_model_scatters_more_than_that_of_a_record():
    """Of this one J/dof is 1.043, as of one in sixty responses: three standard deviations of a record's in time."""
    bench = BENCHES["bench"]
    hidden, i_e = {"loop_delay": sized("loop_delay", "clear").parameters}, replace(bench, periods=6)
    own = simulate(
        bench.rig, i_e.excitation(bench.amplitude, 7), hidden, period=bench.period, seed=7, **bench.truth, **bench.noise
    )
    found = diagnose(bench.rig, own.rows(0, 3 * bench.period).frequency_response())
    assert found.history[-1].misfit > 1.04
    assert ("loop_delay" in found.effects) or any("loop_delay" in names for names in found.ambiguous_sets), found


@pytest.mark.slow
def test_responses_and_records_are_diagnosed_together():
    own = record({"loop_delay": NAMED["loop_delay"]}, 1)
    found = diagnose(RIG, [own, half(record({"loop_delay": NAMED["loop_delay"]}, 2)).frequency_response()])
    assert "loop_delay" in named(found), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.15)


def test_beside_a_record_a_nonlinear_effect_is_named():
    """The record shows it; the response, at rest, does not contradict."""
    own = record({"force_nonlinearity": NAMED["force_nonlinearity"]}, 1)
    few = [find("force_nonlinearity"), find("loop_delay"), find("sensor_lag")]
    found = diagnose(RIG, [own, measured()], catalogue=few)
    assert found.history[0].ranking.find("force_nonlinearity") is not None
