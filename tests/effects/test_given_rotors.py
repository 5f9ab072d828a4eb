"""Effects on a rotor that is given by its matrices or its modes, and why they are not tried on one or the other rig."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ambid
from ambid.diagnosis import diagnose, rank
from ambid.effects import CATALOGUE, Effect, EffectParameter, Seen, find
from ambid.effects.damping import ExternalDamping
from ambid.effects.disturbance import PeriodicDisturbance
from ambid.effects.rotor import Unbalance
from ambid.effects.support import CouplingStiffness, SealForces
from ambid.errors import ModelError, RigError
from ambid.loop.geometry import rotor_of
from ambid.rig import MatrixRotor, ModalRotor, PointMassRotor, Rig
from ambid.rotor import assemble, with_more_modes
from hidden.bench import measured
from hidden.families import BENCHES, voltage_driven
from hidden.one_axis import ONE_AXIS, record

SPEED = 600.0
CASES = {effect.name: effect for effect in CATALOGUE} | {
    "seal_forces between nodes": SealForces(0.4321),
    "external_damping between nodes": ExternalDamping(0.4321),
    "coupling_stiffness at z = 0": CouplingStiffness(0),
    "unbalance at the bearings": Unbalance(),
    "unbalance between nodes": Unbalance(0.4321),
    "periodic force": PeriodicDisturbance(50.0, "force", "each"),
}


@pytest.fixture(scope="module")
def turning(rig):
    return rig.replace(speed=SPEED)


def by_matrices(rig: Rig, more: int = 0, **changes) -> Rig:
    """The same machine with the matrices of its rotor, of the mesh for so many further modes."""
    spec = rig.rotor
    places = [z for b in rig.bearings for z in (b.position, b.sensor_position)]
    model = assemble(with_more_modes(spec, more), places)
    kept = ("flexible_modes", "modal_damping", "bending_frequencies_hz")
    given = {"node_positions": model.z, "M": model.M, "K": model.K, "G": model.G}
    return rig.replace(rotor=MatrixRotor(**{**given, **{key: getattr(spec, key) for key in kept}, **changes}))


def by_modes(rig: Rig, more: int = 0, at: slice = slice(None), mixed: float = 0.0, **changes) -> Rig:
    """The same machine with the modes of its rotor, at some of its nodes; the rigid ones turned by an angle [rad]."""
    found = rotor_of(rig, more)
    n = len(found.frequencies_rad_s)
    mix = np.eye(n)
    mix[:2, :2] = [[np.cos(mixed), np.sin(mixed)], [-np.sin(mixed), np.cos(mixed)]]
    positions = found.positions[at]
    given = {
        "frequencies_hz": found.frequencies_rad_s / (2.0 * np.pi),
        "damping": found.damping,
        "positions": positions,
        "shapes": mix @ np.array([found.shape(z) for z in positions]).T,
        "gyroscopic": mix @ found.gyroscopic[:n, n:] @ mix.T,
        "flexible_modes": rig.rotor.flexible_modes,
    }
    return rig.replace(rotor=ModalRotor(**given | changes))


GIVEN = {
    "matrices": by_matrices,
    "modes": by_modes,
    "modes, rigid ones mixed": lambda rig, more=0: by_modes(rig, more, mixed=0.7),
}


@cache
def given_by(way: str, rig: Rig, more: int) -> Rig:
    return GIVEN[way](rig, more)


@cache
def response(case: str, shaft: Rig, rig: Rig) -> np.ndarray:
    """Of a machine with an effect of the probe values that it has on the shaft."""
    effect, i_e = CASES[case], ambid.prbs(7, amplitude=1.0, hold=3, axes=4)
    model = ambid.Model(rig).add(effect, {p.name: p.probe for p in effect.parameters(shaft)})
    return model.loop.simulate(model.theta, np.hstack([i_e, effect.waveform(rig, len(i_e), None)]))


@cache
def response_without(shaft: Rig) -> np.ndarray:
    base = ambid.Model(shaft)
    return base.loop.simulate(base.theta, ambid.prbs(7, amplitude=1.0, hold=3, axes=4))


@pytest.mark.parametrize("given", GIVEN)
@pytest.mark.parametrize("case", CASES)
def test_the_response_is_that_of_the_shaft(turning, case, given):
    turning = turning if CASES[case].parameters(turning) else voltage_driven(turning)
    other = given_by(given, turning, CASES[case].flexible_modes(turning))
    expected, found = response(case, turning, turning), response(case, turning, other)
    peak = np.abs(expected).max(axis=0)
    np.testing.assert_array_less(np.abs(found - expected).max(axis=0), 1e-9 * peak)
    moved = np.abs(expected - response_without(turning)).max(axis=0)
    assert (moved > 1e-7 * peak).any(), "the effect must show"


def test_omitted_modes_of_a_list_bring_their_own_damping(turning):
    rigid = turning.replace(rotor=turning.rotor.model_copy(update={"flexible_modes": 0}))
    other = by_modes(rigid, 2, damping=[0.0, 0.0, 0.011, 0.022])
    own = {p.name: p.probe for p in find("rotor_bending_mode").parameters(other)}
    assert (own["damping_1"], own["damping_2"]) == (0.011, 0.022)
    at_hand = {p.name: p.probe for p in find("rotor_bending_mode").parameters(rigid)}
    assert own["frequency_2_hz"] == pytest.approx(at_hand["frequency_2_hz"], rel=1e-12)


def test_one_omitted_mode_is_brought_where_a_list_has_no_more(turning):
    assert len(find("rotor_bending_mode").parameters(by_modes(turning, 1))) == 3


# Why not --------------------------------------------------------------------------------------------------------------


def coarse(rig: Rig) -> Rig:
    """Modes at the magnets and sensors alone, too few for a bending mode between them."""
    found = rotor_of(rig)
    positions = sorted(z for b in rig.bearings for z in (b.position, b.sensor_position))
    shapes = np.array([found.shape(z) for z in positions]).T
    return by_modes(rig, positions=positions, shapes=shapes)


def ideal(rig: Rig) -> Rig:
    """No lag in amplifier and actuator."""
    return rig.replace(amplifier={"time_constant": 0.0}, actuator={"has_lag": False})


RIGS = {
    "shaft": lambda rig: rig,
    "shaft at rest": lambda rig: rig.replace(speed=0.0),
    "rigid shaft": lambda rig: rig.replace(rotor=rig.rotor.model_copy(update={"flexible_modes": 0})),
    "matrices": by_matrices,
    "matrices without G": lambda rig: by_matrices(rig, G=None),
    "modes": by_modes,
    "modes, two left out": lambda rig: by_modes(rig, 2),
    "modes at four places": coarse,
    "modes without gyroscopic": lambda rig: by_modes(rig, gyroscopic=None),
    "rigid modes": lambda rig: by_modes(rig, flexible_modes=0),
    "ideal amplifier": ideal,
    "point mass": lambda _: ONE_AXIS.rig,
    "ideal point mass": lambda _: ideal(ONE_AXIS.rig),
}
DROPPED = {
    "shaft": (),
    "shaft at rest": ("gyroscopic_coupling", "internal_damping", "sensor_runout", "unbalance"),
    "rigid shaft": ("bending_mode_shift",),
    "matrices": (),
    "matrices without G": ("gyroscopic_coupling",),
    "modes": ("rotor_bending_mode",),
    "modes, two left out": (),
    "modes at four places": ("rotor_bending_mode", "sensor_position_error"),
    "modes without gyroscopic": ("gyroscopic_coupling", "rotor_bending_mode"),
    "rigid modes": ("bending_mode_shift",),
    "ideal amplifier": (
        "amplifier_bandwidth",
        "amplifier_voltage_limit",
        "back_emf",
        "magnetic_hysteresis",
        "sampling_skew",
    ),
}


@pytest.mark.parametrize("name", RIGS)
def test_every_effect_has_parameters_or_says_why_not(turning, name):
    rig = RIGS[name](turning)
    reasons = {effect.name: effect.why_not(rig) for effect in CATALOGUE}
    if name in DROPPED:
        assert sorted(effect for effect, why in reasons.items() if why) == sorted([*DROPPED[name], "inductance_error"])
    for effect in CATALOGUE:
        why = reasons[effect.name]
        if why:
            with pytest.raises(ModelError) as refused:
                ambid.Model(rig).add(effect)
            assert effect.name in str(refused.value)
            assert why in str(refused.value)
        else:
            own = effect.parameters(rig)
            assert own or effect.in_record, "what is there or not is of the record"
            assert ambid.Model(rig).add(effect).loop.parameters == len(ambid.Model(rig).names) + len(own)


def test_a_place_where_the_rotor_is_not_known(turning, golden):
    rig = coarse(turning)
    golden.holds(SealForces(0.43).why_not(rig))
    assert SealForces().place(rig) == 0.2, "the known place nearest to half-way"
    assert CouplingStiffness().positions(rig) == [0.14, 0.72]
    golden.holds(Unbalance(0.9).why_not(turning))
    with golden.raises(ModelError):
        _ = ambid.Model(turning, effects=[SealForces(0.9)]).loop


def test_modes_that_are_no_two_rigid_motions(turning, golden):
    found = by_modes(turning).rotor
    one = turning.replace(
        rotor=ModalRotor(
            frequencies_hz=found.frequencies_hz[1:],
            damping=found.damping[1:],
            positions=found.positions,
            shapes=found.shapes[1:],
        )
    )
    golden.holds(find("rotor_inertia_error").why_not(one))
    assert not find("bending_mode_shift").why_not(one)
    values = {"squared_frequency_1": 0.01}
    shifted = ambid.Model(one).add("bending_mode_shift", values).to_rig()
    assert shifted.rotor == one.rotor


def test_more_modes_than_are_listed_are_refused(turning, golden):
    with golden.raises(RigError):
        by_modes(turning, flexible_modes=3)


class Unplaceable(Effect):
    """An effect of one's own with neither parameters on a point mass nor variants in a quiet record."""

    name = "own"
    physics = signature = source = "the user's own idea"
    unseen = "nothing squeaks"

    def parameters(self, rig):
        return [] if isinstance(rig.rotor, PointMassRotor) else [EffectParameter("size", "1", 0.1)]

    def positions(self, rig):
        return [0.43]

    def variants(self, seen):
        return ()

    def attach(self, plant):
        """Nothing is attached where it makes no sense."""


