"""The noise ceiling against known noise, and against the table of the measured cases."""

import numpy as np
import pytest

from ambid.noise import noise_ceiling
from ambid.record import Record
from ambid.rig import Rig
from places import SHARED
from reference.records import AXES, PERIOD, RIG, measured

CASES = SHARED / "cases"


@pytest.mark.parametrize("seed", range(12))
def test_noise_ceiling_is_that_of_the_known_noise(seed):
    """Against the fit of the noise-free response itself; the scatter of both over 9 periods is below 0.3 % of fit."""
    noise = 10 ** np.random.default_rng(seed).uniform(-8, -6.3)
    clean = Record.from_arrays(**measured(periods=10, noise=0.0, seed=seed), rig=RIG)
    noisy = Record.from_arrays(**measured(periods=10, noise=noise, seed=seed), rig=RIG)
    ceiling = noise_ceiling(noisy)
    assert set(ceiling) == {f"{signal}.{axis}" for signal in ("y", "i_c") for axis in AXES}
    for j, axis in enumerate(AXES):
        y, exact = noisy.y[PERIOD:, j], clean.y[PERIOD:, j]
        misfit = np.linalg.norm((y - y.mean()) - (exact - exact.mean())) / np.linalg.norm(y - y.mean())
        # Relative standard error of a scatter with 8 * 254 degrees of freedom: 1 / sqrt(2 * 2032) = 1.6 %.
        assert 100 - ceiling[f"y.{axis}"] == pytest.approx(100 * misfit, rel=0.07)


def test_noise_ceiling_is_unbiased(validated):
    """The mean over many records and axes leaves no room for a missing M / (M - 1), which is 22 % at M = 3."""
    ratios = []
    for seed in range(20):
        record = Record.from_arrays(**measured(periods=4, noise=3e-7, seed=seed), rig=RIG)
        for j, axis in enumerate(AXES):
            y = record.y[PERIOD:, j]
            ratios.append((1 - noise_ceiling(record)[f"y.{axis}"] / 100) * y.std() / 3e-7)
    validated(
        "Attainable fit, 80 channels: relative deviation of the noise that it rests on",
        "standard deviation of the noise that was added",
        np.mean(ratios) - 1.0,
        0.01,
    )


def test_noise_ceiling_needs_two_periods_after_the_transient():
    assert np.isnan(noise_ceiling(Record.from_arrays(**measured(periods=2), rig=RIG))["y.A_zeta"])
    assert noise_ceiling(Record.from_arrays(**measured(periods=3), rig=RIG))["y.A_zeta"] > 50


@pytest.mark.skipif(not CASES.is_dir(), reason="the measured cases are not beside the project")
def test_measured_cases():
    """Periods are 2047 x 2, 1023 x 5 and 511 x 10; the ceilings are those of the cases' own table."""
    expected = {"01": (4094, 95.4), "02": (4094, 95.4), "04": (5110, 99.9), "07": (5115, 99.9)}
    for folder in sorted(CASES.glob("0*")):
        period, ceiling = expected.get(folder.name[:2], (5115, 99.4))
        rig = Rig.load(folder / "rig.toml")
        for path in [*folder.glob("*.csv"), *folder.glob("*.mat")]:
            record = Record.load(path, rig)
            assert (record.period, record.notes) == (period, ())
            fits = [fit for channel, fit in noise_ceiling(record).items() if channel.startswith("y.")]
            if path.stem != "validate":
                assert np.mean(fits) == pytest.approx(ceiling, abs=0.1)
