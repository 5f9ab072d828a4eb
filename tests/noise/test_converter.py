"""Rounding by converters: its step, and the part of its error that repeats with the signal."""

import numpy as np
import pytest

from ambid import diagnose, identify
from ambid.noise.measured import repeated_rounding
from ambid.record import Record
from ambid.record.rounding import step_of
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS, record
from tiers import first_fast


@pytest.mark.parametrize("step", [1e-8, 5e-8, 2e-7, 1e-6])
def test_the_step_is_found_behind_a_factor_and_an_offset(step):
    rng = np.random.default_rng(1)
    x = 1e-5 * np.sin(0.01 * np.arange(20_000)) + 5e-8 * rng.standard_normal(20_000)
    assert step_of(1.37 * step * np.rint(x / step) + 1e-7) == pytest.approx(1.37 * step)
    assert step_of(x) == 0.0


def test_the_step_is_that_of_all_changes_whatever_digits_were_written():
    walk = np.cumsum(np.random.default_rng(1).normal(0.0, 0.3, 5000))
    steps = 9.2e-4 * np.round(walk / 9.2e-4)
    assert step_of(steps) == pytest.approx(9.2e-4)
    assert step_of(np.array([float(f"{u:.9g}") for u in steps])) == pytest.approx(9.2e-4, rel=1e-4)
    assert step_of(walk) == 0.0


@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1, 0.2, 0.3, 0.6])
def test_the_part_that_repeats_is_what_two_periods_share(noise):
    """Against the covariance of the errors of two periods with the same signal and independent noise."""
    rng = np.random.default_rng(2)
    signal = 40.0 * np.sin(2.0 * np.pi * np.arange(200_000) / 1999.7)
    periods = [signal + noise * rng.standard_normal(len(signal)) for _ in range(2)]
    errors = [np.rint(x) - signal for x in periods]
    shared = float(np.mean(errors[0] * errors[1]))
    own = float(np.mean((errors[0] - errors[1]) ** 2)) / 2.0  # what unexcited lines would show
    assert repeated_rounding(np.rint(periods[0]), own) == pytest.approx(shared, abs=0.004)


@pytest.mark.parametrize("bits", first_fast([8, 12, 10, 14]))
def test_coarse_converters_are_no_missing_physics(bits):
    for seed in range(3):
        clean = record({}, seed)

        def rounded(x, bits=bits):
            step = 4.0 * np.abs(x).max() / 2**bits
            return step * np.rint(x / step)

        dirty = Record.from_arrays(
            i_e=clean.i_e,
            y=rounded(clean.y),
            i_c=rounded(clean.i_c),
            sample_rate=1e4,
            axes=clean.axes,
            rig=ONE_AXIS.rig,
        )
        found = diagnose(ONE_AXIS.rig, dirty)
        assert found.verdict == "adequate", found
        assert 0.8 < found.history[0].misfit < 1.1


def test_a_record_without_noise_has_a_floor():
    quiet = measured(ONE_AXIS.rig, ONE_AXIS.excitation(1.0), {}, seed=None, **ONE_AXIS.truth)
    estimate = identify(ONE_AXIS.rig, quiet)
    assert estimate.is_adequate
    assert estimate.parameters["K_i.A_zeta"].value == pytest.approx(ONE_AXIS.K_i[0], rel=1e-9)
    assert 0.0 < estimate.parameters["K_i.A_zeta"].std_error < 1e-5 * ONE_AXIS.K_i[0]
    assert diagnose(ONE_AXIS.rig, quiet).verdict == "adequate"
