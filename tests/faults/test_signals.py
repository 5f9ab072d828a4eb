"""A command that is killed or stopped at any moment leaves every file old or new, whole, and ends as documented.

`tests/faults/run.py` tries more moments, and counts.
"""

import json
import os
import resource
import signal
import subprocess
import time
from pathlib import Path
from typing import get_type_hints

import pytest
from typer.main import get_command

import ambid
from ambid.cli.app import app
from demo.one_axis import one_axis
from faults.jobs import HANGS, JOBS, KINDS, ONE_BY_ONE, OPTIONS, STORY, disturbed, ended, prepare, start
from faults.promises import CODES, check

FAST = {"SIGKILL": 4, "SIGINT": 2, "SIGTERM": 2}
SOME = {"SIGKILL": 1}
"""A moment for each kind of file; the others come in `test_a_few_moments`."""
READY = "from ambid.cli import main, signals; signals.watch(); import os; os.write(1, b'.'); main()"
"""Says when signals are heard, before the command itself is imported."""

watched = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return prepare(tmp_path_factory.mktemp("faults"))


def test_every_option_that_writes_is_tried():
    """A path that is an option is written, unless it is one of those that are read."""
    read = {"--model", "--before", "--rig", "--measured", "--record", "--validate"}
    commands = get_command(app).commands
    written = {
        (own.name, max(option.opts, key=len))
        for own in app.registered_commands
        for option in commands[own.name].params
        if option.param_type_name == "option" and "Path" in str(get_type_hints(own.callback)[option.name])
    }
    written = {(name, option) for name, option in written if option not in read}
    tried = {(words[0], word) for words in (*JOBS.values(), STORY) for word in words if word in OPTIONS}
    once = {
        ("identify", "--save-rig"),
        ("diagnose", "--save-rig"),
        ("diagnose", "--mend"),
    }  # which replace no file: there is no old one to lose
    assert written - tried == once | {("workbench", "--json")}, (
        "it writes when a signal comes: tests/cli/test_working.py"
    )


def test_a_few_moments(folder):
    counts = check(disturbed(folder, JOBS["simulate"], FAST))
    assert counts["SIGKILL", "old"] > 0  # that which comes at once


@pytest.mark.slow
@pytest.mark.parametrize("job", KINDS)
def test_many_moments(job, folder, tmp_path):
    print(job, dict(check(disturbed(prepare(tmp_path), JOBS[job], SOME, drawn=False), job not in ONE_BY_ONE)))


@pytest.mark.slow
def test_the_demo(tmp_path):
    """Its files are whole; the new ones show which are there. On one axis it takes a third as long."""
    (tmp_path / "data").mkdir()
    data = one_axis(tmp_path / "data")
    found = disturbed(prepare(tmp_path), STORY, {"SIGKILL": 1, "SIGINT": 1}, drawn=False, data=data)
    print(dict(check(found, all_or_none=False)))


def until(happens):
    """Look for it."""
    for _ in range(int(HANGS / 0.02)):
        if happens():
            return
        time.sleep(0.02)
    pytest.fail("waited in vain")


def threads(process):
    """State and clock ticks of user time, by thread."""
    shown = (own.read_text() for own in Path(f"/proc/{process.pid}/task").glob("*/stat"))
    fields = (own.rpartition(")")[2].split() for own in shown)
    return [(own[0], int(own[11])) for own in fields]


def worked(process):
    """Seconds of the processor."""
    return sum(ticks for _, ticks in threads(process)) / os.sysconf("SC_CLK_TCK")


def waits(process):
    """Whether it has nothing to do for a second, having worked."""
    seen = []
    for _ in range(20):
        seen.append(threads(process))
        time.sleep(0.05)
    return worked(process) > 0.2 and all(own == seen[0] for own in seen) and {state for state, _ in seen[0]} == {"S"}


def moments(count, seconds):
    return [seconds * (k + 0.5) / count for k in range(count)]


def stop(folder, number, moment):
    """Send a signal so long after signals are heard; exit code, stderr, and the state of the file."""
    (folder / "i.json").unlink(missing_ok=True)
    arguments = ("identify", "rig.toml", "run.csv", "--json", "i.json")
    process = start(*arguments, program=READY, cwd=folder)
    assert process.stdout.read(1) == "."
    time.sleep(moment)
    process.send_signal(number)
    _, err = process.communicate(timeout=HANGS)
    if (folder / "i.json").exists():
        json.loads((folder / "i.json").read_text())
    assert not list(folder.glob(".ambid-*"))
    return shell_code(process), err


def shell_code(process):
    """As a shell reports it: the interpreter's very end has the usual handlers again, and dies of the signal."""
    return process.returncode if process.returncode >= 0 else 128 - process.returncode


@pytest.mark.slow
@pytest.mark.parametrize("name", CODES)
def test_from_the_first_import_on(name, folder):
    begun = time.perf_counter()
    assert ended("identify", "rig.toml", "run.csv", "-q", cwd=folder)[0] == 0
    seconds = time.perf_counter() - begun
    for moment in moments(3, seconds):
        code, err = stop(folder, signal.Signals[name], moment)
        assert code in (0, CODES[name]), err
        assert "Traceback" not in err
        assert "ignored" not in err


@watched
@pytest.mark.slow
def test_what_is_done_is_saved_and_says_that_it_was_stopped(folder):
    """One of so many starts that they would take minutes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    assert ended("identify", "rig.toml", "run.csv", "-q", cwd=folder)[0] == 0
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    arguments = ("--starts", "20000", "--json", "s.json", "--save", "s_model.json")
    process = start("identify", "rig.toml", "run.csv", *arguments, cwd=folder)
    until(lambda: worked(process) > 1.0 + 2.0 * seconds)
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=HANGS)
    assert process.returncode == 143, err
    assert json.loads((folder / "s.json").read_text())["status"] == "stopped"
    assert "stopped" in out
    assert ambid.Model.load(folder / "s_model.json").names


@pytest.mark.slow
def test_a_job_in_the_background_is_not_stopped_by_ctrl_c(folder):
    process = start("identify", "rig.toml", "run.csv", "-q", cwd=folder, program="import signal\n" + IGNORING)
    assert process.stdout.read(1) == "."
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=HANGS)
    assert process.returncode == 0


IGNORING = f"signal.signal(signal.SIGINT, signal.SIG_IGN)\n{READY}"


@pytest.mark.slow
@watched
def test_the_second_ctrl_c_ends_what_the_first_waits_for(folder, golden):
    """A pipe that nobody reads holds the command while it writes."""
    os.mkfifo(folder / "pipe.json")
    process = start("identify", "rig.toml", "run.csv", "--json", "pipe.json", cwd=folder)
    until(lambda: waits(process))
    process.send_signal(signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(1.0)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=HANGS)
    assert process.returncode == 130
    golden.holds(err)
    Path(folder / "pipe.json").unlink()
