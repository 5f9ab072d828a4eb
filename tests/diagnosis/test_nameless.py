"""Something that the catalogue lacks, as the residual in the ways of effects shows it."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from ambid import diagnose
from ambid.diagnosis.nameless import POWERS, Ways
from hidden.one_axis import ONE_AXIS, record

NUMBERS = 14


def drawn(seed, dimensions=(1, 2, 3)):
    """Effects that can do so many things each, at random, and the mean of the projectors on these."""
    random = np.random.default_rng(seed)
    bases = [np.linalg.qr(random.standard_normal((NUMBERS, n)))[0] for n in dimensions]
    rows = np.concatenate([basis.T / np.sqrt(basis.shape[1]) for basis in bases])
    names = tuple(f"effect {k}" for k, n in enumerate(dimensions) for _ in range(n))
    mean = sum(basis @ basis.T / basis.shape[1] for basis in bases) / len(bases)
    return Ways(rows, names, np.ones(NUMBERS)), bases, mean


@pytest.mark.parametrize("size", [0.0, 3.0, 30.0])
def test_odds_are_those_of_a_random_change_in_the_ways_of_effects(size):
    """Against densities of a normal distribution of all numbers, mean over the powers, as effects act or alike."""
    ways, bases, mean = drawn(1)
    residual = np.random.default_rng(2).standard_normal(NUMBERS) + size * bases[1][:, 0]
    every = np.linalg.qr(np.concatenate(bases, axis=1))[0]
    many, densities = np.geomspace(1.0, 1e9, 2001), []
    for shape in (mean / np.trace(mean), every @ every.T / 6.0):

        def density(power, shape=shape):
            return multivariate_normal(cov=np.eye(NUMBERS) + power * shape).logpdf(residual)

        best = max(1.0, many[np.argmax([density(power) for power in many])] / np.sqrt(POWERS[-1]))
        densities += [density(best * power) - density(0.0) for power in POWERS]
    found = ways.shown(residual, ())
    assert found.odds == pytest.approx(logsumexp(densities) - np.log(len(densities)), abs=0.05)
    assert found.ways == 6


def test_a_little_in_all_ways_of_effects_is_something_else_as_much_in_a_few_is():
    """Few effects act in most of the ways: by their powers alone these would not count."""
    ways, bases, _ = drawn(7, dimensions=(1,) * 2 + (8,))
    residual = 3.0 * bases[2].sum(axis=1)
    assert ways.shown(residual, ()).odds > 10.0


def test_noise_alone_speaks_for_nothing_else():
    """On average odds are one, or less, as the least power is one that is seen."""
    ways, _, _ = drawn(3)
    random = np.random.default_rng(4)
    odds = [ways.shown(random.standard_normal(NUMBERS), ()).odds for _ in range(4000)]
    assert 0.2 < np.mean(np.exp(odds)) < 1.3


def test_what_a_set_absorbs_is_nothing_else():
    ways, bases, _ = drawn(5)
    residual = 30.0 * bases[2][:, 1] + np.random.default_rng(6).standard_normal(NUMBERS)
    assert ways.shown(residual, ()).odds > 100.0
    assert ways.shown(residual, ("effect 2",)).odds < 2.0
    assert ways.shown(residual[1:], ()).ways == 0  # of other lines


def test_a_small_effect_without_a_name_is_seen_within_the_limit_of_the_misfit():
    """A dead band of 0.3 mA: J over all lines does not show it."""
    found = diagnose(ONE_AXIS.rig, record({"amplifier_dead_band": {"current": 0.0003}}, 1))
    assert found.fit.is_adequate
    assert found.verdict == "none_of_the_candidates"
    assert found.probabilities.something_else > 0.9
    assert [own.name for own in found.adequacy.failed()] == ["ways"]
    assert "residual_in_the_ways_of_effects" in [finding.code for finding in found.findings]
