"""Ctrl-C: whatever a command has finished is printed and saved, marked as stopped."""

import json
import signal
from dataclasses import replace
from pathlib import Path

import pytest

import ambid
from ambid.cli import outputs
from ambid.diagnosis import messages, procedure, search, verdict
from ambid.noise import Noise
from tiers import first_fast

STOPPED = "stopped by Ctrl-C"


def interrupt_at(monkeypatch, where, name, call, *, own=False):
    """Let Ctrl-C come at the `call`-th call of a function; with the command's `own` handler, or Python's."""
    function, calls = getattr(where, name), iter(range(1_000_000))

    def interrupted(*arguments, **options):
        if next(calls) == call:
            if not own:
                signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
            signal.raise_signal(signal.SIGINT)
        return function(*arguments, **options)

    monkeypatch.setattr(where, name, interrupted)


def test_ctrl_c_before_the_first_step_ends_with_a_message(here, command, monkeypatch):
    interrupt_at(monkeypatch, Noise, "jacobian", 0)
    result = command("diagnose", *here, "--json", "d.json")
    assert (result.code, result.out) == (130, "")
    assert result.err.startswith(STOPPED)
    assert not Path("d.json").exists()


def test_ctrl_c_later_ends_with_the_steps_that_were_done(here, command, monkeypatch):
    interrupt_at(monkeypatch, search, "added", 0)
    result = command("diagnose", *here, "--json", "d.json")
    assert result.code == 130
    found = json.loads(Path("d.json").read_text())
    assert (found["verdict"], found["effects"]) == ("not_informative", [])
    assert [step["effects"] for step in found["history"]] == [[]]
    first = {candidate["effect"] for candidate in found["history"][0]["candidates"][:2]}
    assert first == {"loop_delay", "amplifier_bandwidth"}, "near twins"
    assert found["findings"][-1]["code"] == "search_stopped"


LATER = {
    "the near twins": (procedure, "families", 0),
    "the steps of the search": (search, "added", 0),
    "the verdict": (procedure, "judged", 0),
    "what is left": (verdict, "changes_of", 0),
    "the intervals": (procedure, "covariance", 0),
    "the next experiment": (procedure, "next_steps", 0),
}


@pytest.mark.parametrize("moment", first_fast(LATER))
def test_ctrl_c_after_the_first_step_saves_what_was_done(moment, here, command, monkeypatch):
    stopped_at(moment, monkeypatch, lambda: command("diagnose", *here, "--json", "d.json", "--save", "m.json"))


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["the steps of the search", "the next experiment"])
def test_ctrl_c_after_the_first_step_is_in_the_report(moment, here, command, monkeypatch):
    files = ("--json", "d.json", "--save", "m.json", "--report", "r.html")
    stopped_at(moment, monkeypatch, lambda: command("diagnose", *here, *files))
    assert messages.STOPPED.message in Path("r.html").read_text()


def stopped_at(moment, monkeypatch, run):
    interrupt_at(monkeypatch, *LATER[moment])
    result = run()
    assert result.code == 130
    found = json.loads(Path("d.json").read_text())
    steps = [] if moment == "the steps of the search" else [found["history"][1]["effects"]]
    assert [step["effects"] for step in found["history"]] == [[], *steps]
    assert found["stopped"]
    assert sum(own["probability"] for own in found["sets"]) == pytest.approx(1.0, abs=1e-3)
    assert found["findings"][-1]["code"] == "search_stopped"
    assert messages.STOPPED.message in result.out
    assert ambid.Model.load("m.json").names


@pytest.mark.parametrize(("where", "name"), first_fast([(ambid.report, "write_report"), (ambid.Diagnosis, "to_json")]))
def test_ctrl_c_while_files_are_written_is_told_and_keeps_the_diagnosis_whole(where, name, here, command, monkeypatch):
    """The report, whose pictures take long, is written by another that says as much of it."""
    monkeypatch.setattr(ambid.report, "write_report", lambda found, path: path.write_text(str(found)))
    interrupt_at(monkeypatch, where, name, 0, own=True)
    result = command("diagnose", *here, "--json", "d.json", "--save", "m.json", "--report", "r.html")
    assert result.code == 130
    found = json.loads(Path("d.json").read_text())
    assert (found["effects"], found["stopped"]) == (["loop_delay"], True)
    assert f"{STOPPED} {outputs.ALL_OF_IT}" in result.out
    assert "loop_delay" in Path("r.html").read_text()
    assert Path("m.json").exists()


@pytest.mark.slow
def test_a_second_ctrl_c_ends_the_report_and_what_is_finished_is_printed(here, command, monkeypatch):
    def twice(*_):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ambid.report, "write_report", twice)
    result = command("diagnose", *here, "--json", "d.json", "--report", "r.html")
    assert result.code == 130
    assert json.loads(Path("d.json").read_text())["effects"] == ["loop_delay"]
    assert "+ loop_delay" in result.out
    assert f"{STOPPED} {outputs.ONLY_THESE}" in result.out
    assert not Path("r.html").exists()


def test_ctrl_c_while_the_next_experiment_is_foreseen_keeps_the_diagnosis(here, command, monkeypatch):
    interrupt_at(monkeypatch, ambid, "next_experiments", 0, own=True)
    monkeypatch.setattr(
        procedure, "judged", lambda *given, **how: replace(verdict.judged(*given, **how), word="ambiguous")
    )
    result = command("diagnose", *here, "--next", "--json", "d.json")
    assert result.code == 130
    assert json.loads(Path("d.json").read_text())["stopped"]
    assert STOPPED in result.out


def test_a_diagnosis_that_nobody_stopped_says_so(diagnosed):
    folder, result = diagnosed
    assert (result.code, json.loads((folder / "d.json").read_text())["stopped"]) == (0, False)
    assert "stopped" not in result.out
