"""Intervals against the truth: what `coverage.py` and `cuts.py` share."""

import time
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from ambid import Estimate, Model, Record, Rig, compare, identify
from benchmarks.grid import Row, rate_text

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
NORMAL = (-1.96, -0.67, 0.0, 0.67, 1.96)
"""Quantiles of the normal distribution."""


def cut(record: Record, start: int, length: int, rig: Rig) -> Record:
    """A piece of a record, as a file of it would be loaded."""
    piece = slice(start, start + length)
    found = Record.from_arrays(
        **{name: None if (a := getattr(record, name)) is None else a[piece] for name in ("y", "i_e", "i_c")},
        sample_rate=record.sample_rate,
        axes=record.axes,
        rig=rig,
        name=record.name,
    )
    return found if record.point is None else found.at(record.point)


def at_will(samples: int, shortest: int, random: np.random.Generator) -> tuple[int, int]:
    """Start and length of a piece: any ratio of lengths and any start are as likely as any other."""
    length = round(shortest * (samples / shortest) ** random.random())
    return int(random.integers(samples - length + 1)), length


def truth_of(rig: Rig, K_i: Sequence[float], K_s: Sequence[float], tau_e: float) -> dict[str, float]:
    """True values by the names of the base model."""
    found = {"tau_e": float(tau_e)}
    for name, values in (("K_i", K_i), ("K_s", K_s)):
        found |= {f"{name}.{axis}": float(value) for axis, value in zip(rig.axes, values, strict=True)}
    return found


def judged(model: Model, records: Sequence[Record], truth: Mapping[str, float]) -> Row:
    """Identify, and hold each interval against the truth."""
    begun = time.perf_counter()
    try:
        estimate = identify(model, records)
        misfit = misfit_of(estimate, records)
    except Exception as error:
        return {"status": "error", "error": f"{type(error).__name__}: {error}", "parameters": {}}
    found = {}
    for name, true in truth.items():
        own = estimate.parameters[name]
        if own.value is not None and own.std_error and own.ci95 is not None:
            within = bool(own.ci95[0] <= true <= own.ci95[1])
            found[name] = {"value": own.value, "within": within, "off": (own.value - true) / own.std_error}
            found[name]["relative_error"] = own.std_error / abs(true)
        else:
            found[name] = None
    seconds = time.perf_counter() - begun
    return {"status": estimate.status, "misfit": misfit, "parameters": found, "seconds": seconds}


def misfit_of(estimate: Estimate, records: Sequence[Record]) -> float | None:
    """J/dof of the fitted model, by the estimate itself where it gives it; None where it is not known."""
    shown = getattr(estimate, "misfit", None)
    if shown is None:
        shown = float(np.mean([one.misfit for one in compare(estimate.model, records).records]))
    return float(shown) if np.isfinite(shown) else None


HEAD = ("of", "parameter", "truth within 95 %", "off: mean", "std", *(f"{100 * q:g} %" for q in QUANTILES), "unknown")


def spread_rows(name: str, rows: Sequence[Row]) -> list[list[str]]:
    """A line for each parameter, and one for all of them: coverage, and (estimate - truth) / standard error."""
    by_name: dict[str, list[Row | None]] = defaultdict(list)
    for row in rows:
        for parameter, found in row["parameters"].items():
            by_name[parameter].append(found)
    every = [found for values in by_name.values() for found in values]
    order = [*sorted(by_name)]
    return [
        _line(name, parameter, values)
        for parameter, values in zip([*order, "all"], [*(by_name[p] for p in order), every], strict=True)
        if values
    ]


def _line(name: str, parameter: str, values: Sequence[Row | None]) -> list[str]:
    known = [found for found in values if found is not None]
    unknown = str(len(values) - len(known))
    if not known:
        return [name, parameter, "", "", "", *[""] * len(QUANTILES), unknown]
    off = np.array([found["off"] for found in known])
    within = rate_text(sum(found["within"] for found in known), len(known))
    quantiles = (f"{q:.2f}" for q in np.quantile(off, QUANTILES))
    return [name, parameter, within, f"{off.mean():.2f}", f"{off.std():.2f}", *quantiles, unknown]


NORMAL_LINE = ["(as it should be)", "", "95 %", "0", "1", *(f"{q:.2f}" for q in NORMAL), ""]


def misfit_line(name: str, rows: Sequence[Row]) -> list[str]:
    """Number of runs, how they ended, and how J/dof is spread."""
    values = np.array([row["misfit"] for row in rows if row.get("misfit") is not None])
    quantiles = [f"{q:.3f}" for q in np.quantile(values, QUANTILES)] if len(values) else [""] * len(QUANTILES)
    middle = [f"{values.mean():.3f}", f"{values.std():.3f}"] if len(values) else ["", ""]
    errors = sum(row["status"] == "error" for row in rows)
    other = sum(row["status"] not in ("error", "converged") for row in rows)
    return [name, str(len(rows)), str(errors), str(other), str(len(values)), *middle, *quantiles]


MISFIT_HEAD = (
    *("of", "runs", "errors", "not converged", "with J/dof", "mean", "std"),
    *(f"{100 * q:g} %" for q in QUANTILES),
)
