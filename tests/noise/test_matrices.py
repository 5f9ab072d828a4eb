"""Small matrices of noise by the core, against NumPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid import Model, _core
from ambid.errors import ModelError
from ambid.noise.colour import back_through_loop, loop_noise

LINES, P = 40, 5


@pytest.fixture(scope="module")
def random():
    return np.random.default_rng(3)


@pytest.fixture(scope="module")
def lines(random):
    return random.standard_normal((LINES, P, 2)) @ [1.0, 1.0j]


@pytest.fixture(scope="module")
def matrices(random):
    return random.standard_normal((LINES, P, P, 2)) @ [1.0, 1.0j]


def test_sums_over_neighbours(lines):
    used = np.arange(LINES) % 7 != 3
    low, high, left_out = np.array([0, 5, 20]), np.array([40, 20, 31]), np.array([1, 7, 30])
    own = lines[:, :, None] * lines.conj()[:, None, :] * used[:, None, None]
    expected = [own[a:b].sum(axis=0) - own[k] for a, b, k in zip(low, high, left_out, strict=True)]
    scatter = _core.Scatter(lines, used)
    low, high, left_out = (places.astype(np.uintp) for places in (low, high, left_out))
    assert_allclose(scatter.between(low, high, left_out), expected, atol=1e-12)
    with pytest.raises(ModelError):
        scatter.between(low, high + np.uintp(1))


def test_whitening_and_likelihood(lines, matrices):
    covariance = matrices @ matrices.conj().transpose(0, 2, 1)
    back = matrices.transpose(0, 2, 1).copy()
    inner, both = _core.whitening(covariance, back)
    assert_allclose(inner, np.sqrt(2.0) * np.linalg.inv(np.linalg.cholesky(covariance)), rtol=1e-9, atol=1e-9)
    assert_allclose(both, inner @ back, rtol=1e-9, atol=1e-9)
    white = _core.through(inner, lines)
    expected = -0.5 * np.sum(np.abs(white) ** 2) - np.linalg.slogdet(covariance)[1].sum()
    assert _core.whittle(covariance, lines) == pytest.approx(expected, rel=1e-9)
    with pytest.raises(ModelError):
        _core.whitening(-covariance, back)


def test_inverses(matrices):
    assert_allclose(_core.inverses(matrices) @ matrices, np.tile(np.eye(P), (LINES, 1, 1)), atol=1e-9)
    with pytest.raises(ModelError):
        _core.inverses(np.zeros((2, 3, 3), dtype=complex))


@pytest.mark.parametrize("channels", [4, 8])
def test_the_way_back_undoes_the_loop(rig, channels):
    model, points = Model(rig), np.exp(1j * np.linspace(0.01, 3.0, LINES))
    both = back_through_loop(model, points, channels) @ loop_noise(model, points, channels)
    assert_allclose(both, np.tile(np.eye(channels), (LINES, 1, 1)), atol=1e-10)
