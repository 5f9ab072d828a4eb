"""Cards that are late, clocks that run off, samples that y alone lost: on machines of the independent simulator."""

import numpy as np
import pytest

from ambid import diagnose
from ambid.checking import check
from ambid.checking.clocks import Clock, out_of_step
from ambid.checking.nominal import NominalLoop
from ambid.excitation import prbs
from ambid.record import Record
from benchmarks.dirt_kinds import MARGIN, shifted, soiled
from benchmarks.null_cells import made
from hidden.bench import simulate
from hidden.experiment import experiment
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS


def dirty(bench, kind, seed, hidden=None):
    """A record with one kind of dirt."""
    one = bench.excitation(bench.amplitude, seed)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    record = simulate(bench.rig, i_e, hidden or {}, period=bench.period, seed=seed, **bench.truth, **bench.noise)
    return soiled(record, kind, np.random.default_rng(seed), bench.rig)


def findings(bench, kind, seed, hidden=None, severity="fault"):
    """What `check` says of it, worst first."""
    return [
        found for found in check(bench.rig, [dirty(bench, kind, seed, hidden)]).findings if found.severity == severity
    ]


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
    assert not [f for f in findings(ONE_AXIS, "clean", 1, hidden, "warning") if f.is_of_instant]


def test_voltage_that_motion_induces_is_no_early_sensor():
    """A lead of y by 0.14 sample would do as well for one axis of the second record."""
    rig, train, kept_back, _ = experiment(("back_emf",), "clear", 2401, kind="other_rotor")
    assert not [own for own in check(rig, [*train, *kept_back]).findings if own.severity == "fault"]


@pytest.mark.parametrize("bench", [ONE_AXIS, BENCHES["bench"]], ids=["one axis", "four axes"])
def test_currents_that_are_read_late_are_told(bench):
    """No loop brings i_c a sample before what it follows from."""
    (found,) = [own for own in findings(bench, "late_i_c", 2, severity="warning") if own.is_of_instant]
    assert found.where == f"record: i_c on {', '.join(bench.rig.axes)}: instant"
    assert samples_told(found) == pytest.approx(1.0, abs=0.02)
    assert found.todo.startswith("move i_c to times later by")


def test_a_delay_of_the_loop_is_noted():
    (found,) = [
        own for own in findings(ONE_AXIS, "clean", 2, {"loop_delay": NAMED["loop_delay"]}, "note") if own.is_of_instant
    ]
    delay = NAMED["loop_delay"]["seconds"] * ONE_AXIS.rig.sample_rate
    assert samples_told(found) == pytest.approx(delay, abs=0.05)


def test_what_nothing_explains_points_to_the_late_currents():
    found = diagnose(ONE_AXIS.rig, dirty(ONE_AXIS, "late_i_c", 2))
    assert found.verdict == "none_of_the_candidates"
    assert found.next_experiment.startswith("move i_c to times later by")
    assert any("read that much after y" in note for note in found.notes)


@pytest.mark.slow
def test_what_nothing_explains_tells_of_the_one_current_that_comes_late():
    """An amplifier that is slower on one axis may be the cause as well, so that nothing is said to be moved."""
    bench = BENCHES["bench"]
    clean = dirty(bench, "clean", 2)
    i_c = clean.i_c.copy()
    i_c[1:, 2] = i_c[:-1, 2]
    found = diagnose(
        bench.rig,
        Record.from_arrays(
            i_e=clean.i_e, y=clean.y, i_c=i_c, sample_rate=bench.rig.sample_rate, axes=bench.rig.axes, rig=bench.rig
        ),
    )
    assert found.verdict == "none_of_the_candidates"
    (note,) = [note for note in found.notes if "instant" in note]
    assert note.startswith(f"record: i_c on {bench.rig.axes[2]}: instant")
    assert float(note.split(" sample")[0].split()[-1]) == pytest.approx(1.0, abs=0.1)


def test_a_transient_that_dies_away_over_periods_is_no_lost_sample():
    """A slow mode that still rings where the record is judged shifts its first periods against the others."""
    rig, record = made(884)
    assert not [found for found in check(rig, [record]).findings if found.stops_diagnosis]


SLOW = {
    "one axis, slow": (ONE_AXIS, 7, 32, 5),
    "one axis": (ONE_AXIS, 9, 4, 4),
    "one axis, three periods": (ONE_AXIS, 9, 4, 3),
    "four axes, slow": (BENCHES["bench"], 7, 32, 5),
}
"""Bench, order and hold of the PRBS, periods: the slower, the more a force that drifts moves y like a clock."""


def repeated(own, seed, *, drift=None, ppm=0.0):
    """A record with a K_i that drifts, or with a clock of y and i_c that is off."""
    bench, order, hold, periods = own
    axes, period = len(bench.rig.axes), (2**order - 1) * hold
    one = prbs(order, amplitude=bench.amplitude, hold=hold, axes=axes, periods=1, seed=seed)
    i_e = np.take(one, np.arange(-MARGIN, periods * period + MARGIN), axis=0, mode="wrap")
    hidden = {} if drift is None else {"force_current_drift": {"fraction": drift}}
    record = simulate(bench.rig, i_e, hidden, period=period, seed=seed, **bench.truth, **bench.noise)
    late, inner = -1e-6 * ppm * np.arange(len(i_e)), slice(MARGIN, -MARGIN)
    read = {key: (shifted(own, late) if ppm else own)[inner] for key, own in (("y", record.y), ("i_c", record.i_c))}
    return Record.from_arrays(
        i_e=i_e[inner], **read, sample_rate=bench.rig.sample_rate, axes=bench.rig.axes, rig=bench.rig
    )


@pytest.mark.parametrize("own", SLOW.values(), ids=SLOW)
@pytest.mark.parametrize("fraction", [-0.2, -0.05, 0.02, 0.1, 0.3])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_force_that_drifts_is_no_clock_and_no_lost_sample(own, fraction, seed):
    found = check(own[0].rig, [repeated(own, seed, drift=fraction)]).findings
    assert not [f.what for f in found if "clock" in f.what or "lost" in f.what or "repeated" in f.what]
    assert not [f.what for f in found if f.stops_diagnosis]


@pytest.mark.parametrize("own", [SLOW["one axis, slow"], SLOW["one axis"], SLOW["four axes, slow"]])
@pytest.mark.parametrize("ppm", [-100.0, -30.0, 100.0, 1000.0])
def test_a_clock_is_told_with_its_size_and_sign(own, ppm):
    (clock,) = [f for f in check(own[0].rig, [repeated(own, 1, ppm=ppm)]).findings if "clock" in f.what]
    told, direction = clock.what.split(" ppm ")
    assert float(told.split()[-1]) == pytest.approx(abs(ppm), rel=0.05)
    assert direction.startswith("faster" if ppm > 0.0 else "slower")
    assert clock.stops_diagnosis


def test_a_clock_is_told_where_the_nominal_loop_is_unstable():
    """There is no nominal drift to hold it against; that it leaves little must do."""
    own = SLOW["one axis, slow"]
    rig = own[0].rig
    weak = rig.replace(controller=rig.controller.model_copy(update={"proportional": 0.3 * rig.controller.proportional}))
    loop = NominalLoop(weak)
    assert loop.gain_factor is None
    assert [type(found) for found in out_of_step(repeated(own, 1, ppm=100.0), loop)] == [Clock]
    assert not out_of_step(repeated(own, 1, drift=0.1), loop)
