"""What a stranger's effect touches: nothing but the file that it stands in, be it a family of the catalogue or not."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from inspect import getsource
from pathlib import Path

import pytest

import ambid
from ambid.effects import CATALOGUE, Effect, EffectParameter, find
from ambid.errors import ModelError
from ambid.report import write_report
from ambid.report.words import verdict_sentence
from places import LEVITATOR, ROOT


@dataclass(frozen=True)
class Snubbers(Effect):
    """Rubber beside the magnets that pushes back with a power of the displacement."""

    name = "snubbers"
    physics = "rubber snubbers push the rotor back with a power of the displacement"
    equation = "F = -c (s / 20 um)^n"
    signature = "odd; grows with the amplitude"
    source = "a stranger's own idea"
    plural = True

    power: int = 3

    def variants(self, seen):
        """Soft and hard rubber."""
        return [Snubbers(power) for power in (3, 5)]

    def parameters(self, rig):
        """Force at 20 um."""
        return [EffectParameter("force", "N", 0.1, upper=1e3, meaning="force c at 20 um")]

    def attach(self, plant):
        """A table for each axis."""
        for axis in plant.axes:
            push = plant.table(
                lambda s: -((s / 2e-5) ** self.power), [plant[f"s.{axis}"]], reach=[1e-4], slot=self.slot("force")
            )
            plant.inject(f"f.{axis}", push)


def experiment(effect: Effect) -> tuple[ambid.Rig, ambid.Record]:
    """A virtual experiment of a levitator with the effect."""
    rig = ambid.Rig.load(LEVITATOR)
    i_e = ambid.prbs(8, amplitude=0.5, hold=4, axes=1, periods=4)
    record = ambid.Model(rig).add(effect, {"force": 1.0}).virtual_experiment(i_e, seed=1)
    return rig, replace(record, name="run", period=len(i_e) // 4)


@pytest.fixture(scope="module")
def found():
    """A diagnosis whose catalogue has it too."""
    return ambid.diagnose(*experiment(Snubbers(5)), catalogue=(*CATALOGUE, Snubbers()))


def test_an_effect_of_ones_own_is_ranked_and_named(found):
    best = found.history[0].ranking.candidates[0]
    assert best.effect == Snubbers(power=5)
    assert (found.verdict, found.effects) == ("explained", ("snubbers",))
    assert verdict_sentence(found, found.history[0].misfit, found.history[-1].misfit, None).startswith("Snubbers")


@pytest.mark.slow
def test_an_effect_of_ones_own_is_reported(found, tmp_path):
    write_report(found, tmp_path / "report.html")
    assert_reported(tmp_path / "report.html", found)


def assert_reported(path, found):
    text = path.read_text()
    assert verdict_sentence(found, found.history[0].misfit, found.history[-1].misfit, None).partition(":")[0] in text
    assert "<code>snubbers</code>" in text


def test_a_model_with_it_loads_again(found, tmp_path, golden):
    found.save(tmp_path / "model.json")
    again = ambid.Model.load(tmp_path / "model.json", catalogue=(*CATALOGUE, Snubbers()))
    assert again.effects == (Snubbers(5),)
    assert again.parameters == found.model.parameters
    i_e = found.records[0].i_e
    assert (again.simulate(i_e).y == found.model.simulate(i_e).y).all()
    with golden.raises(ModelError):
        ambid.Model.load(tmp_path / "model.json")


def test_settings_that_it_does_not_have(found, tmp_path, golden):
    found.save(tmp_path / "model.json")
    text = (tmp_path / "model.json").read_text()
    (tmp_path / "model.json").write_text(text.replace('"power": 5', '"powre": 5'))
    with golden.raises(ModelError):
        ambid.Model.load(tmp_path / "model.json", catalogue=(*CATALOGUE, Snubbers()))


def test_a_name_among_the_chosen_is_one_of_that_catalogue(found):
    rig, (record,) = found.model.rig, found.records
    shown = ambid.diagnose(rig, record, effects=["snubbers"], catalogue=(*CATALOGUE, Snubbers()))
    assert shown.effects == ("snubbers",)


def test_a_plain_class_is_found_as_it_stands():
    """It has no settings that a file could state: what is in the catalogue is taken."""

    class Plain(Effect):
        name = "plain"

        def __init__(self, gain):
            self.gain = gain

        def parameters(self, rig):
            return []

        def attach(self, plant):
            pass

    own = Plain(2.0)
    assert own.settings() == {}
    assert find("plain", {}, [own]) is own


SESSION = """
import json, sys
from pathlib import Path

