"""The whole story on data that come with the package."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ambid.compare import compare
from ambid.estimate import ParameterEstimate
from ambid.identify import identify
from ambid.plot import save_comparison
from ambid.record import Record, StaticLoading
from ambid.rig import Rig
from ambid.static_load import static_load

DATA = Path(__file__).parent / "demo_data"
"""A two-bearing test bench at 6 A bias: rig file, one pseudo-random record, five static loadings."""


def run(out: Path, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Identify the bench, hold it against static loading, and draw it.

    Parameters
    ----------
    out : Path
        Folder for the model and the picture; made if needed.
    say : callable
        Takes each piece of the story.

    Returns
    -------
    dict
        Plain data of all results, and the files written.
    """
    begun = time.perf_counter()
    out.mkdir(parents=True, exist_ok=True)
    rig = Rig.load(DATA / "rig.toml")
    record = Record.load(DATA / "prbs.mat", rig)
    say(f"1. The rig file and a record, measured levitated:\n{record!r}\n")
    estimate = identify(rig, record)
    say(f"2. Closed-loop identification, from the rig's nominal values:\n{estimate!r}\n")
    comparison = compare(estimate.model, record)
    say(f"3. What the model misses:\n{comparison!r}\n")
    loading = static_load(rig, [StaticLoading.load(path, rig) for path in sorted(DATA.glob("static_*.csv"))])
    say("4. K_i by both methods [N/A]:")
    say(f"{'':12s} {'closed-loop identification':>32s} {'static loading':>32s}")
    for name, static in loading.parameters.items():
        say(f"{name:12s} {_interval(estimate.parameters[name]):>32s} {_interval(static):>32s}")
    model, picture = out / "model.json", out / "measured_and_simulated.png"
    estimate.save(model)
    save_comparison(comparison, picture)
    seconds = time.perf_counter() - begun
    say(f"\nwritten in {seconds:.1f} s: {picture} (the picture), {model} (for --model)")
    return {
        "identify": estimate.to_json(),
        "compare": comparison.to_json(),
        "static_load": loading.to_json(),
        "files": [str(picture), str(model)],
        "seconds": seconds,
    }


def _interval(p: ParameterEstimate) -> str:
    if p.value is None or p.ci95 is None:
        return "not identifiable"
    return f"{p.value:.2f} [{p.ci95[0]:.2f}, {p.ci95[1]:.2f}]"
