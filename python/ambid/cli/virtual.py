"""The command `monte-carlo`: many virtual experiments, made here, by processes of this machine, or by a cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Annotated, Any

import typer

import ambid
from ambid.cli.experiments import excitation_of
from ambid.cli.files import load_model, load_rig
from ambid.cli.options import (
    Channels,
    Exact,
    JsonFile,
    ModelFile,
    Quiet,
    RigFile,
    known_effects,
    noise_of,
    with_effects,
)
from ambid.cli.outputs import conclude, require_outputs
from ambid.cli.signals import done_of, exit_code, stoppable
from ambid.cli.terminal import progress, with_time_left
from ambid.errors import IdentificationError, InputError

PATIENCE = 5.0
"""Seconds in which a scheduler answers; one that is there takes far less than one."""
MOST_WORKERS = 1000
"""Processes of one machine: beyond its cores they only take memory, some hundred megabytes each."""
GO_ON = "the same command goes on from there"


def monte_carlo_command(
    rig: RigFile,
    runs: Annotated[int, typer.Option(metavar="N", help="Virtual experiments.")] = 100,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR.parquet", help="Folder for a row of each run; a job that was stopped goes on there."),
    ] = None,
    seed: Annotated[int, typer.Option(help="All that is random comes from it.")] = 0,
    spread: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=DIST",
            help="Draw a value for each run: a parameter, a number of the rig file, or amplitude, as normal:5%, "
            "uniform:SIZE or uniform:LOW:HIGH; repeatable.",
        ),
    ] = [],  # noqa: B006
    effect: Annotated[
        list[str],
        typer.Option(
            metavar="NAME:param=value,...", help="Physics that is hidden; repeatable.", autocompletion=known_effects
        ),
    ] = [],  # noqa: B006
    diagnose: Annotated[bool, typer.Option("--diagnose", help="Diagnose each record instead of identifying.")] = False,
    seconds: Annotated[float, typer.Option(help="Length of each record; rounded up to whole periods.")] = 2.0,
    amplitude: Annotated[float, typer.Option(help="Of the pseudo-random binary excitation [A].")] = 0.1,
    sensor_noise: Annotated[float, typer.Option(help="Rms on every displacement [m].")] = 50e-9,
    current_noise: Annotated[float, typer.Option(help="Rms on every recorded current [A].")] = 0.01,
    channel: Channels = [],  # noqa: B006
    workers: Annotated[int, typer.Option(metavar="N", help="Processes; 1 works in this one, over all cores.")] = 1,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Scheduler of dask distributed whose workers make the runs: tcp://host:8786."
        ),
    ] = None,
    model: ModelFile = None,
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Find out what an experiment is worth: simulate it many times, and identify or diagnose every record."""
    require_outputs({"RIG": rig, "--model": model}, {"--json": json_file})
    machine = load_rig(rig, exact)
    plan = ambid.Plan(
        rig=machine,
        excitation=excitation_of(machine, seconds, amplitude),
        truth=with_effects(load_model(machine, model), effect),
        spreads=tuple(ambid.Spread.parse(text) for text in spread),
        sensor_noise=sensor_noise,
        current_noise=current_noise,
        further_noise=noise_of(channel, machine),
        seed=seed,
        diagnose=diagnose,
    )
    left_at_worst = (f"while {out} was written; {GO_ON}",) if out is not None else ()
    with (
        stoppable(*left_at_worst),
        progress(quiet, "Monte Carlo") as report,
        _workers_of(plan, workers, cluster) as executor,
    ):
        show = with_time_left(report)
        making = partial(
            ambid.run_monte_carlo,
            plan,
            runs,
            out=out,
            executor=executor,
            progress=lambda done, total: show("run", done, total),
        )
        found, is_stopped = done_of(making, ambid.MonteCarlo)
    left = [f"stopped after {len(found.rows)} of {runs} runs"] if is_stopped else []
    if is_stopped and out is not None:
        left.append(GO_ON)
    data = found.to_json() | {"stopped": is_stopped}
    conclude("\n".join([str(found), *left]), data, json_file, quiet, is_stopped=is_stopped)
    if is_stopped:
        raise typer.Exit(exit_code())
    if found.all_failed:
        raise IdentificationError(f"{rig}: {found.findings[0].message}")


def _workers_of(plan: ambid.Plan, workers: int, cluster: str | None) -> AbstractContextManager[Any]:
    """The executor that the options ask for; nothing where the runs are made here.

    Raises
    ------
    InputError
        If they contradict each other, or no scheduler answers.
    """
    if not 1 <= workers <= MOST_WORKERS:
        raise InputError(f"--workers {workers}: expected 1 to {MOST_WORKERS}")
    if cluster is not None and workers > 1:
        raise InputError(f"--workers {workers}, --cluster {cluster}: a cluster has workers of its own; leave one out")
    if cluster is not None:
        return _cluster(cluster)
    return nullcontext() if workers == 1 else _pool(plan, workers)


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    if find_spec("distributed") is None:
        raise InputError(f"--cluster {address}: needs the package distributed: pip install 'ambid[cluster]'")
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--cluster {address}: no scheduler answers ({error}); expected an address such as tcp://host:8786, "
            "as `dask scheduler` prints it"
        ) from None
    with client:
        yield client


@contextmanager
def _pool(plan: ambid.Plan, workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that make runs, each in one thread; when they are no longer wanted they end at once."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _as_worker, (plan,))
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for own in set(multiprocessing.active_children()) - others:
            own.terminate()


def _as_worker(plan: ambid.Plan) -> None:
    os.environ["RAYON_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one that waits for this process ends it
    Thread(target=_end_with_parent, daemon=True).start()
    ambid.hold_plan(plan)


def _end_with_parent() -> None:
    """A parent that was killed leaves nobody to end its workers, which would wait for tasks for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)
