"""`--map` as a file of its arguments, wherever it is taken, and what `check` lists of frequency responses."""

import json

import numpy as np
import pytest

import ambid
from ambid import ChannelMap
from ambid.errors import InputError
from places import LEVITATOR

RIG = ambid.Rig.load(LEVITATOR)
AXIS = RIG.axes[0]
CHANNELS = {
    "t": ("Time_ms", 1e-3),
    f"i_e.{AXIS}": ("Exc mA", 1e-3),
    f"y.{AXIS}": ("Pos_um", 1e-6),
    f"i_c.{AXIS}": ("Cur#1", 1),
}
OPTIONS = [f"{channel}={column}:{factor:g}" for channel, (column, factor) in CHANNELS.items()]
QUOTED = [f'"{option}"' if " " in option else option for option in OPTIONS]
FILES = {
    "one line": " ".join(f"--map {option}" for option in QUOTED),
    "several lines": "\n".join(f"--map {option}" for option in QUOTED) + "\n",
    "without the option": "\n".join(QUOTED),
    "with an equals sign": " ".join(f"--map={option}" for option in QUOTED),
    "comments and empty lines": "\ufeff# bench 3\n\n" + "\n".join(QUOTED),
    "lines that go on": " \\\n".join(f"--map {option}" for option in QUOTED),
    "single quotes": " ".join(f"--map '{option}'" for option in OPTIONS),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_holds_the_arguments_as_people_write_them(tmp_path, name):
    path = tmp_path / "map.txt"
    path.write_text(FILES[name], encoding="utf-8")
    assert ChannelMap.options_of(path) == OPTIONS
    assert repr(ChannelMap.load(path)) == repr(ChannelMap.parse(OPTIONS))


@pytest.mark.parametrize(
    "text",
    [
        f"--map y.{AXIS}=ch1 --sample-rate 1e4",
        f"y.{AXIS}",
        f"'y.{AXIS}=ch1",
        b"\xff\xfe\x00=",
        f"y.{AXIS}=a y.{AXIS}=b",
    ],
    ids=["another option", "no equals sign", "a quote without an end", "no text", "twice"],
)
def test_a_wrong_file_is_refused_with_its_name(tmp_path, text, golden):
    path = tmp_path / "map.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with golden.raises(InputError):
        ChannelMap.load(path)


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """A rig file, a record with names and units of its own, and a file of the map, in the folder of the command."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.toml").write_text(RIG.exact().to_toml())
    made = ambid.Model(RIG).virtual_experiment(ambid.prbs(6, amplitude=0.1, hold=2, axes=1, periods=6), seed=1)
    signals = np.column_stack([made.t, made.i_e, made.y, made.i_c]) / [factor for _, factor in CHANNELS.values()]
    header = ",".join(column for column, _ in CHANNELS.values())
    np.savetxt(tmp_path / "run.csv", signals, "%.17g", ",", header=header, comments="")
    (tmp_path / "map.txt").write_text(FILES["several lines"])
    return tmp_path


@pytest.mark.parametrize("given", [["map.txt"], [*OPTIONS[:2], "rest.txt"]], ids=["file", "beside options"])
def test_a_command_takes_it(foreign, command, given):
    (foreign / "rest.txt").write_text(" ".join(QUOTED[2:]))
    options = [word for own in given for word in ("--map", own)]
    ended = command("compare", "rig.toml", "run.csv", *options, "--json", "c.json", "--quiet")
    assert ended.code == 0, ended.err
    codes = [own["code"] for own in json.loads((foreign / "c.json").read_text())["findings"]]
    assert "columns_mapped" in codes


def test_design_takes_it_for_its_record(foreign, command):
    ended = command("design", "rig.toml", "--record", "run.csv", "--map", "map.txt", "--signal", "prbs", "--quiet")
    assert ended.code == 0, ended.err


def test_design_without_a_record_has_nothing_to_map(foreign, command, golden):
    ended = command("design", "rig.toml", "--map", "map.txt")
    assert ended.code == 2
    golden.holds(ended.err)


def test_check_lists_frequency_responses(foreign, command):
    f = np.linspace(20.0, 800.0, 30)
    h = 30.0 / ((2j * np.pi * f) ** 2 + 240j * np.pi * f + 4e5)
    rows = [
        f"{k},{abs(own):.12g},{np.degrees(np.angle(own)):.12g},{0.02 * abs(own)}" for k, own in zip(f, h, strict=True)
    ]
    (foreign / "frf.csv").write_text("\n".join(["frequency_hz,magnitude,phase_deg,std", *rows]) + "\n")
    arguments = (
        "rig.toml",
        "run.csv",
        "frf.csv",
        "--map",
        "map.txt",
        "--map",
        f"output=y.{AXIS}",
        "--map",
        f"input=i_e.{AXIS}",
    )
    ended = command("check", *arguments, "--json", "s.json")
    assert ended.code == 0, ended.err
    found = json.loads((foreign / "s.json").read_text())
    assert [own["name"] for own in found["records"]] == ["run"]
    (response,) = found["responses"]
    assert (response["name"], response["frequencies"]) == ("frf", 30)
    assert response["band_hz"] == pytest.approx([20.0, 800.0])
    assert response["relative_std"] == pytest.approx({f"y.{AXIS} / i_e.{AXIS}": 0.02})
    assert "frf: " in ended.out
