"""Local regressions against dense least squares, window by window."""

import numpy as np
import pytest

from ambid import _core
from ambid.errors import ModelError
from ambid.noise.local import beside_excitation, regression
from reference.regression import noise_beside


def some(count, p, axes, seed=0):
    """Lines that follow an excitation with gains that change slowly, and noise."""
    random = np.random.default_rng(seed)

    def normal(*shape):
        return random.normal(size=shape) + 1j * random.normal(size=shape)

    excitation = normal(count, axes)
    gains = normal(axes, p) * (1.0 + np.linspace(0.0, 1.0, count))[:, None, None]
    return np.einsum("la,lap->lp", excitation, 50.0 * gains) + normal(count, p), excitation, random


@pytest.mark.parametrize(("p", "axes"), [(1, 1), (2, 1), (8, 4), (4, 4), (3, 0)])
@pytest.mark.parametrize("is_weighted", [False, True])
def test_what_is_left_is_that_of_dense_least_squares(p, axes, is_weighted):
    count = 230
    lines, excitation, random = some(count, p, axes)
    roots = [np.exp(0.3 * random.normal(size=(count, p)))] if is_weighted else None
    [found] = beside_excitation([lines], excitation, roots)
    fitted, width = regression(count, axes)
    parts = [own for own in (slice(0, axes), slice(axes, p)) if range(p)[own]] if is_weighted else [slice(0, p)]
    level = np.log(roots[0]) if is_weighted else np.zeros((count, p))
    weights = [(np.exp(-level[:, own].mean(axis=1)), own) for own in parts]
    sums, power = noise_beside(lines, excitation, weights, width, max(1, width // 8))
    np.testing.assert_allclose(found.power, power, rtol=1e-8)
    free = width - fitted
    factor = (1.0 + fitted / (free - p)) / width  # S is even over a regression, but for what was fitted
    np.testing.assert_allclose(found.spectrum, factor * sums, rtol=1e-9, atol=1e-12 * np.abs(sums).max())
    assert found.log_determinant == pytest.approx(np.sum(np.linalg.slogdet(found.spectrum)[1]), rel=1e-12)


def test_excitations_that_are_all_but_the_same_keep_their_digits():
    """T'T has a condition of 1e12 there; what is left does not depend on how the two are turned."""
    count, p = 200, 4
    lines, excitation, _ = some(count, p, 2)
    near = excitation[:, :1] + 1e-6 * excitation[:, 1:]
    [found] = beside_excitation([lines], np.hstack([excitation[:, :1], near]))
    [turned] = beside_excitation([lines], excitation)
    np.testing.assert_allclose(found.spectrum, turned.spectrum, rtol=1e-5, atol=1e-6 * np.abs(turned.spectrum).max())


def test_excitations_that_are_the_same_leave_no_nan():
    lines, excitation, _ = some(200, 2, 1)
    [found] = beside_excitation([lines], np.hstack([excitation, excitation]))
    assert np.isfinite(found.spectrum).all()
    assert (found.power > 0.0).all()


@pytest.mark.parametrize(
    "changed",
    [
        {"starts": np.array([0, 31], dtype=np.uintp)},
        {"nearest": np.full(60, 2, dtype=np.uintp)},
        {"weighted": [(1, np.ones(60))]},
        {"weighted": [(2, np.ones(59))]},
        {"excitation": np.ones((59, 1), dtype=complex)},
    ],
    ids=["starts", "nearest", "channels", "weights", "excitation"],
)
def test_what_does_not_fit_is_refused(changed, golden):
    given = {
        "lines": np.ones((60, 2), dtype=complex),
        "excitation": np.ones((60, 1), dtype=complex),
        "weighted": [(2, np.ones(60))],
        "starts": np.array([0, 30], dtype=np.uintp),
        "nearest": np.repeat([0, 1], 30).astype(np.uintp),
    }
    with golden.raises(ModelError):
        _core.local_regressions(*{**given, **changed}.values(), 30, 2, 0.95)
