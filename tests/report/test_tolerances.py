"""The report of a rig whose values are known to tolerances: how well, and what makes each interval."""

import pytest

import ambid
from places import LEVITATOR


@pytest.fixture(scope="module")
def known():
    """A diagnosis of a mass on one axis whose rig file has typical tolerances."""
    rig = ambid.Rig.load(LEVITATOR)
    i_e = ambid.prbs(8, amplitude=0.1, hold=2, axes=1, periods=4)
    record = ambid.Model(rig).virtual_experiment(i_e, seed=1)
    return ambid.diagnose(rig.replace(tolerance={}), record)


def test_every_known_value_is_in_a_table(known, page):
    rows = page(known).tables["tolerances"]
    assert [row[0] for row in rows] == list(known.tolerances)
    for row, own in zip(rows, known.tolerances.values(), strict=True):
        assert tuple(cell.replace("−", "-") for cell in row[1:]) == own.texts()


def test_the_budget_is_that_of_the_json(known, page):
    rows = {row[0]: row[1:] for row in page(known).tables["budget"]}
    budget = known.to_json()["budget"]
    assert list(rows)[0] == "noise"
    assert len(rows.keys() - {"noise", *known.tolerances}) == 1  # all others together
    for k, parts in enumerate(budget.values()):
        shown = [float(own[k].removeprefix("< ")) for own in rows.values()]
        assert sum(shown) == pytest.approx(100.0, abs=3.0)
        assert shown[0] == pytest.approx(100.0 * parts["noise"] / sum(parts.values()), abs=1.0)
        large = {name for name, own in parts.items() if own > 0.02 * sum(parts.values())}
        assert large <= set(rows)


def test_parameters_are_those_that_are_fitted_without_prior_knowledge(known, page):
    names = [name.replace("K_i", "Ki").replace("K_s", "Ks").replace("tau_e", "τe") for name in known.parameters]
    assert [row[0] for row in page(known).tables["parameters"]] == names
    assert not set(known.parameters) & set(known.tolerances)


def test_an_exact_rig_has_neither_table(explained, whole):
    assert not explained.tolerances
    assert "tolerances" not in whole.tables
    assert "budget" not in whole.tables
