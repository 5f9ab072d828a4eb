"""Parameters that change during a record: seen where they do, and not where nothing changes."""

import pytest

import ambid
from ambid.diagnosis import diagnose
from ambid.diagnosis.drift import Change, changes_of, largest_change
from ambid.effects import find
from hidden.bench import simulate
from hidden.experiment import experiment
from hidden.families import BENCHES
from hidden.null_cells import BLOCK, cell, made
from hidden.one_axis import ONE_AXIS, record
from tiers import first_fast

BENCH = BENCHES["bench"]


def measured(own, hidden, seed, *, periods=6, order=9, rig=None, hold=None):
    rig, hold = rig or own.rig, hold or own.hold
    i_e = ambid.prbs(order, amplitude=own.amplitude, hold=hold, axes=len(rig.axes), periods=periods, seed=seed)
    return simulate(rig, i_e, hidden, seed=seed, period=hold * (2**order - 1), **own.truth, **own.noise)


def change_in(comparison) -> Change | None:
    """Beyond chance."""
    return largest_change(changes_of(comparison))


def with_light_modes(own):
    """Bending modes of 0.3 % damping, split by the speed; a digital controller."""
    rotor = own.rig.rotor.model_copy(update={"modal_damping": 0.003})
    controller = own.rig.controller.model_copy(update={"implementation": "digital"})
    return own.rig.replace(rotor=rotor, controller=controller, speed=300.0)


@pytest.mark.parametrize("own", [ONE_AXIS, BENCH], ids=["one axis", "two bearings"])
@pytest.mark.parametrize("fraction", first_fast([0.15, -0.05]))
def test_a_force_that_drifts_is_seen_and_its_size_is_right(own, fraction):
    """A ramp of all forces, K_i and K_s being nearly alike."""
    record = measured(own, {"force_current_drift": {"fraction": fraction}}, 1)
    change = change_in(ambid.identify(own.rig, record).comparison)
    assert change is not None
    assert change.cycles == 0
    assert change.parameter.startswith("K_")
    settled = 5 / 6  # of the record
    if change.parameter.startswith("K_i"):
        assert change.relative == pytest.approx(fraction * settled, rel=0.3)


def test_a_stiffness_that_swings_is_seen_at_its_frequency():
    record = measured(ONE_AXIS, {"parametric_stiffness": {"stiffness": 4e4, "frequency_hz": 1.4}}, 1, periods=8)
    change = change_in(ambid.identify(ONE_AXIS.rig, record).comparison)
    assert change is not None
    assert change.cycles == 2
    assert change.frequency_hz == pytest.approx(1.4, rel=0.01)


@pytest.mark.parametrize(("effect", "cycles"), first_fast([("force_current_drift", 0), ("parametric_stiffness", 6)]))
def test_a_small_change_does_not_hide_in_the_noise_that_it_raises(effect, cycles):
    """Half a per cent of K_i, or of K_s at 3.7 Hz, more cycles a record than there are periods."""
    rig, record, _, _ = experiment(effect, "clear", 5, kind="compressor")
    change = change_in(ambid.identify(rig, record).comparison)
    assert change is not None
    assert change.cycles == cycles


def test_what_all_forces_do_together_is_seen_where_none_stands_out():
    """A tenth of a per cent, such as of magnets that warm."""
    record = measured(BENCH, {"force_current_drift": {"fraction": 0.001}}, 1, periods=4)
    change = change_in(ambid.identify(BENCH.rig, record).comparison)
    assert change is not None
    assert (change.parameter, change.cycles) in (("K_i", 0), ("K_s", 0))


@pytest.mark.slow
def test_what_each_of_two_records_shows_a_little_of_is_likely_in_both():
    train, validate = (
        measured(BENCH, {"parametric_stiffness": {"stiffness": 4e3, "frequency_hz": 3.7}}, seed, periods=4)
        for seed in (1, 2)
    )
    fit = ambid.identify(BENCH.rig, train).comparison
    assert change_in(fit) is None
    assert change_in(ambid.compare(fit.model, validate).renewed()) is None
    found = diagnose(BENCH.rig, train, validate=validate, catalogue=[find("loop_delay"), find("seal_forces")])
    assert found.fit.is_adequate
    assert found.probabilities.something_else > 0.5


PEAKED = [
    k
    for k in range(3 * BLOCK)
    if (own := cell(k)).machine in ("bench", "small") and own.damping == 0.001 and own.periods >= 4 and own.order < 9
]
"""Modes of 0.1 %: there the noise has peaks, and a pattern may have nearly all of its energy on one line."""


@pytest.mark.parametrize("cells", first_fast([PEAKED[:1], PEAKED[::2]]), ids=["one", "many"])
def test_a_peak_of_noise_on_a_line_or_two_is_no_change(cells):
    """In one of a hundred records, at the most."""
    found = [change_in(ambid.identify(*made(index)).comparison) for index in cells]
    assert sum(own is not None for own in found) <= 0.01 * len(cells)


def test_a_record_of_a_drifting_force_is_not_adequate():
    found = diagnose(ONE_AXIS.rig, measured(ONE_AXIS, {"force_current_drift": {"fraction": 0.15}}, 1))
    assert found.verdict != "adequate"
    (change,) = (own for own in found.findings if own.code == "parameter_seems_to_change")
    (drift,) = (own for own in found.to_json()["adequacy"] if own["test"] == "drift")
    assert drift["statistic"] == pytest.approx(change.values["power"])
    assert drift["statistic"] > drift["limit"]


MACHINES = {
    "one axis": (ONE_AXIS, {}),
    "one axis, short periods": (ONE_AXIS, {"order": 7, "hold": 1, "periods": 12}),
    "two bearings": (BENCH, {}),
    "two bearings, digital, periods of 1022": (
        BENCH,
        {
            "order": 9,
            "hold": 2,
            "periods": 10,
            "rig": BENCH.rig.replace(controller=BENCH.rig.controller.model_copy(update={"implementation": "digital"})),
        },
    ),
    "light modes, split by speed": (BENCH, {"rig": with_light_modes(BENCH), "periods": 10, "hold": 2}),
}


@pytest.mark.parametrize("machine", first_fast(MACHINES, 2))
def test_where_nothing_changes_nothing_is_said(machine):
    """Noise is taken for a change in one of ten thousand records."""
    own, settings = MACHINES[machine]
    for seed in range(5):
        record = measured(own, {}, seed, **settings)
        found = ambid.identify(settings.get("rig", own.rig), record)
        assert found.is_adequate
        assert change_in(found.comparison) is None, seed


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_that_a_limit_modulates_is_no_change(seed):
    """It follows the motion at all rates alike; a parameter that changes does so at some."""
    run = record({"command_saturation": {"level": 1.2}}, seed)
    (axis,) = ONE_AXIS.rig.axes
    truth = {f"K_i.{axis}": ONE_AXIS.K_i[0], f"K_s.{axis}": ONE_AXIS.K_s[0], "tau_e": ONE_AXIS.tau_e}
    model = ambid.Model(ONE_AXIS.rig).with_values(truth).add("command_saturation", {"inverse_limit": 1.0 / 1.2})
    assert change_in(ambid.compare(model, run).renewed()) is None


def test_fewer_than_three_settled_periods_say_nothing():
    record = measured(ONE_AXIS, {"force_current_drift": {"fraction": 0.15}}, 1, periods=3)
    assert change_in(ambid.identify(ONE_AXIS.rig, record).comparison) is None
