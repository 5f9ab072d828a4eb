"""What a command advises is something that it can do."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.cli.files import NO_RECORD
from ambid.demo import DATA

LOADS = sorted(DATA.glob("static_*.csv"))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_static_load_in_milliampere_is_not_to_be_vouched_for(command, refused):
    head, *rows = LOADS[0].read_text().splitlines()
    columns = head.split(",")
    first = next(k for k, name in enumerate(columns) if name.startswith("i_c."))
    lines = [row.split(",") for row in rows]
    text = [",".join([*own[:first], *(str(1e3 * float(cell)) for cell in own[first:])]) for own in lines]
    Path("mA.csv").write_text("\n".join([head, *text]))
    refused(command("static-load", DATA / "rig.toml", "mA.csv"), "i_c.A_zeta")


def test_static_load_names_its_own_option(command):
    result = command("static-load", DATA / "rig.toml", *LOADS, "--json", "s.json")
    assert result.code == 0
    found = json.loads(Path("s.json").read_text())
    assert "deflection_left_out" in {own["code"] for own in found["findings"]}
    assert found["next_command"].endswith(" --deflection")
    assert found["next_command"] in result.out
    again = command("static-load", DATA / "rig.toml", *LOADS, "--deflection", "--json", "s.json")
    assert again.code == 0
    assert "deflection_included" in {own["code"] for own in json.loads(Path("s.json").read_text())["findings"]}


@pytest.mark.parametrize("job", ["identify", "diagnose", "rank", "workbench"])
def test_a_first_rig_without_records_is_refused_like_a_last_one(job, command):
    """The parameters of its bias current would have no record to be found from."""
    text = (DATA / "rig.toml").read_text()
    Path("6A.toml").write_text(text)
    Path("8A.toml").write_text(text)
    record = DATA / "prbs.mat"
    result = command(job, "6A.toml", "8A.toml", record)
    assert result.code == 2
    assert f"6A.toml: {NO_RECORD}, before 8A.toml" in result.err
    assert f"8A.toml: {NO_RECORD}" in command(job, "6A.toml", record, "8A.toml").err


def test_what_is_not_identifiable_is_named_by_words_that_are_there(here, command):
    """A tone whose start is below the noise does not determine three parameters; a key of the JSON is named."""
    rig = ambid.Rig.load(here[0])
    mass = ambid.Model(rig)
    periods = np.tile(1e-3 * np.sin(2.0 * np.pi * np.arange(500) / 50.0)[:, None], (6, 1))
    mass.virtual_experiment(periods, seed=1, current_noise=3e-4, sensor_noise=3e-8).save("tone.csv")
    result = command("identify", here[0], "tone.csv", "--json", "e.json")
    assert result.code == 1
    found = json.loads(Path("e.json").read_text())
    assert found["status"] == "not_identifiable"
    assert "`not_identifiable`" in found["status_meaning"]
    assert found["not_identifiable"]
    assert "`directions`" not in result.out


def test_a_pattern_is_fixed_at_the_value_that_is_given(here, command):
    """It was kept at the start value instead."""
    result = command("identify", *here, "--fix", "K_i=181", "--save", "m.json")
    assert result.code == 0
    saved = ambid.Model.load("m.json")
    assert dict(zip(saved.names, saved.theta, strict=True))["K_i.A_zeta"] == 181.0


UNSTABLE = {
    "excitation": ("--out", "e.csv"),
    "simulate": ("--out", "v.csv"),
    "design": ("--accuracy", "K_i=1%"),
    "compare": (),
}


@pytest.mark.parametrize("job", UNSTABLE)
def test_an_unstable_nominal_loop_is_told_with_its_file_and_what_to_do(job, here, command, refused):
    text = here[0].read_text()
    Path("weak.toml").write_text(re.sub(r"(?m)^proportional = .*$", "proportional = 20.0", text))
    assert Path("weak.toml").read_text() != text
    records = [here[1]] if job == "compare" else []
    result = command(job, "weak.toml", *records, *UNSTABLE[job])
    refused(result, "weak.toml", code=1)
    assert not list(Path().glob("*.csv"))


def test_a_loop_that_an_effect_makes_unstable_is_told_as_that(here, command, refused):
    result = command("simulate", here[0], "--out", "v.csv", "--effect", "loop_delay:delay=1.9e-3")
    refused(result, "rig.toml", code=1)


@pytest.mark.parametrize(
    ("words", "near"),
    [
        (("effects", "LOOP_DELAY"), "loop_delay"),
        (("effects", "seal"), "seal_forces"),
        (("effects", "magic"), ""),
        (("identify", "RIG", "RUN", "--free", "Ki"), "K_i"),
        (("identify", "RIG", "RUN", "--free", "k_i.a_zeta"), "K_i.A_zeta"),
        (("identify", "RIG", "RUN", "--free", ""), ""),
        (("identify", "RIG", "RUN", "--free", "K_i,"), ""),
        (("diagnose", "RIG", "RUN", "--effects", ""), ""),
        (("diagnose", "RIG", "RUN", "--effects", "Loop-Delay"), "loop_delay"),
        (("excitation", "RIG", "--out", "e.csv", "--axes", ""), ""),
        (
            ("rank", "RIG", "RUN", "--predict", "gain"),
            "sensor_gain_error, controller_gain_error, excitation_gain_error or",
        ),
    ],
    ids=lambda value: "_".join(value) if isinstance(value, tuple) else "",
)
def test_a_name_that_is_none_is_told_with_what_comes_nearest(words, near, here, command, refused):
    result = command(*({"RIG": here[0], "RUN": here[1]}.get(word, word) for word in words))
    refused(result, f"did you mean {near}" if near else words[-1])
