"""One sine gives two numbers a channel: not which effect is missing. Two and three show it."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Record, diagnose, identify
from ambid.effects import find
from reference.levitator import Levitator, pid, pid_matrices
from tiers import first_fast
from virtual import VirtualBench

RATE, GAINS, SAMPLES, TAU = 1000.0, (300.0, 900.0, 12.0), 4000, 0.005
TRUTH = {"K_i.A_zeta": 1.3, "K_s.A_zeta": 95.0}


def levitator(frequencies_hz, driven: str, *, off: float = 0.05, size: float = 5e-5, samples: int = SAMPLES, **physics):
    """Sines of whole periods, as the reference [m], or as i_e, 400 A for each metre."""
    machine = Levitator(0.06, *TRUTH.values(), TAU, **physics)
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    law = {"kind": "state_space", "implementation": "digital", "reference": driven == "r"}
    rig = machine.rig(RATE, law | matrices, off=off)
    t, still = np.arange(samples) / RATE, np.zeros(samples)
    wave = (
        size
        * (400.0 if driven == "i_e" else 1.0)
        * sum(np.sin(2.0 * np.pi * f * t + k) for k, f in enumerate(frequencies_hz))
    )
    r, i_e = (wave, still) if driven == "r" else (still, wave)
    found = machine.run(RATE, pid(*GAINS, RATE), r, i_e, noise=(1e-7, 1e-4), seed=1)
    own = {"y": found["y"], "i_c": found["i_c"], driven: wave[:, None]}
    return rig, Record.from_arrays(**own, sample_rate=RATE, axes=rig.axes, rig=rig)


@pytest.mark.parametrize("driven", first_fast(["r", "i_e"]))
@pytest.mark.parametrize("frequency", first_fast([10.0, 40.0]))
def test_one_sine_names_the_misfit_and_the_direction_but_no_effect(frequency, driven):
    found = diagnose(*levitator([frequency], driven, back_emf=2.0))
    assert (found.verdict, found.effects) == ("not_informative", ())
    misfit, direction, single = found.findings
    assert (misfit.code, direction.code) == ("misfit_above_limit", "not_determined")
    assert misfit.values["misfit"] > 100.0
    assert direction.values["changes_percent"]["K_s.A_zeta"] == pytest.approx(1.0)
    assert (single.code, single.values["frequency_hz"]) == ("single_frequency", pytest.approx(frequency))


def test_one_sine_of_the_right_model_names_the_direction():
    rig, begun = levitator([10.0], "i_e", samples=2 * SAMPLES)
    record = begun.rows(SAMPLES, 2 * SAMPLES)  # how it began from rest, which shows more, is over
    found = diagnose(rig, record)
    assert found.verdict == "not_informative"
    direction, single = found.findings
    assert direction.values["changes_percent"] == {
        "K_i.A_zeta": pytest.approx(0.26, abs=0.005),
        "K_s.A_zeta": pytest.approx(1.0),
    }
    assert single.code == "single_frequency"
    assert identify(rig, record).next_step.code == "next_excite_more"


@pytest.mark.parametrize("driven", ["i_e", "r"])
def test_a_parameter_that_is_fixed_lacks_nothing(driven):
    rig, record = levitator([10.0], driven, off=0.0)
    known = identify(rig, record, fixed=["K_s"])
    assert (known.status, known.directions) == ("converged", [])
    assert abs(known.parameters["K_i.A_zeta"].value - 1.3) < 4.0 * known.parameters["K_i.A_zeta"].std_error


@pytest.mark.parametrize("driven", first_fast(["i_e", "r"]))
@pytest.mark.parametrize("frequencies", [[10.0, 40.0], pytest.param([10.0, 25.0, 40.0], marks=pytest.mark.slow)])
def test_more_sines_tell_both(frequencies, driven):
    assert diagnose(*levitator(frequencies, driven)).verdict == "adequate"
    found = diagnose(*levitator(frequencies, driven, back_emf=2.0))
    assert found.effects == ("back_emf",)
    for name, value in TRUTH.items():
        assert abs(found.parameters[name].value - value) < 4.0 * found.parameters[name].std_error


@pytest.mark.slow
def test_harmonics_of_one_sine_tell_a_curved_force():
    """A pair of magnets far out: what one sine leaves at three times its frequency is not of two numbers a channel."""
    rig, record = levitator([10.0], "r", size=2e-3, samples=1200, gap=1.3 * 0.9 / 95.0, bias=0.9)
    few = [find("force_nonlinearity"), find("back_emf"), find("sensor_lag")]
    found = diagnose(rig, record, catalogue=few)
    assert found.verdict != "not_informative"
    assert found.where[0].band_hz[1] > 25.0 or "force_nonlinearity" in found.effects


BENCH = VirtualBench()


def bench_record(frequencies_hz, bench: VirtualBench) -> Record:
    """All axes driven at the same frequencies, in other phases."""
    t = np.arange(4000) / bench.sample_rate
    phases = np.random.default_rng(2).uniform(0.0, 6.0, (4, len(frequencies_hz)))
    waves = [[np.sin(2.0 * np.pi * f * t + p) for f, p in zip(frequencies_hz, own, strict=True)] for own in phases]
    i_e = 0.2 * np.sum(waves, axis=1).T
    return bench.records(i_e, [3], period=400)[0]


@pytest.mark.slow
def test_one_sine_on_four_axes_determines_what_is_known_of_and_tells_no_effect():
    """Forces that reach an axis from the others turn current against displacement: 16 numbers for nine parameters."""
    rig = BENCH.rig(0.05)
    right = diagnose(rig, bench_record([75.0], BENCH))
    assert right.verdict == "adequate"
    for name, value in BENCH.truth.items():
        assert abs(right.parameters[name].value - value) < 4.0 * right.parameters[name].std_error
    wrong = diagnose(rig, bench_record([75.0], replace(BENCH, tau_a=2.0 * BENCH.tau_a)))
    assert (wrong.verdict, wrong.effects) == ("not_informative", ())
    codes = [own.code for own in wrong.findings]
    assert (codes[0], codes[-1]) == ("misfit_above_limit", "single_frequency")
    assert wrong.findings[-1].values["frequency_hz"] == pytest.approx(75.0)


@pytest.mark.parametrize(("lag", "verdicts"), first_fast([(2.0, {"explained", "ambiguous"}), (1.0, {"adequate"})], 0))
def test_three_sines_on_four_axes(lag, verdicts):
    found = diagnose(BENCH.rig(0.05), bench_record([75.0, 225.0, 450.0], replace(BENCH, tau_a=lag * BENCH.tau_a)))
    assert found.verdict in verdicts
    assert "single_frequency" not in {own.code for own in found.findings}
