"""Results and what they are of are saved, copied and compared like values, and found by names."""

import copy
import inspect
import pickle
from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.errors import InputError, UnknownParameterError
from ambid.plot import plot_record
from ambid.results import PICTURES
from ambid.rig import Tolerance
from hidden.bench import simulate
from hidden.one_axis import ONE_AXIS

RIG = ONE_AXIS.rig


@pytest.fixture(scope="module")
def record():
    i_e = ONE_AXIS.excitation(ONE_AXIS.amplitude)
    return simulate(RIG, i_e, seed=1, period=ONE_AXIS.period, **ONE_AXIS.truth)


@pytest.fixture(scope="module")
def estimate(record):
    return ambid.identify(ambid.Model(RIG).add("loop_delay"), record)


@pytest.fixture(scope="module")
def all_kinds(record, estimate):
    return {
        "rig": RIG,
        "record": record,
        "response": record.frequency_response(),
        "model": estimate.model,
        "estimate": estimate,
        "comparison": estimate.comparison,
        "poles": ambid.pole_map(estimate.model),
        "one": estimate.comparison.records[0],
        "margins": ambid.margins(estimate.model, draws=40),
        "responses": ambid.frequency_responses(estimate.comparison),
        "localisation": ambid.localise(estimate.comparison),
        "map": ambid.localise(estimate.comparison).maps[0],
        "soundness": ambid.check(RIG, record),
        "matrix": ambid.misfit_matrix(estimate.comparison)[0],
        "design": ambid.design(RIG, ambid.Instruments.stated(1, 50e-9, 0.01), seconds=0.5, signal="prbs"),
    }


KINDS = ("rig", "record", "response", "model", "estimate", "comparison", "poles")
PARTS = ("margins", "responses", "localisation", "map", "matrix", "design")


@pytest.mark.parametrize("kind", [*KINDS, "one", *PARTS])
def test_what_is_pickled_or_copied_is_the_same(all_kinds, kind):
    own = all_kinds[kind]
    for again in (pickle.loads(pickle.dumps(own)), copy.copy(own), copy.deepcopy(own)):
        assert again == own
        assert hash(again) == hash(own)
        assert repr(again) == repr(own)
        assert str(again) == str(own)
    assert own != "another"


@pytest.mark.parametrize("kind", [*KINDS, "one", *PARTS, "soundness"])
def test_its_repr_is_one_short_line(all_kinds, kind):
    shown = repr(all_kinds[kind])
    assert len(shown) < 200
    assert "\n" not in shown


@pytest.mark.parametrize("kind", [*KINDS, *PARTS, "soundness"])
def test_it_shows_itself_in_a_notebook(all_kinds, kind):
    assert all_kinds[kind]._repr_html_().startswith("<table>")


def test_another_value_is_another(record, estimate):
    y = record.y.copy()
    y[100, 0] += 1e-9
    other = replace(record, y=y)
    assert other != record
    assert estimate.model.with_values({"tau_e": 1e-4}) != estimate.model
    assert estimate.model.with_theta(estimate.model.theta) != estimate.model, "the covariance is dropped"
    assert ambid.compare(estimate.model, other) != ambid.compare(estimate.model, record)
    assert ambid.compare(estimate.model, record) == ambid.compare(estimate.model, record)
    assert replace(estimate, seconds=estimate.seconds + 1.0) == estimate
    assert replace(estimate, status="stopped") != estimate


def test_the_noise_that_a_model_leaves_is_found_once(estimate):
    own = estimate.comparison.renewed()
    assert own.renewed().noise.parts[0] is own.noise.parts[0]
    moved = own.of(estimate.model.with_values({"tau_e": 1e-4})).renewed()
    assert moved.noise != own.noise
    assert moved.of(estimate.model).renewed().noise == own.noise


def test_a_comparison_goes_on_where_it_was_saved(estimate):
    again = pickle.loads(pickle.dumps(estimate)).comparison
    assert again.cost == pytest.approx(estimate.comparison.cost, rel=1e-9)
    moved = estimate.model.with_values({"tau_e": 1e-4})
    assert again.of(moved).misfit == pytest.approx(estimate.comparison.of(moved).misfit, rel=1e-9)
    assert again.renewed().misfit == pytest.approx(estimate.comparison.renewed().misfit, rel=1e-9)


def test_arrays_of_a_copied_record_cannot_be_changed(record):
    for again in (pickle.loads(pickle.dumps(record)), copy.deepcopy(record)):
        with pytest.raises(ValueError, match="read-only"):
            again.y[0, 0] = 1.0