def test_an_effect_of_ones_own_says_it_by_its_parameters_and_positions(turning, golden):
    assert Unplaceable().why_not(turning) == ""
    golden.holds(Unplaceable().why_not(ONE_AXIS.rig))
    golden.holds(Unplaceable().why_not(coarse(turning)))
    assert not Unplaceable().variants(Seen(turning, {}))


@pytest.mark.parametrize("name", ["matrices", "modes", "modes at four places", "point mass"])
def test_every_effect_is_judged_or_listed_with_a_reason(rig, name):
    machine = RIGS[name](rig)
    n = len(machine.axes)
    i_e = ambid.prbs(6, amplitude=0.3, hold=4, axes=n, periods=3)
    data = replace(ambid.Model(machine).virtual_experiment(i_e, seed=3), period=len(i_e) // 3)
    ranking = rank(ambid.compare(ambid.Model(machine), data), [*CATALOGUE, Unplaceable()])
    judged = {candidate.effect.name for candidate in ranking.candidates}
    assert judged.isdisjoint(ranking.not_tried)
    assert judged | set(ranking.not_tried) == {*(effect.name for effect in CATALOGUE), "own"}
    assert all(ranking.not_tried.values())
    assert ranking.not_tried["gyroscopic_coupling"] == find("gyroscopic_coupling").why_not(machine)
    lines = ranking.summary()
    assert all(any(effect in line and why in line for line in lines) for effect, why in ranking.not_tried.items())
    if n == 4:
        assert {"bending_mode_shift", "rotor_inertia_error", "seal_forces", "coupling_stiffness"} <= judged


def test_a_diagnosis_lists_what_was_not_tried():
    found = diagnose(ONE_AXIS.rig, record({}, 3))
    assert found.not_tried["bending_mode_shift"] == find("bending_mode_shift").why_not(ONE_AXIS.rig)
    assert found.to_json()["not_tried"] == found.not_tried
    assert "rotor_bending_mode" in str(found.history[0].ranking)


@pytest.mark.slow
@pytest.mark.parametrize("given", [by_modes, by_matrices])
def test_a_hidden_shift_of_a_given_mode_is_named(rig, given):
    machine = given(rig)
    truth = BENCHES["bench"].truth
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=4, periods=4)
    hidden = {"bending_mode_shift": {"frequency_factor": 1.003}}
    train, other = (measured(rig, share * i_e, hidden, seed=seed, **truth) for share, seed in ((1.0, 1), (0.7, 2)))
    found = diagnose(machine, train, validate=[other])
    assert found.effects == ("bending_mode_shift",), found
    assert found.verdict == "explained"
    shift = next(p.value for p in found.model.parameters if p.name == "bending_mode_shift.squared_frequency_1")
    assert shift == pytest.approx(1.003**2 - 1.0, rel=0.02)
