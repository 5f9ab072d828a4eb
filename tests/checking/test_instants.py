"""Cards that are late, clocks that run off, samples that y alone lost: on machines of the independent simulator."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import diagnose
from ambid.checking import check, stops_diagnosis
from ambid.checking.clocks import Clock, out_of_step
from ambid.checking.nominal import NominalLoop
from ambid.excitation import prbs
from ambid.record import Record
from hidden.bench import simulate
from hidden.dirt import MARGIN, shifted, soiled
from hidden.experiment import experiment
from hidden.families import BENCHES
from hidden.null_cells import made
from hidden.one_axis import NAMED, ONE_AXIS
from hidden.strangers import stranger
from hidden.tolerances import machine_off
from tiers import first_fast

ONE = pytest.approx(1.0, abs=0.02)
LIKE_A_DELAY = {None, "loop_delay", "sensor_lag", "sampling_skew", "amplifier_voltage_limit", "back_emf"}
"""Physics that comes nearest to an instant, or to a channel, of its own."""


def dirty(bench, kind, seed, hidden=None):
    """A record with one kind of dirt."""
    one = bench.excitation(bench.amplitude, seed)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    record = simulate(bench.rig, i_e, hidden or {}, period=bench.period, seed=seed, **bench.truth, **bench.noise)
    return soiled(record, kind, np.random.default_rng(seed), bench.rig)


def findings(bench, kind, seed, hidden=None, severity="error"):
    """What `check` says of it, worst first."""
    return [
        found for found in check(bench.rig, [dirty(bench, kind, seed, hidden)]).findings if found.severity == severity
    ]


EACH_KIND = {
    "late_card": ("channel_delay", "y", {"delay_samples": ONE, "reference": ["i_e"]}),
    "late_i_e": ("channel_delay", "i_e", {"delay_samples": ONE, "reference": ["y", "i_c"]}),
    "drifting_clock": ("clock_difference", "y", {}),
    "lost_y": ("samples_lost", "y.A_zeta", {"samples": 1}),
}


@pytest.mark.parametrize(
    ("axes", "kind"),
    [
        *(("one", kind) for kind in EACH_KIND),
        *(pytest.param("four", kind, marks=pytest.mark.slow) for kind in EACH_KIND),
    ],
)
def test_each_kind_is_named(axes, kind):
    code, channel, values = EACH_KIND[kind]
    found = findings(ONE_AXIS if axes == "one" else BENCHES["bench"], kind, 2)[0]
    assert (found.code, found.where.record, found.where.channel) == (code, "record", channel)
    assert {key: found.values[key] for key in values} == values
    assert stops_diagnosis(found) == (code != "channel_delay")  # for that there is a hypothesis
    if kind == "drifting_clock":
        assert abs(found.values["difference"]) == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_a_fraction_of_a_sample_comes_out_right(seed):
    late = np.random.default_rng(seed).uniform(0.1, 0.3)  # what the dirt draws first
    (found,) = findings(ONE_AXIS, "late_y", seed)
    assert found.values["delay_samples"] == pytest.approx(late, abs=0.02)


@pytest.mark.parametrize(
    "effect", [own if own in LIKE_A_DELAY else pytest.param(own, marks=pytest.mark.slow) for own in [None, *NAMED]]
)
def test_physics_is_no_late_card(effect):
    """What moves the controller's equation or what does not repeat, strongly, is none of the above."""
    hidden = {} if effect is None else {effect: NAMED[effect]}
    own = dirty(ONE_AXIS, "clean", 1, hidden)
    found = {own.code for own in check(ONE_AXIS.rig, [own]).findings}
    assert found.isdisjoint({"channel_delay", "clock_difference", "current_ahead"})


def test_voltage_that_motion_induces_is_no_early_sensor():
    """A lead of y by 0.14 sample would do as well for one axis of the second record."""
    rig, train, kept_back, _ = experiment(("back_emf",), "clear", 2401, kind="other_rotor")
    assert not [own for own in check(rig, [*train, *kept_back]).findings if own.severity == "error"]


@pytest.mark.parametrize("bench", [ONE_AXIS, BENCHES["bench"]], ids=["one axis", "four axes"])
def test_currents_that_are_read_late_are_told(bench):
    """No loop brings i_c a sample before what it follows from."""
    (found,) = [own for own in findings(bench, "late_i_c", 2, severity="warning") if own.code == "current_ahead"]
    assert (found.where.record, found.where.channel) == ("record", "i_c")
    assert found.values["axes"] == list(bench.rig.axes)
    assert found.values["advance_samples"] == pytest.approx(1.0, abs=0.02)


def test_a_delay_of_the_loop_is_noted():
    notes = findings(ONE_AXIS, "clean", 2, {"loop_delay": NAMED["loop_delay"]}, "note")
    (found,) = [own for own in notes if own.code == "current_behind"]
    delay = NAMED["loop_delay"]["seconds"]
    assert found.values["delay_s"] == pytest.approx(delay, abs=0.05 / ONE_AXIS.rig.sample_rate)


def test_currents_that_are_read_a_sample_late_are_named():
    record = dirty(ONE_AXIS, "late_i_c", 2)
    found = diagnose(ONE_AXIS.rig, record)
    (ahead,) = [own for own in check(ONE_AXIS.rig, [record]).findings if own.code == "current_ahead"]
    assert found.verdict == "explained"
    assert [effect.name for effect in found.model.effects] == ["sampling_skew"]
    late = found.model["sampling_skew.current_late"].value
    assert late == pytest.approx(1.0 / ONE_AXIS.rig.sample_rate, rel=0.01)
    assert late == pytest.approx(ahead.values["advance_s"], rel=0.01)


