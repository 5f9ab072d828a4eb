"""Whatever stops the command, a signal, a full disk, a worker that dies: the same command ends with the same files."""

import errno
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from ambid.cli.virtual import GO_ON
from ambid.monte_carlo import procedure
from hidden.one_axis import ONE_AXIS
from monte_carlo.planned import content

pytest.importorskip("pyarrow")
RUNS = 40
CHUNK = 4
PAUSE = 0.15
PROGRAM = f"""
if __name__ == "__main__":
    import time
    from ambid.cli import main
    from ambid.monte_carlo import procedure

    class Slowly(procedure.Chunks):
        def write(self, chunk, rows):
            super().write(chunk, rows)
            time.sleep({PAUSE})

    procedure.CHUNK = procedure.BATCH = {CHUNK}
    procedure.Chunks = Slowly
    main()
"""
"""The command with small chunks, in a file, so that its worker processes find it.

It is so slow that a signal comes in time on a loaded machine.
"""
LONG = 120.0
"""Seconds to wait for what takes one or two: the machine may be loaded."""


class Place:
    """A rig file, and the command on it."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "rig.toml").write_text(ONE_AXIS.rig.to_toml())
        (folder / "program.py").write_text(PROGRAM)

    def call(self, out):
        own = ["monte-carlo", self.folder / "rig.toml", "--runs", RUNS, "--seconds", 0.5, "--amplitude", 1.0]
        return [*own, "--out", out]

    def begin(self, out, *more):
        call = [sys.executable, self.folder / "program.py", *map(str, self.call(out)), *more]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        return subprocess.Popen(call, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return Place(tmp_path_factory.mktemp("place"))


@pytest.fixture(scope="module")
def whole(place):
    """What a job that nobody stops leaves."""
    out = place.folder / "whole.parquet"
    assert place.begin(out).wait(LONG) == 0
    assert len(content(out)) == RUNS / CHUNK + 1
    return content(out)


@pytest.fixture
def again(command, place, monkeypatch):
    """The same command once more, in this process, over which the machine need not load everything again."""
    monkeypatch.setattr(procedure, "CHUNK", CHUNK)
    return lambda out: command(*place.call(out))


def await_part(folder, job):
    """Wait until the job is under way."""
    until(lambda: list(folder.glob("part-*")) or job.poll() is not None)
    assert job.poll() is None, "the job ended before it could be stopped"


def until(condition):
    for _ in range(int(LONG / 0.005)):
        if condition():
            return
        time.sleep(0.005)
    pytest.fail("waited in vain")


def workers(job):
    """Processes that the job has begun to make runs."""
    numbers = Path(f"/proc/{job.pid}/task/{job.pid}/children").read_text().split()
    return [int(n) for n in numbers if b"spawn_main" in Path(f"/proc/{n}/cmdline").read_bytes()]


def is_there(number):
    with suppress(OSError):
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "code"),
    [("SIGKILL", -9), ("SIGTERM", 143), ("SIGINT", 130)],
)
def test_a_signal_midway(name, code, place, again, whole, tmp_path):
    out = tmp_path / "runs.parquet"
    job = place.begin(out)
    await_part(out, job)
    job.send_signal(signal.Signals[name])
    printed, err = job.communicate(timeout=LONG)
    assert job.returncode == code
    assert "Traceback" not in err
    assert 1 < len(content(out)) < len(whole)
    assert (GO_ON in printed + err) == (name != "SIGKILL")
    assert again(out).code == 0
    assert content(out) == whole


needs_proc = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="finds workers by /proc, which is not here"
)


@needs_proc
@pytest.mark.slow
def test_a_worker_killed_midway(place, again, whole, tmp_path):
    out = tmp_path / "runs.parquet"
    job = place.begin(out, "--workers", "2")
    await_part(out, job)
    os.kill(workers(job)[0], signal.SIGKILL)
    _, err = job.communicate(timeout=LONG)
    assert job.returncode == 1
    assert str(out) in err
    assert 1 < len(content(out)) < len(whole)
    assert again(out).code == 0
    assert content(out) == whole


@needs_proc
@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_workers_end_with_the_command(name, place, again, whole, tmp_path):
    out = tmp_path / "runs.parquet"
    job = place.begin(out, "--workers", "2")
    await_part(out, job)
    own = workers(job)
    assert len(own) == 2
    job.send_signal(signal.Signals[name])
    job.communicate(timeout=LONG)
    until(lambda: not any(map(is_there, own)))
    assert again(out).code == 0
    assert content(out) == whole


@pytest.fixture
def small(tmp_path):
    """A file system with room for a few parts."""
    path = tmp_path / "small"
    path.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", path], check=False).returncode:
        pytest.skip("only root may mount a file system; test_chunks.py tries a writer that finds the disk full")
    try:
        yield path
    finally:
        subprocess.run(["umount", path], check=True)


@pytest.mark.slow
def test_a_full_disk(again, whole, small):
    out = small / "runs.parquet"
    done = again(out)
    assert done.code == 1
    assert os.strerror(errno.ENOSPC) in done.err
    there = content(out)
    assert 1 < len(there) < len(whole)
    assert there.items() <= whole.items()
    subprocess.run(["mount", "-o", "remount,size=4m", small], check=True)
    assert again(out).code == 0
    assert content(out) == whole
