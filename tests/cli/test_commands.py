"""What is to be done next is stated with the command that does it."""

import importlib
import json
import re
import shlex

import pytest

from ambid.cli.outputs import COMMANDS, command_of
from ambid.demo import DATA
from ambid.findings import KINDS
from parsed import read_by_the_command_line


def test_every_command_is_there_and_belongs_to_something_that_is_done_next():
    for room in ("identification", "diagnosis", "campaigns"):
        importlib.import_module(f"ambid.{room}")
    for code, command in COMMANDS.items():
        assert KINDS[code]
        given = re.sub(r"\[.*\]", "", command).replace("{tolerance:.2f}", "1.2").replace(" J", " 1.2")
        read_by_the_command_line(given.split())


@pytest.mark.parametrize("validate", ["other run.mat", None])
def test_values_are_in_the_command_as_a_shell_takes_them(validate):
    from ambid.campaigns.result import DIAGNOSE_KIND

    files = {"rig": "6A/rig.toml", "record": "6A/run 1.mat", "validate": validate}
    shown = command_of([DIAGNOSE_KIND(kind="run", folder="6A", **files)])
    more = ["--validate", validate] if validate else []
    assert shlex.split(shown) == ["ambid", "diagnose", "6A/rig.toml", "6A/run 1.mat", *more]


def test_identify_tells_it(command, tmp_path):
    done = command("identify", DATA / "rig.toml", DATA / "prbs.mat", "--json", tmp_path / "found.json")
    shown = json.loads((tmp_path / "found.json").read_text())["next_command"]
    assert shown == COMMANDS["next_validate"]
    assert f"  {shown}\n" in done.out


def test_nothing_is_told_where_no_command_does_it():
    from ambid.diagnosis.advice import NOTHING

    assert command_of([NOTHING()]) == ""
