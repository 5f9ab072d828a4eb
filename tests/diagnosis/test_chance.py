"""How likely chance is to reach a score: the noise of the noise spectrum, one-sided amplitudes, and many variants."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import lsq_linear

from ambid.diagnosis import Candidate
from ambid.noise.chance import independent_tests, log_chance, log_mean_odds_against
from ambid.noise.window import Window
from reference.whitening import Whitening


def candidate(score=1.0, degrees=1, **more):
    return Candidate(None, score, degrees, {}, 1.0, **more)


def test_odds_of_chances_are_one_on_average_under_noise():
    """Over all chances, of u = -log p."""
    mean, _ = quad(lambda u: np.exp(log_mean_odds_against(-u) - u), 0.0, np.inf, limit=200)
    assert mean == pytest.approx(1.0, abs=1e-6)
    assert log_mean_odds_against(-500.0) == pytest.approx(500.0 - 2.0 * np.log(500.0))


def test_spread_is_the_variance_of_whitened_noise_on_a_whitened_response():
    """J itself has mean 1; a score is larger by n / (n - p), since S is known from n lines only."""
    window, channels = Window(60, 3, 60), 4
    rng = np.random.default_rng(5)
    responses = np.tile(rng.standard_normal((60, channels, 8)), (4, 1, 1))
    squares, costs, shown = [], [], []
    for _ in range(300):
        residual = rng.standard_normal((240, channels))
        whitening = Whitening.between(residual, window)
        white, seen = whitening.white(residual), whitening.white(responses)
        seen /= np.linalg.norm(seen, axis=0)
        squares.append((seen.T @ white) ** 2)
        costs.append(white @ white / white.size)
        shown.append(whitening.spreads @ seen**2)
    assert 1.05 < np.mean(shown) < 1.3
    assert np.mean(costs) == pytest.approx(1.0, abs=0.02)
    # 2400 squares of one degree of freedom: their mean has a standard error of 2.9 %
    assert np.mean(squares) == pytest.approx(np.mean(shown), rel=0.087)


@pytest.mark.parametrize(("degrees", "one_sided"), [(1, 0), (1, 1), (2, 1), (2, 2), (3, 1)])
def test_chance_of_bounded_amplitudes_is_that_of_a_monte_carlo(degrees, one_sided, validated):
    rng = np.random.default_rng(degrees + 10 * one_sided)
    lower = np.where(np.arange(degrees) < one_sided, 0.0, -np.inf)
    falls = []
    for z in rng.standard_normal((4000, degrees)):
        best = np.maximum(z, lower)  # of independent columns, each amplitude goes for itself
        falls.append(z @ z - (z - best) @ (z - best))
    for score in (0.5, 2.0, 5.0):
        known = np.exp(candidate(score, degrees, one_sided=one_sided).chance)
        validated(
            "p-value of the score of an effect with one-sided parameters: deviation",
            "4000 draws of normal noise; 4 standard deviations",
            np.mean(np.array(falls) >= score) - known,
            4.0 * np.sqrt(known / 4000),
        )


def test_independent_amplitudes_are_those_of_a_bounded_least_squares():
    z = np.array([-1.0, 2.0, 0.3])
    solved = lsq_linear(np.eye(3), z, bounds=(np.zeros(3), np.full(3, np.inf))).x
    np.testing.assert_allclose(solved, np.maximum(z, 0.0), atol=1e-8)


def test_a_larger_spread_and_more_variants_make_a_score_less_striking():
    one = candidate(20.0)
    assert one.chance == log_chance(20.0, 1)
    assert candidate(20.0, spread=1.25).chance == log_chance(16.0, 1)
    assert candidate(20.0, variants=8.0).chance == pytest.approx(one.chance + np.log(8.0))
    assert candidate(0.0, variants=8.0).chance == 0.0


def independent(bases):
    stacked = np.hstack(bases)
    return independent_tests(stacked.conj().T @ stacked, len(bases))


def test_variants_count_as_the_independent_tests_that_they_are():
    rng = np.random.default_rng(0)
    basis, _ = np.linalg.qr(rng.standard_normal((200, 12)))
    planes = [basis[:, k : k + 2] for k in range(0, 12, 2)]
    assert independent(planes) == pytest.approx(6.0)
    turned, _ = np.linalg.qr(planes[0] @ rng.standard_normal((2, 2)))
    assert independent([planes[0], turned, planes[0]]) == pytest.approx(1.0)
    near, _ = np.linalg.qr(planes[0] + 0.3 * planes[1])
    assert 1.0 < independent([planes[0], near]) < 2.0


def test_tests_on_complex_lines_count_like_tests_on_their_parts():
    """Whatever the phase of a pattern, which says nothing of how alike two of them are."""
    rng = np.random.default_rng(1)
    lines = rng.standard_normal((200, 3)) + 1j * rng.standard_normal((200, 3))
    columns = [line[:, None] / np.linalg.norm(line) for line in lines.T]
    turned = [np.exp(1j * angle) * column for angle, column in zip((0.3, 1.9, 2.7), columns, strict=True)]
    assert independent(columns) == pytest.approx(3.0, abs=0.05)
    assert independent(turned) == pytest.approx(independent(columns))
    assert independent([columns[0], 1j * columns[0]]) == pytest.approx(1.0)


def test_the_best_of_many_correlated_directions_is_as_likely_as_said():
    """A scan over frequency: the largest of 30 overlapping scores, against the p-value that is stated."""
    rng = np.random.default_rng(2)
    places = np.linspace(0.0, 1.0, 400)
    columns = np.array([np.exp(-(((places - at) / 0.03) ** 2)) for at in np.linspace(0.0, 1.0, 30)]).T
    columns /= np.linalg.norm(columns, axis=0)
    count = independent_tests(columns.T @ columns, 30)
    assert 10.0 < count < 30.0
    best = ((rng.standard_normal((6000, 400)) @ columns) ** 2).max(axis=1)
    for score in (9.0, 12.0):
        shown = np.exp(candidate(score, variants=count).chance)
        assert 0.6 * shown < np.mean(best > score) < 1.4 * shown


@pytest.mark.slow
def test_noise_with_a_narrow_peak_of_its_own_is_judged_by_the_peak():
    """A response that lies in the peak is weighed by the noise there, not by the mean over a wide band."""
    window = Window(1500, 3, 1500)
    rng = np.random.default_rng(8)
    hz = np.fft.rfftfreq(6000)
    peak = 1.0 + 30.0 / (1.0 + ((hz - 0.2) / 0.006) ** 2)  # nine excited lines wide
    line = np.fft.rfftfreq(1500)
    form = np.fft.irfft(np.exp(-(((line - 0.2) / 0.003) ** 2)) * np.exp(2j * np.pi * rng.random(len(line))))
    response = np.tile(form, 4)[:, None] * np.array([1.0, 0.5])
    ratios = {}
    for name, colour in (("white", np.ones_like(hz)), ("peak", np.sqrt(peak))):
        squares, shown = [], []
        for _ in range(150):
            residual = np.fft.irfft(np.fft.rfft(rng.standard_normal((6000, 2)), axis=0) * colour[:, None], axis=0)
            whitening = Whitening.between(residual, window)
            seen = whitening.white(response)
            seen /= np.linalg.norm(seen)
            squares.append((seen @ whitening.white(residual)) ** 2)
            shown.append(whitening.spreads @ seen**2)
        ratios[name] = np.mean(squares) / np.mean(shown), np.median(shown)
    for ratio, shown in ratios.values():
        assert 1.0 < shown < 1.2
        assert ratio == pytest.approx(1.0, abs=0.4)  # three standard errors of 150 squares
