"""Numbers and names as an engineer writes them."""

import numpy as np
import pytest

import ambid
from ambid.identification import ParameterEstimate
from ambid.report import numbers, words


def test_standard_errors_are_those_of_the_scatter(explained):
    errors = numbers.standard_errors(explained)
    truth = ambid.Model(explained.model.rig).add("loop_delay", {"delay": 5e-5})
    off = [
        (p.value - q.value) / errors[p.name] for p, q in zip(explained.model.parameters, truth.parameters, strict=True)
    ]
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 2.0


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (2.5e-4, "s", "250.0 µs"),
        (2.39e6, "N/m", "2.390 MN/m"),
        (-0.72, "1", "−0.7200"),
        (0.0, "m", "0 m"),
        (300.3, "N s/m", "300.3 N s/m"),
        (1e-4, "s^0.5", "0.0001 s^0.5"),
    ],
)
def test_quantities(value, unit, text):
    assert words.quantity(value, unit) == text


def test_a_parameter_has_as_many_decimals_as_its_interval_tells():
    row = words.Row.of("K_s.x", ParameterEstimate.normal(2.39e6, 1200.0, "N/m"), 2.2e6, 2.1e6, None)
    assert (row.unit, row.of_rig, row.before, row.now) == ("MN/m", "2.2", "2.1000", "2.3900")
    assert row.interval.split(" to ") == ["2.3876", "2.3924"]
    unknown = words.Row.of("K_s.x", ParameterEstimate(None, None, None, "N/m"), None, None, None)
    assert (unknown.now, unknown.interval, unknown.errors) == ("–", "–", "–")


@pytest.mark.parametrize(("chance", "text"), [(-1.0, "0.37"), (-230.2585, "10⁻¹⁰⁰"), (-1e6, "< 10⁻³⁰⁰")])
def test_p_values(chance, text):
    assert words.p_value(chance) == text


@pytest.mark.parametrize(
    ("value", "error", "unit", "shown", "now"),
    [
        (-5.41374e-7, 3.96e-9, "kg m", "g mm", "−0.5414"),
        (3.1e-7, 2e-9, "1", "10⁻⁹", "310.0"),
        (-2.4e-5, 3e-8, "kg m^2", "10⁻⁶ kg m^2", "−24.000"),
        (2.5e-10, 1e-12, "s", "ns", "0.2500"),
        (0.47, 0.012, "1", "", "0.470"),
    ],
)
def test_small_values_keep_their_digits(value, error, unit, shown, now):
    """An unbalance was -0.000001 kg m."""
    row = words.Row.of("x", ParameterEstimate.normal(value, error, unit), None, None, None)
    assert (row.unit, row.now) == (shown, now)
