"""Excitations that do not repeat throughout, over random seeds: what was done to them is found."""

import numpy as np
import pytest

from ambid.excitation import multisine, prbs
from ambid.record import Record
from ambid.record.repeats import repeats
from found import codes, the

SEEDS = [*range(12), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(12, 40))]


def excitation(seed):
    """A PRBS or a multisine of four to seven periods, from any place on."""
    rng = np.random.default_rng(seed)
    order, hold, axes = int(rng.integers(7, 10)), int(rng.integers(1, 6)), int(rng.integers(1, 5))
    period, count = (2**order - 1) * hold, int(rng.integers(4, 8))
    if seed % 3:
        x = prbs(order, amplitude=0.5, hold=hold, axes=axes, periods=count, seed=seed)
    else:
        lines = np.arange(1, period // 5)
        x = multisine(period, rms=0.3, lines=lines, axes=axes, periods=count, phases="random", seed=seed)
    return rng, x[int(rng.integers(0, period // 3)) :], period


@pytest.mark.parametrize("seed", SEEDS)
def test_one_wrong_sample_is_found_wherever_it_is(seed):
    rng, x, period = excitation(seed)
    row, axis = int(rng.integers(0, len(x))), int(rng.integers(0, x.shape[1]))
    x[row, axis] += rng.choice([100.0, 3.0, 0.7, -1.0]) * np.ptp(x)
    found = repeats(x)
    assert (found.period, found.steps, found.wrong.tolist()) == (period, (), [[row, axis]])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("repeated", [False, True], ids=["lost", "repeated"])
def test_lost_and_repeated_rows_are_counted_and_placed(seed, repeated):
    rng, x, period = excitation(seed)
    count, row = int(rng.integers(1, 21)), int(rng.integers(len(x) // 10, 9 * len(x) // 10))
    more = np.full(count, row - 1) if repeated else []
    rows = np.r_[:row, more, row if repeated else row + count : len(x)].astype(int)
    found = repeats(x[rows])
    assert found.period == period
    assert [step.lost for step in found.steps] == [-count if repeated else count]
    assert abs(found.steps[0].row - row) <= 30
    assert len(found.wrong) == 0


@pytest.mark.parametrize("seed", range(20))
def test_noise_of_two_percent_hides_no_period(seed):
    rng, x, period = excitation(seed)
    found = repeats(x + 0.02 * x.std() * rng.standard_normal(x.shape))
    assert (found.period, found.steps, len(found.wrong)) == (period, (), 0)


@pytest.mark.parametrize("seed", range(10))
def test_what_never_repeats_has_no_period(seed):
    rng = np.random.default_rng(seed)
    for x in (
        rng.choice([-1.0, 1.0], 5000),
        rng.normal(size=5000).cumsum(),
        prbs(9, amplitude=1.0, periods=2)[:1000],
        rng.normal(size=(3000, 4)),
        np.repeat(rng.choice([-1.0, 1.0], 500), 10),
        np.ones(500),
    ):
        assert repeats(x.reshape(len(x), -1)) is None


@pytest.mark.parametrize("samples", [20, 60, 150, 199, 400])
@pytest.mark.parametrize("hold", [1, 2, 5, 12])
def test_a_short_random_excitation_repeats_by_chance_alone(samples, hold):
    """Two values held for a while are alike at some lag in many stretches of a few samples."""
    for seed in range(5):
        rng = np.random.default_rng([seed, samples, hold])
        x = np.repeat(rng.choice([-1.0, 1.0], samples // hold + 1), hold)[:samples, None]
        assert repeats(x) is None


def record_of(i_e, y=None):
    rng = np.random.default_rng(7)
    y = 1e-5 * rng.standard_normal(i_e.shape) if y is None else y
    return Record.from_arrays(i_e=i_e, y=y, sample_rate=1e4, axes=["A_zeta"])


def test_a_wrong_sample_is_mended_and_told():
    i_e = prbs(8, amplitude=0.5, hold=2, periods=4)
    dirty = i_e.copy()
    dirty[700, 0] = 123.0
    record = record_of(dirty)
    assert record.period == 510
    np.testing.assert_array_equal(record.i_e, i_e)
    found = the(record, "wrong_sample")
    assert found.where.channel == "i_e.A_zeta"
    assert dict(found.values) == {"row": 701, "logged_a": 123.0, "usual_a": i_e[700, 0]}


def test_lost_rows_leave_three_whole_periods_of_four():
    i_e = prbs(8, amplitude=0.5, hold=2, periods=4)
    record = record_of(np.delete(i_e, slice(1000, 1007), axis=0))
    assert record.period == 510
    assert record.periods == 3
    whole = record.i_e[: 3 * 510].reshape(3, 510)
    assert (whole == whole[0]).all()
    assert codes(record) == ["current_not_recorded", "rows_lost", "pieces_joined"]
    assert the(record, "rows_lost").values["count"] == 7


@pytest.mark.parametrize("seed", range(10))
def test_spikes_are_left_out_and_told(seed):
    rng = np.random.default_rng(seed)
    i_e = prbs(8, amplitude=0.5, hold=2, periods=5)
    smooth = np.convolve(np.tile(i_e[:510, 0], 6), np.ones(40) / 40)[510 : 510 + len(i_e)]
    clean = 1e-5 * smooth[:, None] + 1e-8 * rng.standard_normal(i_e.shape)
    dirty, row = clean.copy(), int(rng.integers(150, 2400))
    dirty[row, 0] += 4.0 * clean.std()
    record = record_of(i_e, dirty)
    np.testing.assert_array_equal(np.flatnonzero(record.y[:, 0] != dirty[:, 0]), [row])
    assert abs(record.y[row, 0] - clean[row, 0]) < 1e-7
    found = the(record, "spikes")
    assert (found.where.channel, found.values["rows"], found.values["read"]) == ("y.A_zeta", [row + 1], [dirty[row, 0]])
    assert "spikes" not in codes(record_of(i_e, clean))
