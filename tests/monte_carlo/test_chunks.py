"""Rows on the disk: whatever stops a job, the same command ends with the same files."""

import errno
import json
import os
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest

from ambid.cli.virtual import GO_ON
from ambid.errors import IdentificationError, InputError, OutputError, Stopped
from ambid.monte_carlo import Spread, procedure, run_monte_carlo
from ambid.monte_carlo.result import RUNS_FAILED, TOO_FEW_RUNS
from monte_carlo.planned import CHUNK, RIG, RUNS, content, plan

parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch):
    monkeypatch.setattr(procedure, "CHUNK", CHUNK)


def test_one_table_for_other_programs(whole):
    table = parquet.read_table(whole.folder)
    assert sorted(table["run"].to_pylist()) == list(range(RUNS))
    assert np.allclose(table["tau_e.value"].to_numpy(), [row["tau_e.value"] for row in whole.rows])


def test_fewer_runs_first(whole, tmp_path):
    folder = tmp_path / "runs.parquet"
    run_monte_carlo(plan(), 6, out=folder)
    made = []
    found = run_monte_carlo(plan(), RUNS, out=folder, progress=lambda done, total: made.append(total))
    assert made[0] == RUNS - 6
    assert content(folder) == whole.parts
    assert found.rows == whole.rows


def test_stopped_by_ctrl_c(whole, tmp_path):
    folder = tmp_path / "runs.parquet"

    def stop(done, total):
        if done >= 6:
            raise KeyboardInterrupt

    with pytest.raises(Stopped) as stopped:
        run_monte_carlo(plan(), RUNS, out=folder, progress=stop)
    kept = stopped.value.result.rows
    assert 4 <= len(kept) < RUNS
    assert parquet.read_table(folder).num_rows == len(kept)
    run_monte_carlo(plan(), RUNS, out=folder)
    assert content(folder) == whole.parts


def test_a_full_disk(whole, tmp_path, monkeypatch, golden):
    folder, write, written = tmp_path / "runs.parquet", parquet.write_table, []

    def full(table, stream):
        if written:
            write(table.slice(0, 1), stream)
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(table)
        write(table, stream)

    monkeypatch.setattr(parquet, "write_table", full)
    with golden.raises(OutputError):
        run_monte_carlo(plan(), RUNS, out=folder)
    assert parquet.read_table(folder).num_rows == 4
    monkeypatch.undo()
    monkeypatch.setattr(procedure, "CHUNK", 4)
    run_monte_carlo(plan(), RUNS, out=folder)
    assert content(folder) == whole.parts


def test_a_worker_that_is_gone(tmp_path, golden):
    class Broken(ThreadPoolExecutor):
        def submit(self, work, *given):
            def gone():
                raise BrokenProcessPool("terminated abruptly")

            return super().submit(gone) if given[1:] and 4 in given[1] else super().submit(work, *given)

    folder = tmp_path / "runs.parquet"
    with Broken(1) as executor, golden.raises(IdentificationError):
        run_monte_carlo(plan(), RUNS, out=folder, executor=executor)
    assert parquet.read_table(folder).num_rows == 4


def test_another_plan(tmp_path, golden):
    folder = tmp_path / "runs.parquet"
    run_monte_carlo(plan(), 1, out=folder)
    with golden.raises(InputError):
        run_monte_carlo(plan(seed=9, spreads=(Spread.parse("K_i=normal:1%"),)), 1, out=folder)


def test_a_part_that_is_broken(tmp_path, golden):
    folder = tmp_path / "runs.parquet"
    run_monte_carlo(plan(), 1, out=folder)
    (folder / "part-000000.parquet").write_bytes(b"PAR1")
    with golden.raises(InputError):
        run_monte_carlo(plan(), 1, out=folder)


def test_parts_that_changed_places(tmp_path, golden):
    folder = tmp_path / "runs.parquet"
    run_monte_carlo(plan(), CHUNK + 1, out=folder)
    (folder / "part-000001.parquet").replace(folder / "part-000000.parquet")
    with golden.raises(InputError):
        run_monte_carlo(plan(), CHUNK + 1, out=folder)


@pytest.mark.parametrize("text", ["{", "[]"])
def test_a_plan_that_is_broken(tmp_path, text, golden):
    folder = tmp_path / "runs.parquet"
    folder.mkdir()
    (folder / procedure.PLAN).write_text(text)
    with golden.raises(InputError):
        run_monte_carlo(plan(), 1, out=folder)


