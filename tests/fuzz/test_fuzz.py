"""No traceback, whatever the file: what once failed, and damaged inputs by the hundred."""

import contextlib
import json
import shutil
import unicodedata

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.main import get_command

import ambid
from ambid.cli.app import app
from ambid.errors import LONGEST_MESSAGE, InputError, printable
from fuzz.bases import healthy
from fuzz.commands import COMMANDS
from fuzz.corpus import CORPUS
from fuzz.run import table, verdicts

HANGS = 60.0
"""Seconds of work after which an input is taken to hang, on whatever machine."""


@pytest.fixture(scope="session")
def bases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz") / "healthy"
    healthy(folder)
    return folder


def test_every_option_of_the_command_line_is_tried():
    """What is not here is fuzzed by nobody: `tests/fuzz/commands.py` has values for it."""
    known = {
        name: {max(option.opts, key=len) for option in own.params if option.param_type_name == "option"}
        for name, own in get_command(app).commands.items()
    }
    assert set(COMMANDS) == set(known)
    for name, command in COMMANDS.items():
        tried = {word for word in (*command.options, *command.last) if word.startswith("--")}
        assert tried == known[name], name


@pytest.mark.parametrize("case", CORPUS)
def test_what_once_failed(case, bases, tmp_path, monkeypatch, command):
    shutil.copytree(bases, tmp_path / "files")
    monkeypatch.chdir(tmp_path / "files")
    make, words, named = CORPUS[case]
    make()
    result = command(*words, "--json", "out.json")
    if named:
        assert result.code == 2
        assert [word for word in named.split() if word not in result.err] == []
    else:
        assert result.code in (0, 1 if words[0] == "monte-carlo" else 2), result.err
    assert len(result.err) < LONGEST_MESSAGE + 200
    assert not [c for c in result.err + result.out if c not in "\n\t" and unicodedata.category(c) == "Cc"]


def test_an_outer_link_is_said(bases, tmp_path, monkeypatch):
    shutil.copytree(bases, tmp_path / "files")
    monkeypatch.chdir(tmp_path / "files")
    import h5py

    with h5py.File("run.h5", "a") as file:
        file["other"] = h5py.ExternalLink("run73.mat", "/y")
    assert any("other:" in note for note in ambid.Record.load("run.h5").notes)


def test_a_name_with_formulas_and_escapes_is_drawn_as_it_is(bases, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    name = "run_$5_$\x1b[31m^{.csv"
    shutil.copy(bases / "run.csv", name)
    result = command("compare", bases / "rig.toml", name, "--plot", "out.svg")
    assert result.code == 0
    assert r"run_$5_$\x1b[31m^{" in result.out
    assert "\x1b" not in (tmp_path / "out.svg").read_text()


@pytest.mark.parametrize("count", [40, pytest.param(100, marks=pytest.mark.slow)])
def test_damaged_inputs(count, tmp_path):
    found = list(verdicts(1, range(count), tmp_path, workers=1, longest=HANGS))
    assert len(found) == count
    bad = [v for v in found if not v.is_fine]
    assert not bad, "\n".join([table(found), *(f"{v.number}: {v.kind}: {v.outcome}: {v.detail}" for v in bad)])


@given(st.text())
def test_printable_text_steers_nothing_and_stays(text):
    shown = printable(text)
    assert not [c for c in shown if c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cf", "Cs")]
    assert printable(shown) == shown
    shown.encode()  # as a terminal or a page does


def test_a_long_message_keeps_the_file_and_what_to_do():
    message = str(InputError(f"rig.toml: {10_000 * chr(27)}: give a number"))
    assert message.startswith("rig.toml: ")
    assert message.endswith(": give a number")
    assert len(message) < LONGEST_MESSAGE + 50


@given(st.lists(st.text(max_size=20), max_size=3))
@settings(max_examples=100)
def test_a_map_is_read_or_refused(options):
    with contextlib.suppress(InputError):
        assert "y." in repr(ambid.ChannelMap.parse(options))


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(), lambda x: st.lists(x) | st.dictionaries(st.text(), x)
    )
)
@settings(max_examples=100)
def test_a_model_is_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "model.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"model\.json"):
        ambid.Model.load(path)
