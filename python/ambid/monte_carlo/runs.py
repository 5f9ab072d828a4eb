"""The runs of a plan: simulated, then identified or diagnosed, a row of plain numbers and words each."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ambid.diagnosis import diagnose
from ambid.errors import AmbidError, Stopped
from ambid.identification import identify_many
from ambid.identification.many import FAILED
from ambid.monte_carlo.plan import Plan, Truth
from ambid.record import Record
from ambid.threads import with_one_blas_thread

Row = dict[str, Any]


def columns(plan: Plan) -> dict[str, type]:
    """Names and types of what a row holds."""
    names = plan.start.names
    of_diagnosis: dict[str, type] = {"verdict": str, "effects": str, "ambiguous": str} if plan.diagnose else {}
    return (
        {"run": int, "seed": int, "status": str, "reason": str, "misfit": float, "misfit_bound": float}
        | {"adequate": bool}
        | of_diagnosis
        | {f"drawn.{key}": float for key in plan.drawn}
        | {f"{name}.{what}": float for name in names for what in ("true", "value", "std_error")}
    )


@with_one_blas_thread  # the last digits of a product depend on the number
def rows_of(plan: Plan, runs: Sequence[int], progress: Callable[[int], None] | None = None) -> list[Row]:
    """The rows of some runs; one that fails has its reason in the row.

    Raises
    ------
    Stopped
        At Ctrl-C, with the rows before the first run that is not done.
    """
    rows = [_empty(plan, run) for run in runs]
    made: list[tuple[Row, Record]] = []
    for row in rows:
        try:
            truth = plan.of_run(row["run"])
            _add_truth(row, truth, plan)
            made.append((row, plan.record(row["run"], truth)))
        except AmbidError as error:
            row |= {"status": FAILED, "reason": str(error)}
    try:
        (_diagnose if plan.diagnose else _identify)(plan, made, progress)
    except KeyboardInterrupt:
        done = next((k for k, row in enumerate(rows) if not row["status"]), len(rows))
        raise Stopped(rows[:done]) from None
    return rows


def failed_row(plan: Plan, run: int, reason: str) -> Row:
    """The row of a run that cannot be made, for a reason that lies outside of it."""
    row = _empty(plan, run)
    with suppress(AmbidError):  # what cannot be drawn stays empty, as in `rows_of`
        _add_truth(row, plan.of_run(run), plan)
    return row | {"status": FAILED, "reason": reason}


def _empty(plan: Plan, run: int) -> Row:
    nothing = {str: "", float: np.nan, bool: False, int: 0}
    return {name: nothing[kind] for name, kind in columns(plan).items()} | {"run": run}


def _add_truth(row: Row, truth: Truth, plan: Plan) -> None:
    true = {p.name: p.value for p in truth.model.parameters}
    row |= {"seed": truth.seed} | {f"{name}.true": true[name] for name in plan.start.names}
    row |= {f"drawn.{key}": truth.drawn[key] for key in plan.drawn}


def _identify(plan: Plan, made: Sequence[tuple[Row, Record]], progress: Callable[[int], None] | None) -> None:
    stopped = False
    try:
        found = identify_many(plan.start, [record for _, record in made], progress=progress)
    except Stopped as early:
        found, stopped = early.result, True  # type: ignore[assignment]
    for k, (row, _) in enumerate(made[: len(found)]):
        row |= {"status": found.status[k], "reason": found.reasons[k], "adequate": bool(found.adequate[k])}
        row |= {"misfit": float(found.misfit[k]), "misfit_bound": float(found.misfit_bound[k])}
        for j, name in enumerate(found.names):
            row |= {f"{name}.value": float(found.values[k, j]), f"{name}.std_error": float(found.std_errors[k, j])}
    if stopped:
        raise KeyboardInterrupt


def _diagnose(plan: Plan, made: Sequence[tuple[Row, Record]], progress: Callable[[int], None] | None) -> None:
    for k, (row, record) in enumerate(made):
        try:
            found = diagnose(plan.start, record)
        except AmbidError as error:
            row |= {"status": FAILED, "reason": str(error)}
            continue
        row |= {"status": "diagnosed", "verdict": found.verdict, "effects": ",".join(found.effects)}
        row["ambiguous"] = ";".join(",".join(names) for names in found.ambiguous_sets)
        if found.fit is not None:
            row |= {"misfit": float(found.fit.misfit), "misfit_bound": float(found.fit.bound)}
            row["adequate"] = bool(found.fit.is_adequate)
        for name in plan.start.names:
            own = found.parameters.get(name)
            if own is not None and own.value is not None and own.std_error is not None:
                row |= {f"{name}.value": own.value, f"{name}.std_error": own.std_error}
        if progress is not None:
            progress(k + 1)