def test_places_that_are_none(tmp_path, golden):
    (tmp_path / "file.parquet").write_text("mine")
    (tmp_path / "own.parquet").mkdir()
    (tmp_path / "own.parquet" / "diary.txt").write_text("mine")
    for name in ("runs.csv", "file.parquet", "own.parquet"):
        with golden.raises(InputError):
            run_monte_carlo(plan(), 1, out=tmp_path / name)


@pytest.fixture
def rig_file(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(RIG.to_toml())
    return path


def test_the_command(command, rig_file, tmp_path):
    out, json_file = tmp_path / "runs.parquet", tmp_path / "found.json"
    call = ["monte-carlo", rig_file, "--runs", 6, "--out", out, "--seed", 3, "--seconds", 0.5, "--amplitude", 1.0]
    call += ["--spread", "K_i=normal:1%", "--effect", "sensor_lag:time_constant=2e-5", "--json", json_file]
    done = command(*call)
    assert (done.code, done.err) == (0, "")
    found = json.loads(json_file.read_text())
    assert (found["runs"], found["seed"], found["stopped"]) == (6, 3, False)
    assert found["parameters"]["tau_e"]["runs"] == 6
    before = content(out)
    assert command(*call).code == 0
    assert content(out) == before


@pytest.mark.slow
def test_workers_leave_the_same(command, rig_file, tmp_path):
    call = ["monte-carlo", rig_file, "--runs", RUNS, "--seconds", 0.32, "--amplitude", 1.0, "--quiet"]
    for workers in (1, 2):
        done = command(*call, "--workers", workers, "--out", tmp_path / f"{workers}.parquet")
        assert (done.code, done.err) == (0, "")
    assert len(content(tmp_path / "1.parquet")) == 4
    assert content(tmp_path / "1.parquet") == content(tmp_path / "2.parquet")


@pytest.mark.parametrize(
    "option",
    [
        ["--spread", "K_i=wide"],
        ["--spread", "bearing.Z.air_gap=normal:1%"],
        ["--runs", "0"],
        ["--workers", "0"],
        ["--seed", "-1"],
        ["--out", "runs.csv"],
    ],
    ids=" ".join,
)
def test_bad_options(command, rig_file, option, golden):
    done = command("monte-carlo", rig_file, *option)
    assert done.code == 2
    golden.holds(done.err)


def test_an_effect_that_is_unknown_is_named(command, rig_file):
    done = command("monte-carlo", rig_file, "--effect", "magic")
    assert done.code == 2
    assert "magic" in done.err


def test_runs_that_all_fail_are_an_error_in_words(command, rig_file, tmp_path, golden):
    """A controller that is a hundred times too weak leaves every loop unstable."""
    text = rig_file.read_text()
    rig_file.write_text(re.sub(r"(?m)^proportional = .*$", "proportional = 20.0", text))
    assert rig_file.read_text() != text
    done = command("monte-carlo", rig_file, "--runs", 2, "--json", tmp_path / "found.json")
    assert done.code == 1
    golden.holds(done.err)
    assert "nan" not in done.out
    assert "bias %" not in done.out
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["status"] == {"failed": 2}
    (finding,) = found["findings"]
    assert (finding["code"], finding["severity"]) == (RUNS_FAILED.code, "error")
    assert finding["values"] == {"failed": 2, "runs": 2, "reason": next(iter(found["reasons"]))}
    assert command("monte-carlo", rig_file, "--runs", 2, "--quiet").code == 1


def test_one_run_has_no_table(command, rig_file, tmp_path):
    call = ("monte-carlo", rig_file, "--runs", 1, "--seconds", 0.5, "--amplitude", 1.0)
    done = command(*call, "--json", tmp_path / "found.json")
    assert done.code == 0
    assert "nan" not in done.out
    (finding,) = json.loads((tmp_path / "found.json").read_text())["findings"]
    assert finding["code"] == TOO_FEW_RUNS.code
    assert finding["remedy"] in done.out


def test_ctrl_c_of_the_command(command, rig_file, tmp_path, monkeypatch):
    from ambid.monte_carlo import runs

    identify = runs.identify_many

    def once(*arguments, **options):
        monkeypatch.setattr(runs, "identify_many", lambda *_, **__: os.kill(os.getpid(), signal.SIGINT))
        return identify(*arguments, **options)

    monkeypatch.setattr(runs, "identify_many", once)
    out, json_file = tmp_path / "runs.parquet", tmp_path / "found.json"
    call = ("monte-carlo", rig_file, "--runs", RUNS, "--out", out, "--seconds", 0.5, "--amplitude", 1.0)
    done = command(*call, "--json", json_file)
    assert done.code == 130
    found = json.loads(json_file.read_text())
    assert (found["stopped"], found["runs"]) == (True, 4)
    assert GO_ON in done.out
    assert parquet.read_table(out).num_rows == 4
