"""Tables and a picture of false verdicts by level, and of p-values against the uniform ones that they should be."""

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
from scipy.stats import binom

from benchmarks.grid import Row, aligned, markdown, rate_text, wilson

NOMINAL = 0.01
CHANCE = 0.025
"""Of as many false verdicts or more at a rate of `NOMINAL`, below which it is above that: of one level, not of all."""
CLAIMS = ("explained", "ambiguous", "none_of_the_candidates")
FACTORS = (
    *("machine", "noise", "bits", "noise / step", "freedom", "periods", "damping", "speed", "controller"),
    "machine x noise",
)
LEVELS = (1e-4, 1e-3, 0.01, 0.05, 0.1, 0.25, 0.5)
HEAD = (
    "factor",
    "level",
    "records",
    "false",
    "rate %, 95 %",
    "above 1 %",
    "refused",
    "error",
    "J/dof",
    "tone",
    "drift",
)


def is_false(row: Row) -> bool:
    """Whether the verdict claims something."""
    return row["verdict"] in CLAIMS


def by_level(rows: list[Row]) -> dict[str, dict[str, list[Row]]]:
    """Rows of every level of every factor."""
    found: dict[str, dict[str, list[Row]]] = {factor: defaultdict(list) for factor in FACTORS}
    for row in rows:
        for factor, level in row["cell"]["levels"].items():
            found[factor][level].append(row)
    return {factor: dict(sorted(levels.items(), key=lambda one: _order(one[0]))) for factor, levels in found.items()}


def _order(level: str) -> tuple[float, str]:
    try:
        return float(level.split()[0]), level
    except ValueError:
        return np.inf, level


def is_above(wrong: int, records: int) -> bool:
    """Whether so many false verdicts are significantly more than `NOMINAL`, by the binomial distribution."""
    return bool(binom.sf(wrong - 1, records, NOMINAL) < CHANCE)


def _line(factor: str, level: str, rows: list[Row]) -> list[str]:
    wrong, low = sum(map(is_false, rows)), wilson(sum(map(is_false, rows)), len(rows))
    misfits = [row["misfit"] for row in rows if row.get("misfit") is not None]
    return [
        factor,
        level,
        str(len(rows)),
        str(wrong),
        f"{100 * wrong / len(rows):.1f} ({100 * low[0]:.1f} .. {100 * low[1]:.1f})",
        "yes" if is_above(wrong, len(rows)) else "",
        str(sum(row["verdict"] == "not_informative" for row in rows)),
        str(sum(row["verdict"] == "error" for row in rows)),
        f"{np.mean(misfits):.3f} +- {np.std(misfits):.3f}" if misfits else "",
        str(sum(bool(row.get("tone")) for row in rows)),
        str(sum(bool(row.get("drift")) for row in rows)),
    ]


def level_rows(rows: list[Row]) -> list[list[str]]:
    """A line per level, and one for all."""
    lines = [_line(factor, level, own) for factor, levels in by_level(rows).items() for level, own in levels.items()]
    return [_line("all", "", rows), *lines]


def chances(rows: list[Row]) -> dict[str, np.ndarray]:
    """p-values that should be uniform, or larger: of the best candidate for all of them, and of single ones."""
    judged = [row for row in rows if row.get("p_value") is not None]
    single: dict[str, list[float]] = defaultdict(list)
    for row in judged:
        for effect, value in row["p_values"].items():
            if value is not None:
                single[effect].append(value)
    tone = single.pop("periodic_disturbance", [])
    return {
        "best of all, times their number": np.array([min(1.0, r["p_value"] * r["candidates"]) for r in judged]),
        "any effect but a tone": np.array([value for values in single.values() for value in values]),
        "periodic_disturbance": np.array(tone),
        **{effect: np.array(values) for effect, values in sorted(single.items())},
    }


def chance_rows(rows: list[Row]) -> list[list[str]]:
    """Share of the p-values below each level, percent."""
    return [
        [name, str(len(values)), *(f"{100 * np.mean(values <= level):.3g}" for level in LEVELS)]
        for name, values in chances(rows).items()
        if len(values)
    ]


