"""The command `simulate`: what it reports of the virtual experiment, and what it does not write."""

import json
from pathlib import Path

import ambid


def test_an_effect_without_values_is_told_with_those_that_were_used(here, command):
    result = command("simulate", here[0], "--out", "v.csv", "--effect", "loop_delay", "--json", "v.json")
    assert (result.code, result.err) == (0, "")
    shown = json.loads(Path("v.json").read_text())
    delay = shown["parameters"]["loop_delay.delay"]["value"]
    assert f"{delay:.6g} s" in result.out
    assert shown["settings"] == {"loop_delay": {}}
    assert shown["notes"] == []


def test_notes_are_printed_and_in_json_and_name_the_amplitude(here, command):
    rig = ambid.Rig.load(here[0])
    gap = rig.bearings[0].air_gap
    command("simulate", here[0], "--out", "small.csv", "--amplitude", "0.1", "--sensor-noise", "0")
    amplitude = 0.1 * 2.0 * gap / abs(ambid.Record.load("small.csv", rig).y).max()
    result = command("simulate", here[0], "--out", "v.csv", "--amplitude", str(amplitude), "--json", "v.json")
    assert (result.code, result.err) == (0, "")
    shown = json.loads(Path("v.json").read_text())
    assert shown["findings"][0]["code"] == "virtual_travel_beyond_gap"
    assert shown["findings"][0]["where"]["channel"] == "y.A_zeta"
    for found, note in zip(shown["findings"], shown["notes"], strict=True):
        assert f"{found['severity']}: {note}" in result.out


def test_what_no_machine_does_is_not_written_and_the_amplitude_is_named(here, command, refused):
    refused(command("simulate", here[0], "--out", "v.csv", "--amplitude", "1e5"), "--amplitude 100000")
    assert not Path("v.csv").exists()


def test_further_channels_are_written_in_their_noise(here, command, refused):
    options = ("--sensor-noise", "0", "--current-noise", "0")
    result = command("simulate", here[0], "--out", "v.csv", *options, "--channel", "f:0.5", "--channel", "f.A_zeta:2")
    assert (result.code, result.err) == (0, "")
    command("simulate", here[0], "--out", "w.csv", *options, "--channel", "f")
    rig = ambid.Rig.load(here[0])
    noisy, silent = (ambid.Record.load(name, rig).further for name in ("v.csv", "w.csv"))
    assert list(noisy) == [f"f.{axis}" for axis in rig.axes]
    off = {name: (column - silent[name]).std() for name, column in noisy.items()}
    assert all(abs(rms / (2.0 if name == "f.A_zeta" else 0.5) - 1.0) < 0.1 for name, rms in off.items())
    refused(command("simulate", here[0], "--out", "x.csv", "--channel", "f:loud"), "--channel f:loud")
    refused(command("simulate", here[0], "--out", "x.csv", "--channel", "g:1"), "g is no further output")
