"""How far the last model is from instability, as the page shows it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambid.errors import AmbidError
from ambid.model import Model
from ambid.report import pictures, words
from ambid.robustness import Margin, Margins, margins, pole_map
from ambid.robustness.result import tolerated

DRAWS = 200
"""Of the parameters: they give a probability to 4 % (one standard error), in less time than a diagnosis takes."""


def standing(model: Model, base: Model | None) -> dict[str, Any]:
    """Margins of a model with their zones, and its poles beside those of the base model."""
    try:
        found = margins(model, draws=DRAWS)
    except AmbidError as error:  # unstable at its values, or a covariance that determines nothing
        return {"why_not": str(error)}
    rows = [
        _row(own.axis, own.sensitivity, own.disk, own.zone, own.zone_probability.get(own.zone)) for own in found.axes
    ]
    rows.append(_row("all at once", found.multivariable, found.disk, "", None))
    return {
        "why_not": "",
        "sentence": _sentence(found),
        "rows": rows,
        "findings": found.findings,
        "picture": pictures.sensitivity(found),
        "poles": pictures.poles(pole_map(model), None if base is None else pole_map(base)),
    }


def _row(axis: str, peak: Margin, disk: Margin, zone: str, probability: float | None) -> dict[str, Any]:
    span = "–" if peak.ci95 is None else " to ".join(map(words.peak, peak.ci95))
    numbers = (words.peak(peak.value), words.decibel(peak.value), words.number(peak.frequency_hz, 4), span)
    return {
        "axis": axis,
        "numbers": (*numbers, "–" if peak.worst is None else words.peak(peak.worst)),
        "zone": zone,
        "probability": "" if not zone else "–" if probability is None else f"{100.0 * probability:.3g} %",
        "disk": f"{disk.value:.3f}",
    }


def _sentence(found: Margins) -> str:
    """Zone with its probability, and what the disk margin allows."""
    worst = max(found.axes, key=lambda own: own.sensitivity.value)
    text = (
        f"The loop is in zone {found.zone} of ISO 14839-3, by the peak of {words.peak(worst.sensitivity.value)} "
        f"({words.decibel(worst.sensitivity.value)} dB) in {worst.axis}"
    )
    if found.zone_probability:
        shares = ", ".join(f"{zone} {100.0 * share:.3g} %" for zone, share in found.zone_probability.items())
        text += f"; by {found.draws} draws of the parameters the zones are as probable as {shares}"
    low, high, phase = tolerated(found.disk.value)
    most = f"{high:.3g}" if np.isfinite(high) else "any"
    return (
        f"{text}. All axes at once tolerate gain factors from {low:.3g} to {most}, or {phase:.3g}° of phase (disk "
        f"margin {found.disk.value:.3g})."
    )
