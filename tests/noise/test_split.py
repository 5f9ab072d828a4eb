"""Noise that the controller hears is separated from that of the recorder; J/dof of a right model is 1 in either.

Lines of known powers behind a way with a resonance; and records of the simulator.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from ambid import Model, _core, prbs
from ambid.diagnosis import compare
from ambid.noise.split import Curves, SplitNoise
from hidden.bench import simulate
from hidden.network import compiler
from hidden.one_axis import ONE_AXIS

needs_a_compiler = pytest.mark.skipif(compiler() is None, reason="hidden records need a C compiler (cc, gcc or clang)")
COUNT = 3000
ANGLE = np.pi * np.arange(1, COUNT + 1) / (COUNT + 1)


def way() -> np.ndarray:
    """From noise of y to y and i_c: a sensitivity with a resonance, and a controller."""
    w = np.exp(1j * ANGLE)
    resonance = 1.0 / (1.0 - 1.9 / w + 0.94 / w**2)
    y = (1.0 - 1.9 / w + 0.92 / w**2) * resonance * (1.0 - 0.99 / w)
    return np.stack([y, 5.0 * (1.0 - 0.8 / w) * y], axis=1)[:, :, None]


def powers(heard: float, unheard: float) -> np.ndarray:
    """Of noise of y that is heard, of that which is not, both coloured, and of i_c."""
    red = 1.0 / np.abs(1.0 - 0.8 * np.exp(-1j * ANGLE)) ** 2
    return np.stack([heard * red, unheard * red, np.full(COUNT, 4.0)], axis=1)


def lines(own: np.ndarray, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    noise = (random.standard_normal(own.shape) + 1j * random.standard_normal(own.shape)) * np.sqrt(own / 2.0)
    return (way() @ noise[:, :1, None])[:, :, 0] + noise[:, 1:]


@pytest.mark.parametrize(("heard", "unheard"), [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (1.0, 0.05), (0.02, 1.0)])
def test_powers_are_found(heard, unheard):
    """In what is recorded of y: where nothing of it is heard, noise may be loud."""
    true, noise = powers(heard, unheard), SplitNoise(lines(powers(heard, unheard), 1), way(), ANGLE)
    shown = np.concatenate([np.abs(way()[:, :1, 0]) ** 2, np.ones((COUNT, 1))], axis=1)
    of_y, found = (own[:, :2] * shown for own in (true, noise.powers(ANGLE)))
    assert_allclose(found.mean(axis=0) / of_y.sum(axis=1).mean(), of_y.mean(axis=0) / of_y.sum(axis=1).mean(), atol=0.1)
    ways = np.concatenate([way(), np.tile(np.eye(2, dtype=complex), (COUNT, 1, 1))], axis=2)
    root = noise.whitening(way(), ANGLE) @ (ways * np.sqrt(true)[:, None, :])
    white = root @ root.conj().transpose(0, 2, 1)
    assert_allclose(white.mean(axis=0), np.eye(2), atol=0.05)


def test_other_lines_have_a_power_of_one_and_of_what_was_fitted():
    """In the mean over seeds, by 60 lines that twelve numbers are fitted to: a fifth of what the fit had taken left."""
    few = np.arange(7, COUNT, COUNT // 60)
    left, fitted, own = [], [], []
    for seed in range(150):
        first, second = lines(powers(1.0, 1.0), 2 * seed)[few], lines(powers(1.0, 1.0), 2 * seed + 1)[few]
        noise = SplitNoise(first, way()[few], ANGLE[few])
        back = noise.whitening(way()[few], ANGLE[few])
        own.append(np.mean(np.abs(_core.through(back, first)) ** 2))
        left.append(np.mean(np.abs(_core.through(back, second)) ** 2))
        fitted.append(np.mean(noise.fitted(way()[few], ANGLE[few])) / 2.0)
        assert np.sum(noise.fitted(way()[few], ANGLE[few])) == pytest.approx(noise.numbers, rel=1e-6)
    assert np.mean(own) == pytest.approx(1.0, abs=0.02)
    assert np.mean(left) - 1.0 == pytest.approx(np.mean(fitted), rel=0.35)


def test_scores_are_slopes_of_the_likelihood():
    random, z, curves = np.random.default_rng(2), lines(powers(1.0, 0.3), 3), Curves.over(ANGLE)
    ways = np.concatenate([way(), np.tile(np.eye(2, dtype=complex), (COUNT, 1, 1))], axis=2)
    sources = _core.Sources(ways, *curves.at(ANGLE), curves.splines)
    at = random.standard_normal((3, curves.splines))
    likelihood, score, information = sources.likely(z, at, np.inf)
    covariance = (ways * np.exp(curves.matrix(ANGLE) @ at.T)[:, None, :]) @ ways.conj().transpose(0, 2, 1)
    assert likelihood == pytest.approx(_core.whittle(np.ascontiguousarray(covariance), z), rel=1e-12)
    slopes = np.zeros_like(at)
    for place in np.ndindex(*at.shape):
        step = np.zeros_like(at)
        step[place] = 1e-5
        slopes[place] = (sources.likely(z, at + step, np.inf)[0] - sources.likely(z, at - step, np.inf)[0]) / 2e-5
    assert_allclose(score, slopes, rtol=1e-5, atol=1e-4)
    assert_allclose(information, information.T)
    white = sources.whitening(at)
    assert_allclose(white @ covariance @ white.conj().transpose(0, 2, 1), np.tile(np.eye(2), (COUNT, 1, 1)), atol=1e-9)
    assert np.sum(sources.fitted(at, np.linalg.inv(information))) == pytest.approx(at.size, rel=1e-6)


def test_splines_add_up_to_one():
    curves = Curves.over(ANGLE)
    assert_allclose(curves.matrix(np.linspace(0.0, 3.5, 100)).sum(axis=1), 1.0)


def test_noise_of_no_power_is_no_trouble():
    """A filter's tail of 200 dB, and a channel at rest but for rounding."""
    z = lines(powers(1.0, 0.0), 4) * np.array([1.0, 1e-12])
    z[:, 0] *= np.abs(lfilter([1.0], [1.0, -0.999], np.ones(COUNT)) / 1e3) ** 4 + 1e-10
    back = SplitNoise(z, way(), ANGLE).whitening(way(), ANGLE)
    assert np.all(np.isfinite(back))


