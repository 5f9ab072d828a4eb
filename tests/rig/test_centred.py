"""Magnets that centre the rotor, and machines so slow that they are sampled at a few hertz."""

import numpy as np
import pytest

import ambid
from ambid.effects import find
from ambid.rig import PointMassRotor, Rig
from places import BENCH, LEVITATOR

SLOW = Rig.load(LEVITATOR).replace(
    sample_rate=20.0,
    rotor=PointMassRotor(mass=5.0, mass_damping=0.4),
    bearings=(
        Rig.load(LEVITATOR).bearings[0].model_copy(
            update={"bias_current": 1.0, "air_gap": 5e-3, "force_current": (8.0,), "force_displacement": (-900.0,)}
        ),
    ),
    amplifier={"time_constant": 0.01},
    actuator={"time_constant": 0.03},
    controller={"kind": "pid", "implementation": "analog", "proportional": 20.0, "derivative": 4.0,
                "derivative_time_constant": 0.02},
    tolerance={"exact": True},
)  # fmt: skip


def test_magnets_that_centre_are_a_note(tmp_path):
    text = BENCH.read_text(encoding="utf-8").replace("[2200000.0, 2200000.0]", "[-2200000.0, -2200000.0]")
    rig = Rig.from_toml(text)
    assert Rig.from_toml(rig.to_toml()) == rig
    shown = [finding for finding in ambid.check(rig).findings if finding.code == "magnets_centre"]
    assert [(own.severity, own.where.axis, own.values["k_s"]) for own in shown] == [
        ("note", "A_zeta", -2.2e6),
        ("note", "A_eta", -2.2e6),
    ]


def test_the_laws_of_attracting_magnets_are_not_tried_on_them():
    assert find("force_nonlinearity").why_not(SLOW) == find("flux_saturation").why_not(SLOW) != ""
    assert not find("seal_forces").why_not(Rig.load(BENCH))


@pytest.fixture(scope="module")
def record():
    truth = ambid.Model(SLOW).with_values({"K_i.A_zeta": 8.6, "K_s.A_zeta": -840.0, "tau_e": 0.033})
    return truth.virtual_experiment(ambid.prbs(8, amplitude=0.2, hold=2, axes=1, periods=4), seed=3)


def test_a_slow_machine_with_a_centring_magnet_is_identified(record, tmp_path):
    found = ambid.identify(SLOW, record)
    for name, value in (("K_i.A_zeta", 8.6), ("K_s.A_zeta", -840.0), ("tau_e", 0.033)):
        own = found[name]
        assert abs(own.value - value) < 4.0 * own.std_error
        assert own.std_error < 0.1 * abs(value)
    assert "magnets_centre" in {finding.code for finding in found.findings}
    model = found.model
    model.save(tmp_path / "model.json")
    assert ambid.Model.load(tmp_path / "model.json").parameters == model.parameters
    assert ambid.check(SLOW, record).findings is not None


def test_a_slow_machine_is_ranked(record):
    ranking = ambid.rank(ambid.compare(ambid.identify(SLOW, record).model, record))
    scores = [candidate.score for candidate in ranking.candidates]
    assert "foundation_resonance" in {candidate.effect.name for candidate in ranking.candidates}
    assert np.isfinite(scores).all()
