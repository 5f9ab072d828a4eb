"""A cluster of dask distributed on this machine: the same to the last digit, whoever dies."""

import os
import re
import signal

import pytest

from ambid.cli import virtual
from ambid.errors import IdentificationError
from ambid.monte_carlo import executors, procedure, run_monte_carlo
from monte_carlo.planned import CHUNK, RUNS, content, plan
from monte_carlo.test_chunks import rig_file  # noqa: F401
from tiers import first_fast

distributed = pytest.importorskip("distributed")
pytest.importorskip("pyarrow")


@pytest.fixture(autouse=True)
def _small_tasks(monkeypatch):
    monkeypatch.setattr(procedure, "CHUNK", CHUNK)
    monkeypatch.setattr(procedure, "BATCH", 2)


@pytest.fixture(scope="module")
def cluster():
    """Two processes, each in one thread."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs="ERROR"
    ) as two:
        yield two


@pytest.fixture(scope="module")
def threads():
    """Two workers in this process."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs="ERROR", processes=False
    ) as two:
        yield two


def client_of(cluster):
    own = distributed.Client(cluster, set_as_default=False)
    own.wait_for_workers(2, timeout=60)
    return own


@pytest.fixture
def client(cluster):
    with client_of(cluster) as own:
        yield own


@pytest.fixture
def near(threads):
    """The client of workers in this process."""
    with client_of(threads) as own:
        yield own


@pytest.mark.parametrize("kind", first_fast(["client", "executor"]))
@pytest.mark.parametrize("workers", ["near", pytest.param("client", marks=pytest.mark.slow)])
def test_two_workers_equal_one_thread(workers, kind, whole, tmp_path, request):
    folder, own = tmp_path / "runs.parquet", request.getfixturevalue(workers)
    executor = own if kind == "client" else own.get_executor()
    assert run_monte_carlo(plan(), RUNS, out=folder, executor=executor).rows == whole.rows
    assert content(folder) == whole.parts


@pytest.mark.slow
def test_a_worker_killed_midway(client, whole, tmp_path):
    folder = tmp_path / "runs.parquet"
    alive = list(client.run(os.getpid).values())

    def kill(done, total):
        if alive and done >= 4:
            os.kill(alive.pop(), signal.SIGKILL)
            alive.clear()

    assert run_monte_carlo(plan(), RUNS, out=folder, executor=client, progress=kill).rows == whole.rows
    assert not alive
    assert content(folder) == whole.parts


@pytest.mark.slow
def test_a_worker_that_joins(whole, tmp_path):
    """There is none when the runs are sent."""
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0", silence_logs="ERROR", processes=False) as none,
        distributed.Client(none, set_as_default=False) as client,
    ):
        joined = []

        def join(done, total):
            if not joined:
                joined.append(client.loop.call_later(0.2, none.scale, 1))

        assert run_monte_carlo(plan(), RUNS, executor=client, progress=join).rows == whole.rows


@pytest.mark.slow
def test_a_run_that_kills_its_workers_is_a_row(cluster, client, whole, monkeypatch, golden):
    """Its neighbours, whom dask blames too, are not."""
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    usual = executors.make_rows

    def deadly(runs, plan):
        if 5 in runs:
            os._exit(1)
        return usual(runs, plan)

    monkeypatch.setattr(executors, "make_rows", deadly)
    rows = run_monte_carlo(plan(), 8, executor=client).rows
    assert [row for row in rows if row["run"] != 5] == [row for row in whole.rows[:8] if row["run"] != 5]
    assert rows[5]["status"] == "failed"
    golden.holds(rows[5]["reason"])
    assert rows[5]["K_i.A_zeta.true"] == whole.rows[5]["K_i.A_zeta.true"]


def test_the_runs_are_cancelled(near, golden):
    """As by a scheduler that was started again."""

    def cancel(done, total):
        if done:
            near.cancel([distributed.Future(key, near) for key in list(near.futures)], force=True)

    with golden.raises(IdentificationError):
        run_monte_carlo(plan(), RUNS, executor=near, progress=cancel)


CALL = ("--runs", RUNS, "--seconds", 0.5, "--amplitude", 1.0)


@pytest.mark.slow
def test_the_command(cluster, command, rig_file, tmp_path):  # noqa: F811
    for name, more in (("here", ()), ("there", ("--cluster", cluster.scheduler_address))):
        done = command("monte-carlo", rig_file, *CALL, *more, "--out", tmp_path / f"{name}.parquet")
        assert done.code == 0
    assert len(content(tmp_path / "here.parquet")) == 4
    assert content(tmp_path / "here.parquet") == content(tmp_path / "there.parquet")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://host", "127.0.0.1:99999999"])
def test_no_cluster(command, rig_file, monkeypatch, address, golden):  # noqa: F811
    monkeypatch.setattr(virtual, "PATIENCE", 0.5)
    done = command("monte-carlo", rig_file, *CALL, "--cluster", address)
    assert done.code == 2
    golden.holds(re.sub(r"\(.*\)", "(...)", error_of(done)))  # within them dask speaks


def test_a_cluster_and_workers(command, rig_file, golden):  # noqa: F811
    done = command("monte-carlo", rig_file, *CALL, "--cluster", "tcp://127.0.0.1:1", "--workers", 2)
    assert done.code == 2
    golden.holds(error_of(done))


def test_without_dask(command, rig_file, monkeypatch, golden):  # noqa: F811
    monkeypatch.setattr(virtual, "find_spec", lambda name: None)
    done = command("monte-carlo", rig_file, "--cluster", "tcp://127.0.0.1:1")
    assert done.code == 2
    golden.holds(error_of(done))


def error_of(done):
    """Its line of stderr; dask may log beside it, where the machine is loaded."""
    (error,) = (line for line in done.err.splitlines() if line.startswith("error:"))
    return error