@pytest.mark.slow
def test_what_nothing_explains_tells_of_the_one_current_that_comes_late():
    """An amplifier that is slower on one axis may be the cause as well, so that nothing is said to be moved."""
    bench = replace(BENCHES["bench"], order=7)
    clean = dirty(bench, "clean", 3)
    i_c = clean.i_c.copy()
    i_c[1:, 2] = i_c[:-1, 2]
    record = Record.from_arrays(
        i_e=clean.i_e, y=clean.y, i_c=i_c, sample_rate=bench.rig.sample_rate, axes=bench.rig.axes, rig=bench.rig
    )
    found = diagnose(bench.rig, record)
    (behind,) = [own for own in check(bench.rig, [record]).findings if own.code == "current_behind"]
    assert found.verdict == "none_of_the_candidates"
    assert behind in found.findings
    assert behind.values["axes"] == [bench.rig.axes[2]]
    assert behind.values["delay_samples"] == pytest.approx(1.0, abs=0.1)


def test_a_transient_that_dies_away_over_periods_is_no_lost_sample():
    """A slow mode that still rings where the record is judged shifts its first periods against the others."""
    rig, record = made(884)
    assert not [found for found in check(rig, [record]).findings if stops_diagnosis(found)]


def spindle(seed, read_late=0.0):
    """Turning, out of balance and rubbed by a seal, under commands that are late by more than a sample; from rest."""
    own = replace(BENCHES["compressor"], order=7, periods=4)
    controller = own.rig.controller.model_copy(update={"delay_samples": 1.3})
    rig = own.rig.replace(controller=controller, speed=942.5)
    hidden = {
        "unbalance": {"mass_eccentricity": 4e-6, "z": own.middle, "phase": 0.7},
        "seal_forces": {"z": 0.0, "direct": 6e4, "cross": 1.1e5, "damping": 60.0},
    }
    if read_late:
        hidden["sampling_skew"] = {"seconds": read_late / rig.sample_rate}
    i_e = own.excitation(own.amplitude, seed)
    return rig, simulate(rig, i_e, hidden, seed=seed, period=own.period, **own.truth, **own.noise)


def instants(rig, record):
    """Findings of when channels were read."""
    codes = ("channel_delay", "current_ahead", "current_behind")
    return [found for found in check(rig, record).findings if found.code in codes]


@pytest.mark.parametrize("seed", first_fast(range(8)))
def test_a_turning_rotor_that_begins_at_rest_tells_no_instant(seed):
    """Its first period is a third transient, and turning puts a line between those that are excited."""
    rig, record = spindle(seed)
    first, last = record.y[: record.period], record.y[-record.period :]
    assert (first - last).std() > 0.2 * last.std()
    assert instants(rig, record) == []


@pytest.mark.slow
def test_and_it_tells_one_where_there_is_one():
    (found,) = instants(*spindle(0, read_late=1.0))
    assert found.code == "current_ahead"
    assert found.values["advance_samples"] == pytest.approx(1.0, abs=0.1)


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
@pytest.mark.parametrize(
    ("fraction", "seed"),
    [
        (-0.2, 1),
        (0.02, 1),
        *(pytest.param(fraction, seed, marks=pytest.mark.slow) for fraction in (-0.05, 0.1, 0.3) for seed in (1,)),
    ],
)
def test_a_force_that_drifts_is_no_clock_and_no_lost_sample(own, fraction, seed):
    found = check(own[0].rig, [repeated(own, seed, drift=fraction)]).findings
    assert {own.code for own in found}.isdisjoint({"clock_difference", "samples_lost", "samples_repeated"})
    assert not [own for own in found if stops_diagnosis(own)]


@pytest.mark.parametrize(
    ("bench", "ppm"),
    [
        ("one axis, slow", -100.0),
        ("one axis", -30.0),
        *(
            pytest.param(bench, ppm, marks=pytest.mark.slow)
            for bench, sizes in {
                "one axis, slow": (-30.0, 1000.0),
                "one axis": (100.0,),
                "four axes, slow": (-100.0, 1000.0),
            }.items()
            for ppm in sizes
        ),
    ],
)
def test_a_clock_is_told_with_its_size_and_sign(bench, ppm):
    own = SLOW[bench]
    findings = check(own[0].rig, [repeated(own, 1, ppm=ppm)]).findings
    (clock,) = [found for found in findings if found.code == "clock_difference"]
    assert clock.values["difference"] == pytest.approx(1e-6 * ppm, rel=0.05)
    assert stops_diagnosis(clock)


def test_noise_that_rings_and_wanders_is_no_clock():
    """A spindle drawn at random, whose noise stands at its lowest lines and at a pole, where it is alike from period to
    period: what it shifts one against the other by stands out from white noise of its power by ten standard errors."""
    bench = replace(stranger(88654), order=8)
    off = machine_off(bench.rig, 88654)
    hidden = {"bending_mode_shift": {"frequency_factor": 1.01}}
    for k in range(2):
        i_e = bench.excitation(0.0763, 88654 + k)
        record = off.record(i_e, 177308 + k, hidden, period=bench.period, **bench.truth, **bench.noise)
        assert not [own for own in out_of_step(record, NominalLoop(off.known)) if isinstance(own, Clock)]


def test_a_clock_is_told_where_the_nominal_loop_is_unstable():
    """There is no nominal drift to hold it against; that it leaves little must do."""
    own = SLOW["one axis, slow"]
    rig = own[0].rig
    weak = rig.replace(controller=rig.controller.model_copy(update={"proportional": 0.3 * rig.controller.proportional}))
    loop = NominalLoop(weak)
    assert loop.gain_factor is None
    assert [type(found) for found in out_of_step(repeated(own, 1, ppm=100.0), loop)] == [Clock]
    assert not out_of_step(repeated(own, 1, drift=0.1), loop)
