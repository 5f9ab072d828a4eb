"""Settings of the effects: what distinguishes variants, prints them, and comes back from a saved model."""

import json
from dataclasses import FrozenInstanceError

import pytest

import ambid
from ambid.effects import CATALOGUE, Seen, find
from ambid.effects.magnet import ForceNonlinearity
from ambid.effects.rotor import RotorBendingMode
from ambid.effects.support import FoundationResonance, SealForces
from ambid.errors import ModelError
from ambid.loop.effect import Tone

DIGITAL = {"implementation": "digital", "sample_rate": 1e4}


@pytest.fixture(scope="module")
def turning(rig):
    """A rig on which every effect makes sense and has all its variants."""
    controller = type(rig.controller)(**rig.controller.model_dump() | DIGITAL)
    return rig.replace(speed=200.0, controller=controller)


def variants(effect, rig):
    tones = (Tone(31.83, 1, 1e3), Tone(50.0, 2, 1e3))
    seen = Seen(
        rig, {"s": 3e-5, "i_ref": 1.5, "i_f": 1.5, "i_f_rate": 2e3, "i_a_free": 2e4}, tones, [0.1, 0.2, 0.3, 0.4]
    )
    return list(dict.fromkeys([effect, *effect.variants(seen)]))


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_every_variant_is_a_value_and_comes_back_from_a_file(turning, tmp_path, effect):
    path = tmp_path / "model.json"
    if reason := effect.why_not(turning):
        pytest.skip(reason)
    for variant in variants(effect, turning):
        assert type(variant)(**variant.settings()) == variant
        assert eval(repr(variant), {type(variant).__name__: type(variant)}) == variant
        model = ambid.Model(turning).add(variant)
        model.save(path)
        again = ambid.Model.load(path)
        assert again.effects == (variant,)
        assert hash(again.effects[0]) == hash(variant)
        assert again.parameters == model.parameters


def test_variants_are_told_apart(turning):
    count = {effect.name: len(variants(effect, turning)) for effect in CATALOGUE}
    assert count["rotor_bending_mode"] == 3
    assert count["foundation_resonance"] == 41
    assert count["sampling_skew"] == 2
    assert len({variant for effect in CATALOGUE for variant in variants(effect, turning)}) == sum(count.values())


def test_only_what_is_not_default_is_written(turning, tmp_path):
    assert find("seal_forces").settings() == {}
    assert SealForces(0.3).settings() == {"z": 0.3}
    ambid.Model(turning).add(RotorBendingMode(0.1)).add("force_nonlinearity").save(tmp_path / "model.json")
    written = json.loads((tmp_path / "model.json").read_text())["effects"]
    assert written == [{"name": "rotor_bending_mode", "participation": 0.1}, {"name": "force_nonlinearity"}]


def test_a_file_with_every_setting_in_it(turning, tmp_path):
    """As they were written before."""
    path = tmp_path / "model.json"
    ambid.Model(turning).add("unbalance").add("force_nonlinearity").save(path)
    content = json.loads(path.read_text())
    content["effects"][0] |= {"z": None, "reference": 0, "frequency_hz": None}
    content["effects"][1] |= {"held": [0.1, 0.2, 0.3, 0.4]}
    path.write_text(json.dumps(content))
    assert ambid.Model.load(path).effects == (find("unbalance"), ForceNonlinearity((0.1, 0.2, 0.3, 0.4)))


def test_lists_are_taken_for_tuples():
    assert ForceNonlinearity([0.1, 0.2]) == ForceNonlinearity((0.1, 0.2))
    assert hash(ForceNonlinearity([0.1, 0.2])) == hash(ForceNonlinearity((0.1, 0.2)))


def test_an_effect_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        find("seal_forces").z = 0.3


def test_the_catalogue_that_is_given_is_the_one_that_is_searched(golden):
    own = FoundationResonance(70.0)
    assert find("foundation_resonance", catalogue=[own]) is own
    assert find("foundation_resonance", {}, [own]) == FoundationResonance(), "a file without settings means defaults"
    with golden.raises(ModelError):
        find("loop_delay", catalogue=[own])


def test_descriptions_are_complete(turning):
    names = [effect.name for effect in CATALOGUE]
    assert len(set(names)) == len(names)
    for effect in CATALOGUE:
        assert all(len(text) > 15 for text in (effect.physics, effect.signature, effect.source)), effect.name
        assert len(effect.equation) > 10, effect.name
        for variant in variants(effect, turning):
            assert all(len(p.meaning) > 10 for p in variant.parameters(turning)), variant
