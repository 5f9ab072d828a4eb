"""The best excitations: against closed forms, other powers, and sequences of the same peak."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import ambid
from ambid.designs import Instruments, Limits, design, forecast, prospect
from ambid.designs.best import SENSITIVE
from ambid.designs.length import NOT_ACCURATE, OUT_OF_REACH, TOO_SHORT
from ambid.designs.powers import PoweredLines, best_powers, criterion
from ambid.errors import InputError, ModelError, UnstableLoopError
from ambid.rig.tolerance import TYPICAL
from places import BENCH, LEVITATOR

RIG = ambid.Rig.load(LEVITATOR)
MODEL = ambid.Model(RIG)
STATED = Instruments.stated(1, 50e-9, 0.01)


def polynomial(degree, points):
    """Regression on powers of x in [-1, 1], whose best designs are known."""
    x = np.linspace(-1.0, 1.0, points)
    rows = x[:, None] ** np.arange(degree + 1)
    lines = PoweredLines(np.arange(points), rows[:, :, None] * rows[:, None, :], np.ones((points, 1)), {})
    return x, lines


def test_quadratic_regression_has_its_known_best_powers():
    """D: a third at -1, 0 and 1 each (Fedorov 1972); A: a quarter, a half, a quarter."""
    x, lines = polynomial(2, 201)
    for wanted, ends in ((None, 1 / 3), (np.eye(3), 1 / 4)):
        found = best_powers(lines, wanted)
        assert 0.99 <= found.efficiency <= 1.0
        powers = found.powers / found.powers.sum()
        near = [powers[np.abs(x - at) < 0.15].sum() for at in (-1.0, 0.0, 1.0)]
        np.testing.assert_allclose(near, [ends, 1 - 2 * ends, ends], atol=0.03)


@pytest.mark.parametrize("wanted", [None, np.diag([1.0, 4.0])])
@pytest.mark.parametrize("seed", range(3))
def test_no_powers_are_better_than_is_proven(wanted, seed):
    """With several limits at once, against a general optimiser."""
    random = np.random.default_rng(seed)
    rows, costs = random.standard_normal((12, 2, 2)), random.uniform(0.1, 1.0, (12, 3))
    lines = PoweredLines(np.arange(12), rows @ rows.transpose(0, 2, 1), costs, {})
    found = best_powers(lines, wanted)

    def value(logarithms):
        powers = np.exp(logarithms - np.max(logarithms))
        return np.log(criterion(np.tensordot(powers / (powers @ costs).max(), lines.information, 1), wanted))

    starts = [np.log(found.powers + 1e-9), *random.standard_normal((3, 12))]
    best = min(minimize(value, start, method="Nelder-Mead", options={"maxfev": 6000}).fun for start in starts)
    reached = np.log(criterion(np.tensordot(found.powers, lines.information, 1), wanted))
    assert found.efficiency > 0.95
    assert best >= reached + np.log(found.efficiency) - 1e-9
    np.testing.assert_allclose((found.powers @ costs).max(), 1.0)


def test_information_of_lines_is_that_of_the_whole_record():
    """Per power and sample, but for what the transient takes: seven numbers of those that the lines hold."""
    lines = list(range(5, 60))
    wave = ambid.multisine(1024, rms=0.1, lines=lines)
    shown = prospect(MODEL, np.tile(wave, (64, 1)), period=1024, instruments=STATED)
    own = PoweredLines.of(MODEL, 1024, STATED, Limits(), [0, 1, 2], MODEL.theta)
    powers = np.where(np.isin(own.lines, lines), 0.01 / len(lines), 0.0)
    information = np.tensordot(powers, own.information, 1) * 64 * 1024
    errors = np.sqrt(np.diag(np.linalg.inv(information))) * MODEL.theta
    found = np.array([p.std_error for p in shown.parameters.values()])
    assert (found > errors).all()
    np.testing.assert_allclose(found, errors, rtol=0.08)


def test_the_best_multisine_beats_sequences_of_the_same_peaks():
    found = design(RIG, STATED)
    assert found.option.signal == "multisine"
    assert found.gain > 2.0  # in time, against the best of five sequences
    usual = ambid.prbs(10, amplitude=1.0, hold=2, periods=8)
    peaks = forecast(RIG, usual, period=2046)
    usual = usual * found.forecast.axes[0].i_c / peaks.axes[0].i_c
    shown = prospect(MODEL, usual, period=2046, instruments=STATED)
    volumes = [np.linalg.det(own.covariance) ** (1 / 3) * own.seconds for own in (shown, found.prospect)]
    assert volumes[0] / volumes[1] > 5.0  # in time, against a usual one of the same peak current


def test_what_is_designed_is_within_its_limits():
    limits = Limits(travel=0.02, current=0.1, excitation=0.2, slew_rate=1000.0)
    found = design(RIG, STATED, limits=limits, seconds=1.0)
    shown = forecast(RIG, found.i_e, period=len(found.option.wave), limits=limits)
    assert 0.98 < shown.load <= 1.0 + 1e-9
    assert shown.seconds <= 1.0
    assert not shown.findings


def test_a_loop_that_is_more_sensitive_than_allowed_is_told():
    assert not design(RIG, STATED, seconds=0.5).findings
    (shown,) = design(RIG, STATED, seconds=0.5, limits=Limits(sensitivity=1.0)).findings
    assert (shown.kind, shown.where.axis) == (SENSITIVE, "A_zeta")
    assert shown.values["peak"] > shown.values["limit"] == 1.0


@pytest.mark.slow
def test_a_wanted_accuracy_is_met_and_no_more_is_played_than_it_takes():
    wanted = {"K_i": "0.005%", "tau_e": 1e-8}
    found = design(RIG, STATED, accuracy=wanted)
    ratios = [1.96 * found.prospect.parameters[n].std_error / half for n, half in found.wanted.items()]
    assert set(found.wanted) == {"K_i.A_zeta", "tau_e"}
    assert 0.95 < max(ratios) <= 1.0
    short = design(RIG, STATED, accuracy=wanted, seconds=0.5)
    longer, *wide = short.findings
    assert longer.kind is TOO_SHORT
    assert longer.values["needed_s"] > 0.5 >= longer.values["seconds_s"] == short.forecast.seconds
    assert {own.values["parameter"] for own in wide} <= set(found.wanted)
    for own in wide:
        assert own.kind is NOT_ACCURATE
        assert own.values["predicted"] > own.values["wanted"] == found.wanted[own.values["parameter"]]
    assert short.to_json()["notes"] == list(short.notes)
    assert all(own.line() in str(short) for own in short.findings)


@pytest.mark.slow
def test_aiming_at_an_effect_shows_less_of_it():
    at_all = design(RIG, STATED, seconds=1.0).visibility.find("sensor_lag").size
    at_it = design(RIG, STATED, seconds=1.0, effects=["sensor_lag"]).visibility.find("sensor_lag").size
    assert at_it < 0.7 * at_all


@pytest.mark.slow
def test_axes_share_the_lines_and_all_are_played():
    rig = ambid.Rig.load(BENCH)
    found = design(rig, Instruments.stated(4, 50e-9, 0.01), seconds=0.5)
    assert found.i_e.shape[1] == 4
    assert (np.abs(found.i_e).max(axis=0) > 0.0).all()
    assert found.prospect.covariance.shape == (9, 9)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"signal": "chirp"}, InputError),
        ({"spread": 1.5}, InputError),
        ({"seconds": 0.0}, InputError),
        ({"seconds": 1e-3}, InputError),
        ({"accuracy": {"K_i": "x"}}, InputError),
        ({"accuracy": {"K_x": "1%"}}, ModelError),
        ({"accuracy": {"K_s": 1e300}}, InputError),
        ({"accuracy": {"K_s": "1e300%"}}, InputError),
        ({"accuracy": {"loop_delay": "1%"}, "effects": ["loop_delay"]}, InputError),
        ({"effects": ["flux_saturation"]}, ModelError),
        ({"effects": ["unbalance"]}, ModelError),
    ],
    ids=lambda own: str(own) if isinstance(own, dict) else "",
)
def test_design_refuses(arguments, error, golden):
    with golden.raises(error):
        design(RIG, STATED, **arguments)


def test_design_at_a_fitted_model_with_the_noise_of_its_record():
    i_e = ambid.prbs(8, amplitude=0.2, hold=4, periods=6)
    record = replace(MODEL.virtual_experiment(i_e, seed=1), period=len(i_e) // 6)
    fit = ambid.identify(RIG, record)
    found = design(fit.model, Instruments.of(fit.comparison), signal="prbs", seconds=1.0)
    stated = design(RIG, STATED, signal="prbs", seconds=1.0)
    own, other = (np.array([p.std_error for p in d.prospect.parameters.values()]) for d in (found, stated))
    np.testing.assert_allclose(own, other, rtol=0.15)


def test_a_pole_at_zero_has_no_width_to_choose_a_period_by():
    """A controller whose integrator its zero cancels: the loop is not stable, and that is what is said."""
    cancelled = {
        "kind": "transfer_function",
        "implementation": "analog",
        "numerator": [60.0, 34000.0, 0.0],
        "denominator": [1e-4, 1.0, 0.0],
    }
    rig = ambid.Rig.load(LEVITATOR)
    with pytest.raises(UnstableLoopError):
        design(rig.replace(controller=cancelled), Instruments.stated(1, 2e-7, 0.01), seconds=1.0)


@pytest.mark.slow
def test_an_accuracy_that_tolerances_forbid_is_out_of_reach():
    """With a sensor known to 1 %, no record says K_i to 0.1 %."""
    known = RIG.replace(tolerance={"exact": False, **dict.fromkeys(TYPICAL, 0.0), "sensor_gain": 0.01, "mass": 0.002})
    found = design(known, STATED, accuracy={"K_i": "0.1%"})
    (finding,) = (own for own in found.findings if own.kind is OUT_OF_REACH)
    assert finding.values["parameter"] == "K_i.A_zeta"
    assert finding.values["tolerance"] == "sensor_gain.A_zeta"
    assert finding.values["by_tolerances"] > 5.0 * finding.values["wanted"]
    own = found.prospect.parameters["K_i.A_zeta"]
    assert 1.96 * own.std_error == pytest.approx(finding.values["by_tolerances"], rel=0.1)
    reached, exact = (design(rig, STATED, accuracy={"K_i": "5%"}) for rig in (known, RIG))
    assert not [own for own in reached.findings if own.kind in (OUT_OF_REACH, NOT_ACCURATE)]
    assert reached.forecast.seconds >= exact.forecast.seconds


def test_what_is_foreseen_with_tolerances_is_what_a_fit_says():
    known = ambid.Model(RIG.replace(tolerance={"mass": 0.005, "sensor_gain": 0.01}))
    i_e = ambid.prbs(8, amplitude=0.3, hold=2, axes=1, periods=8)
    shown = prospect(known, i_e, period=510, instruments=STATED).parameters
    record = replace(MODEL.virtual_experiment(i_e, seed=1, sensor_noise=50e-9, current_noise=0.01), period=510)
    found = ambid.identify(known, record).parameters
    for name, p in found.items():
        assert shown[name].std_error == pytest.approx(p.std_error, rel=0.1)
        assert shown[name].std_error_statistical == pytest.approx(p.std_error_statistical, rel=0.2)