def test_parameters_are_found_by_their_names(estimate):
    model = estimate.model
    assert model["tau_e"] is model.parameters["tau_e"] is model.parameters[2]
    assert model["tau_e"].value == estimate["tau_e"].value == estimate.parameters["tau_e"].value
    assert "loop_delay.delay" in model
    assert "loop_delay" not in model.parameters
    assert model.parameters[0] in model.parameters
    assert dict(model.parameters.items()) == {name: model[name] for name in model.names}
    assert tuple(model.parameters) == model.parameters.values()
    assert model.parameters.get("tau") is None


def test_an_estimate_is_asked_for_parameters_like_a_mapping(estimate):
    assert "tau_e" in estimate
    assert "tau" not in estimate
    assert list(estimate) == list(estimate.parameters)


def test_a_name_that_is_none_is_refused_with_the_nearest(estimate, golden):
    for within in (estimate, estimate.model, estimate.model.parameters, estimate.parameters):
        with golden.raises(UnknownParameterError):
            within["tau"]
        with pytest.raises(KeyError):
            within["tau"]
    with pytest.raises(TypeError):
        iter(estimate.model)


def test_a_record_becomes_a_table_of_its_channels(record):
    columns = record.columns()
    assert list(columns) == ["i_e.A_zeta", "y.A_zeta", "i_c.A_zeta"]
    np.testing.assert_array_equal(columns["y.A_zeta"], record.y[:, 0])
    pandas = pytest.importorskip("pandas")
    frame = record.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == ["t", *columns]
    assert len(frame) == record.samples


def test_residuals_have_the_names_of_their_channels(estimate, record):
    one = estimate.comparison.records[0]
    left = one.residual_by_channel
    assert list(left) == ["y.A_zeta", "i_c.A_zeta"]
    np.testing.assert_array_equal(left["i_c.A_zeta"], one.residual[:, 1])
    response = record.frequency_response()
    against = ambid.compare(estimate.model, response).records[0]
    other = against.residual_by_channel
    assert list(other) == ["y.A_zeta / i_e.A_zeta", "i_c.A_zeta / i_e.A_zeta"]
    np.testing.assert_array_equal(other["i_c.A_zeta / i_e.A_zeta"], against.residual[:, 1, 0])
    pandas = pytest.importorskip("pandas")
    assert isinstance(one.to_pandas(), pandas.DataFrame)
    assert list(one.to_pandas().columns) == ["t", *left]


def test_a_measurement_names_what_it_is_measured_over(record):
    response = record.frequency_response()
    for own, name, unit in ((record, "t", "s"), (response, "frequency_hz", "Hz")):
        *words, values = own.abscissa
        assert (own.is_in_time, *words) == (unit == "s", name, unit)
        np.testing.assert_array_equal(values, getattr(own, name))
    assert response.period is None


def test_a_record_draws_its_signals(record):
    panels = record.plot()
    assert [panel.get_ylabel().split(" ")[0] for panel in panels] == ["i_e", "y", "i_c"]
    (line,) = panels[1].lines
    np.testing.assert_allclose(line.get_ydata(), 1e6 * record.y[:, 0])
    (one,) = plot_record(record, "y.A_zeta", stretch=(0.1, 0.2))
    assert one.get_xlim() == pytest.approx((0.1, 0.2))
    for asked in ({"channels": "y.A_zta"}, {"stretch": (9.0, 9.5)}, {"ax": panels[:2]}):
        with pytest.raises(InputError):
            record.plot(**asked)


def test_no_peak_of_a_long_record_is_lost():
    y = np.zeros((100_000, 1))
    y[54_321] = 1e-6
    (panel,) = ambid.Record("long", 1e4, ("A_zeta",), None, y).plot()
    (line,) = panel.lines
    assert len(line.get_xdata()) <= 20_000
    assert line.get_ydata().max() == pytest.approx(1.0)


def test_every_picture_of_a_result_has_its_function():
    assert PICTURES
    assert all(callable(getattr(ambid.plot, name)) for name in PICTURES)


def test_the_signature_of_a_rig_is_its_keys():
    signature = inspect.signature(ambid.Rig)
    assert list(signature.parameters)[:4] == ["name", "sample_rate", "speed", "rotor"]
    assert len(str(signature)) < 150
    assert repr(Tolerance(mass=0.1)) == "Tolerance(mass=0.1)"