import ambid
from ambid.cli import main


def command(*arguments):
    sys.argv = ["ambid", *arguments]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code, arguments


rig, *more = sys.argv[1:]
command("effects", "--json", "effects.json")
force = "snubbers:force=1,power=5"
made = "--out", "run.csv", "--force", "--effect", force, "--amplitude", "0.5", "--seconds", "0.4", "--quiet"
command("simulate", rig, *made)
command("diagnose", rig, "run.csv", "--json", "d.json", "--save", "model.json", "--quiet", *more)
again = ambid.Model.load("model.json")
Path("said.json").write_text(json.dumps({"package": ambid.__file__, "effects": repr(again.effects)}))
"""


@pytest.fixture(scope="module")
def stranger(tmp_path_factory):
    """A folder in which the commands ran with a 24th effect, which one file of a copied package was changed for."""
    folder = tmp_path_factory.mktemp("stranger")
    package = folder / "python" / "ambid"
    shutil.copytree(Path(ambid.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    family = package / "effects" / "support.py"
    before, last, names = family.read_text().partition("EFFECTS = (\n")
    family.write_text(f"{before}{getsource(Snubbers)}\n\n{last}    Snubbers(),\n{names}")
    (folder / "said.txt").write_text(session(folder))
    assert read(folder / "said.json")["package"].startswith(str(folder))
    return folder


def session(folder, *more):
    """What the commands print in it, with more arguments of the diagnosis."""
    ended = subprocess.run(
        [sys.executable, "-c", SESSION, str(LEVITATOR), *more],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder / "python"), "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def read(path):
    return json.loads(path.read_text())


def test_one_file_of_the_catalogue_lists_it(stranger):
    entries = {entry["name"]: entry for entry in read(stranger / "effects.json")["effects"]}
    assert list(entries) != [effect.name for effect in CATALOGUE]
    assert set(entries) == {"snubbers", *(effect.name for effect in CATALOGUE)}
    entry = entries["snubbers"]
    assert entry["equation"] == Snubbers.equation
    assert entry["settings"] == {"power": 3}
    assert [(p["name"], p["meaning"]) for p in entry["parameters"]] == [("force", "force c at 20 um")]
    said = (stranger / "said.txt").read_text()
    assert Snubbers.physics in said
    assert Snubbers.equation in said


def test_one_file_of_the_catalogue_ranks_it(stranger):
    diagnosis = read(stranger / "d.json")
    assert diagnosis["history"][0]["candidates"][0]["effect"] == "snubbers"
    assert (diagnosis["verdict"], diagnosis["effects"]) == ("explained", ["snubbers"])
    assert diagnosis["effects"][0] in (stranger / "said.txt").read_text()


@pytest.mark.slow
def test_one_file_of_the_catalogue_reports_it(stranger, found):
    session(stranger, "--report", "d.html")
    assert_reported(stranger / "d.html", found)


def test_one_file_of_the_catalogue_saves_it(stranger):
    assert read(stranger / "model.json")["effects"] == [{"name": "snubbers", "power": 5}]
    assert read(stranger / "said.json")["effects"] == "(Snubbers(power=5),)"


@pytest.mark.slow
def test_one_file_of_the_catalogue_puts_it_into_the_documents(stranger):
    page = """
import sys
from pathlib import Path

import catalogue

catalogue.CATALOGUE = [effect for effect in catalogue.CATALOGUE if effect.name in ("snubbers", "rotor_contact")]
print(catalogue.generate(Path(sys.argv[1])))
"""
    ended = subprocess.run(
        [sys.executable, "-c", page, str(stranger)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(stranger / "python"), str(ROOT / "python/docs/_ext")])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert "### snubbers" in ended.stdout
    assert f"``{Snubbers.equation}``" in ended.stdout
    assert (stranger / "snubbers.svg").stat().st_size > 1000
