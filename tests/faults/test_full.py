"""A full disk, a closed or full stdout, and names that it cannot print: files are old or new, codes as documented."""

import errno
import json
import os
import resource
import shutil
import subprocess
from pathlib import Path

import pytest

from faults.files import OLD, state, write_old
from faults.jobs import FEW, HANGS, IN_THE_JOB, JOBS, ended, environment, heard, outputs, prepare, start

IDENTIFY = ("identify", "rig.toml", "run.csv", "--json", "i.json")
INIT = ("init", "--out", "new.toml", "--force", "--json", "i.json")
"""Prints and writes, and computes nothing."""
NO_ROOM, TOO_LARGE, CLOSED = map(os.strerror, (errno.ENOSPC, errno.EFBIG, errno.EBADF))


def some(every, fast):
    """All of these, those that are not among the fast ones in the slow tier."""
    return [pytest.param(one, marks=() if one in fast else pytest.mark.slow) for one in every]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    return prepare(tmp_path_factory.mktemp("prepared"))


@pytest.fixture
def folder(prepared, tmp_path):
    """Rig, record and campaign."""
    shutil.copytree(prepared, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture
def small(prepared, tmp_path):
    """A file system of its own."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", place], check=False)
    if mounted.returncode:
        pytest.skip("only root may mount a file system")
    try:
        shutil.copytree(prepared, place, dirs_exist_ok=True)
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


def fill(folder):
    """Leave no room on a file system."""
    free = os.statvfs(folder)
    (folder / "filler").write_bytes(bytes(free.f_bavail * free.f_frsize))


@pytest.mark.parametrize("job", some(JOBS, FEW))
def test_a_full_disk(job, small):
    written = [small / name for name in outputs(JOBS[job])]
    for path in written:
        write_old(path)
    fill(small)
    code, out, err = ended(*JOBS[job], cwd=small)
    assert code == 1
    assert NO_ROOM in err
    assert "Traceback" not in err
    states = [state(path) for path in written]
    for path, found in zip(written, states, strict=True):
        assert found == "old" or (found == "new" and str(path.name) not in err)
    assert "old" in states
    assert not list(small.glob(".ambid-*"))
    if job not in IN_THE_JOB:
        assert len(out) > 50, "the result is printed all the same"


@pytest.mark.parametrize("suffix", some((".csv", ".mat", ".h5", ".parquet", ".tdms"), ()))
def test_a_limit_on_the_size_of_files(suffix, folder):
    def limited():
        heard()
        resource.setrlimit(resource.RLIMIT_FSIZE, (15_000, 15_000))

    record = folder / f"v{suffix}"
    write_old(record)
    more = ("--out", record, "--force", "--seconds", "0.5")
    code, _, err = ended("simulate", "rig.toml", *more, cwd=folder, preexec_fn=limited)
    assert code == 1
    assert record.name in err
    assert TOO_LARGE in err
    assert "Traceback" not in err
    assert record.read_bytes() == OLD
    assert not list(folder.glob(".ambid-*"))


def test_stdout_is_a_full_device(folder, golden):
    with Path("/dev/full").open("w") as full:
        code, _, err = ended(*INIT, cwd=folder, stdout=full)
    assert code == 1
    golden.holds(err.replace(NO_ROOM, "no room"))
    assert state(folder / "i.json") == "new"


@pytest.mark.parametrize("arguments", [(*INIT, "-q"), INIT], ids=["nothing to print", "a table to print"])
def test_stdout_is_closed(arguments, folder):
    code, _, err = ended(*arguments, cwd=folder, stdout=None, preexec_fn=lambda: os.close(1))
    assert code == (0 if "-q" in arguments else 1)
    assert err == "" if "-q" in arguments else CLOSED in err
    assert state(folder / "i.json") == "new"


def test_all_three_streams_are_closed(folder):
    code, _, _ = ended(*INIT, cwd=folder, stdout=None, stderr=None, preexec_fn=lambda: os.closerange(0, 3))
    assert code == 1
    assert state(folder / "i.json") == "new"


@pytest.mark.parametrize("arguments", some((INIT, ("identify", "--help"), IDENTIFY), (INIT, ("identify", "--help"))))
def test_the_reader_of_stdout_has_gone(arguments, folder):
    reader, writer = os.pipe()
    os.close(reader)
    code, _, err = ended(*arguments, cwd=folder, stdout=writer)
    os.close(writer)
    assert (code, err) == (141, "")
    if "--json" in arguments:
        assert state(folder / "i.json") == "new"


@pytest.mark.parametrize(
    ("arguments", "printed", "written"),
    [
        ((*INIT[:-1], "/dev/full"), "new.toml", "new.toml"),
        pytest.param((*IDENTIFY, "--save", "/dev/full"), "K_i.A_zeta", "i.json", marks=pytest.mark.slow),
    ],
    ids=["init", "identify"],
)
def test_a_file_that_cannot_be_written_keeps_nothing_else_from_it(arguments, printed, written, folder):
    code, out, err = ended(*arguments, cwd=folder)
    assert code == 1
    assert printed in out
    assert err.startswith("error: /dev/full: ")
    assert NO_ROOM in err
    assert state(folder / written) == "new"


@pytest.mark.slow
def test_a_report_that_cannot_be_written_keeps_its_pdf_from_nothing(folder):
    (folder / "full.html").symlink_to("/dev/full")
    more = ("--effects", "loop_delay", "--report", "full.html", "--pdf", "d.pdf")
    code, out, err = ended("diagnose", "rig.toml", "run.csv", *more, cwd=folder)
    assert code == 1
    assert "loop_delay" in out
    last = err.splitlines()[-1]
    assert "full.html" in last
    assert NO_ROOM in last
    assert state(folder / "d.pdf") == "new"


SPEECH = {
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "C": {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
}


@pytest.mark.slow
@pytest.mark.parametrize(("speech", "suffix"), [("ascii", ".csv"), ("C", ".mat")])
def test_names_that_stdout_cannot_encode(speech, suffix, folder):
    """An umlaut and a Greek letter, in the names of the machine, of an axis, and of files."""
    text = (folder / "rig.toml").read_text().replace('"levitator"', '"Prüfstand"').replace('name = "A"', 'name = "Äζ"')
    (folder / "prüf.toml").write_text(text, encoding="utf-8")
    options = {"cwd": folder, "env": environment(**SPEECH[speech])}
    record, files = f"lauf_ö{suffix}", ("--json", "jö.json", "--save", "mö.json", "--plot", "pö.svg")
    for arguments in (
        ("simulate", "prüf.toml", "--out", record, "--seconds", "0.1"),
        ("identify", "prüf.toml", record, *files),
    ):
        code, out, err = ended(*arguments, **options)
        assert (code, err) == (0, "")
        assert "\\" in out
    assert {state(folder / name) for name in files[1::2]} == {"new"}
    assert "K_i.Äζ_zeta" in json.loads((folder / "jö.json").read_text())["parameters"]


@pytest.mark.slow
def test_two_commands_write_the_same_files(folder):
    """Each file is that of one of the two, whole."""
    both = [start(*JOBS["simulate"], "--seed", seed, cwd=folder) for seed in (1, 2)]
    for process in both:
        _, err = process.communicate(timeout=HANGS)
        assert process.returncode == 0, err
    assert {state(folder / name) for name in outputs(JOBS["simulate"])} == {"new"}
    assert not list(folder.glob(".ambid-*"))
