"""Cards that are late, clocks that run off, samples that y alone lost: on machines of the independent simulator."""

import numpy as np
import pytest

from ambid.checking import check
from benchmarks.dirt_kinds import MARGIN, soiled
from benchmarks.null_cells import made
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS


def findings(bench, kind, seed, hidden=None):
    """What `check` says of a record with one kind of dirt, worst first."""
    one = bench.excitation(bench.amplitude, seed)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    record = simulate(bench.rig, i_e, hidden or {}, period=bench.period, seed=seed, **bench.truth, **bench.noise)
    record = soiled(record, kind, np.random.default_rng(seed), bench.rig)
    return [found for found in check(bench.rig, [record]).findings if found.severity == "fault"]


def samples_told(found):
    """The number of samples in a finding."""
    return float(found.what.split(" sample")[0].split()[-1])


@pytest.mark.parametrize("bench", [ONE_AXIS, BENCHES["bench"]], ids=["one axis", "four axes"])
@pytest.mark.parametrize(
    ("kind", "where", "what"),
    [
        ("late_card", "record: y on ", "late against i_e"),
        ("late_i_e", "record: i_e on ", "late against y and i_c"),
        ("drifting_clock", "record: y", "ppm"),
        ("lost_y", "record: y.A_zeta", "1 sample lost near row"),
    ],
)
def test_each_kind_is_named(bench, kind, where, what):
    found = findings(bench, kind, 2)
    assert found
    assert found[0].where.startswith(where)
    assert what in found[0].what
    assert found[0].stops_diagnosis
    if "late" in what:
        assert samples_told(found[0]) == pytest.approx(1.0, abs=0.02)
    if "ppm" in what:
        assert float(found[0].what.split(" ppm")[0].split()[-1]) == pytest.approx(100.0, abs=10.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_fraction_of_a_sample_comes_out_right(seed):
    late = np.random.default_rng(seed).uniform(0.1, 0.3)  # what the dirt draws first
    (found,) = findings(ONE_AXIS, "late_y", seed)
    assert samples_told(found) == pytest.approx(late, abs=0.02)


@pytest.mark.parametrize("effect", [None, *NAMED])
def test_physics_is_no_late_card(effect):
    """What moves the controller's equation or what does not repeat, strongly, is none of the above."""
    hidden = {} if effect is None else {effect: NAMED[effect]}
    assert not [f for f in findings(ONE_AXIS, "clean", 1, hidden) if "late" in f.what or "clock" in f.what]


def test_a_transient_that_dies_away_over_periods_is_no_lost_sample():
    """A slow mode that still rings where the record is judged shifts its first periods against the others."""
    rig, record = made(884)
    assert not [found for found in check(rig, [record]).findings if found.stops_diagnosis]