CHANCE_HEAD = ("p-value of", "number", *(f"<= {level:g}" for level in LEVELS))


def apart(rows: list[Row]) -> list[list[str]]:
    """Rates of the tests of tones and of drift, in all records and where one has periods."""
    periodic = [row for row in rows if row["cell"]["periods"]]
    return [
        [test, rate_text(sum(bool(r.get(test)) for r in rows), len(rows)), _rate(test, periodic)]
        for test in ("tone", "drift")
    ]


def _rate(test: str, rows: list[Row]) -> str:
    return rate_text(sum(bool(row.get(test)) for row in rows), len(rows))


APART_HEAD = ("test", "found in all records", "where i_e repeats")


def reasons(rows: list[Row]) -> list[list[str]]:
    """What the false verdicts, refusals and errors say."""
    shown: Counter[str] = Counter()
    for row in rows:
        if row["verdict"] == "adequate":
            continue
        named = "+".join(row.get("effects") or ["/".join(names) for names in row.get("sets", ())])
        drifting = ", changes during the record" if row.get("drift") else ""
        shown[f"{row['verdict']} {named or row.get('error', '')[:90]}{drifting}".strip()] += 1
    return [[what, str(count)] for what, count in shown.most_common(15)]


def report(rows: list[Row]) -> None:
    """Print all tables."""
    print(aligned(("verdict", "records"), reasons(rows)), end="\n\n")
    print(aligned(HEAD, level_rows(rows)), end="\n\n")
    print(aligned(CHANCE_HEAD, chance_rows(rows)), end="\n\n")
    print(aligned(APART_HEAD, apart(rows)), end="\n\n")
    seconds, making = ([row[key] for row in rows if key in row] for key in ("seconds", "making"))
    if seconds:
        print(f"seconds: median {np.median(seconds):.1f}, largest {max(seconds):.1f}, all {sum(seconds):.0f}")
    print(f"false: {rate_text(sum(map(is_false, rows)), len(rows))}; {sum(making):.0f} s to make the records")


def table(rows: list[Row]) -> str:
    """The tables in Markdown, without the single cells of machine and noise."""
    lines = [line for line in level_rows(rows) if line[0] != "machine x noise"]
    parts = (markdown(HEAD, lines), markdown(CHANCE_HEAD, chance_rows(rows)), markdown(APART_HEAD, apart(rows)))
    return "\n".join(parts)


def picture(rows: list[Row], path: Path) -> None:
    """Rates of false verdicts by level, and p-values against uniform ones."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 10), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    levels = [
        (f"{factor}: {level}", own)
        for factor, found in by_level(rows).items()
        if factor != "machine x noise"
        for level, own in found.items()
    ]
    for place, (_, own) in enumerate(levels):
        wrong = sum(map(is_false, own))
        low, high = wilson(wrong, len(own))
        colour = "tab:red" if is_above(wrong, len(own)) else "k"
        left.plot([100 * low, 100 * high], [place, place], color=colour, lw=1.5)
        left.plot(100 * wrong / len(own), place, "o", color=colour, ms=4)
    left.axvline(100 * NOMINAL, color="tab:blue", lw=1, ls="--")
    left.set_yticks(range(len(levels)), [f"{name} ({len(own)})" for name, own in levels])
    left.invert_yaxis()
    left.set_xlim(left=0.0)
    left.set_xlabel("records with a false verdict, %, with 95 % intervals (dashed: 1 %)")
    for name, values in list(chances(rows).items())[:3]:
        if len(values):
            expected = (np.arange(len(values)) + 0.5) / len(values)
            right.loglog(expected, np.maximum(np.sort(values), 1e-12), label=f"{name} ({len(values)})")
    right.plot([1e-5, 1.0], [1e-5, 1.0], color="k", lw=1, ls="--")
    right.set_ylim(1e-12, 1.5)
    right.set_xlabel("quantile of a uniform p-value")
    right.set_ylabel("p-value where nothing is hidden (below the dashed line: too small)")
    right.legend()
    figure.savefig(path, dpi=110)