@needs_a_compiler
@pytest.mark.parametrize("place", ["recorder", "loop", "both"])
def test_a_right_model_has_a_misfit_of_one_wherever_noise_arises(place):
    """Taken back through the loop, noise of the recorder has 0.82 in the mean of these four records, 0.65 at worst."""
    heard, unheard = {"recorder": (0.0, 1.3e-7), "loop": (1.3e-7, 0.0), "both": (1.3e-7, 1.3e-7)}[place]
    truth = Model(ONE_AXIS.rig).with_values({"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4})
    misfits, found = [], []
    for seed in range(4):
        record = simulate(
            ONE_AXIS.rig,
            prbs(10, amplitude=1.0, hold=8, periods=4, seed=seed),
            seed=seed,
            period=1023 * 8,
            sensor_noise=heard,
            recorder_noise=unheard,
            colour=([1.0], [1.0, -0.95]),
            recorder_colour=([1.0], [1.0, -0.95]),
            **ONE_AXIS.truth,
        )
        own = compare(truth, record)
        misfits.append(own.misfit)
        found.append([own.records[0].findings[0].values[name] for name in ("heard_m", "recorder_m")])
    ratio = np.divide(*np.mean(found, axis=0))
    assert {"recorder": ratio < 0.3, "loop": ratio > 3.0, "both": 0.6 < ratio < 1.7}[place]
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.02)
