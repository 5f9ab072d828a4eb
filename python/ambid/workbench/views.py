"""What the page shows of a session, as plain data: every number is made here or below, none on the page.

Of long signals every pixel shows the smallest and the largest sample, so that no peak is lost.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.diagnosis import Candidate, Localisation
from ambid.errors import InputError
from ambid.findings import worst_first
from ambid.model import Parameter
from ambid.noise import Comparison
from ambid.noise.chance import ADEQUATE
from ambid.plot import worst_stretch
from ambid.plot.style import misfit_text, shown_in
from ambid.results import plain
from ambid.workbench.session import Session

LEVELS = (1.5, 3.0, 10.0, 100.0)
"""Misfits from which on a cell of the map is drawn darker; what is below the first says nothing and is grey."""
FEWEST_SAMPLES = 4
"""Samples of the shortest window that is drawn."""
FEWEST_PIXELS, MOST_PIXELS = 50, 4000
"""Widths of a chart that are drawn."""


def overview(session: Session) -> dict[str, Any]:
    """Misfits, effects, parameters, records and the steps so far."""
    estimate, rig = session.estimate, session.bench.start.rig
    return plain(
        {
            "rig": rig.name,
            **misfits(session),
            "bound": session.comparison.bound,
            "adequate": session.comparison.is_adequate,
            "fitted": estimate is not None,
            "can_undo": session.before is not None,
            "effects": [{"name": own.name, "physics": own.physics} for own in session.model.effects],
            "parameters": [_parameter(session, own) for own in session.model.parameters],
            "records": _records(session),
            "steps": [
                {"did": own.did, **misfits(own), "predicted_misfit": own.predicted_misfit} for own in session.chain
            ],
            **_findings(session),
        }
    )


def held(session: Session) -> dict[str, Any]:
    """The model of a session as JSON of the command has it: effects, parameters and misfits, and the steps to it."""
    return plain(
        {
            "effects": [own.name for own in session.model.effects],
            "parameters": {own.name: {"value": own.value, "unit": own.unit} for own in session.model.parameters},
            **misfits(session),
            "misfit_bound": session.comparison.bound,
            "steps": [own.did for own in session.chain],
            **_findings(session),
        }
    )


def misfits(session: Session) -> dict[str, Any]:
    """J/dof of the records and of those to validate on."""
    return plain({"misfit": session.comparison.misfit, "validation_misfit": session.validation_misfit})


def candidates(session: Session) -> dict[str, Any]:
    """The ranking, each candidate with its physics; nothing where it was not asked for."""
    ranking = session.ranking
    if ranking is None:
        return {"candidates": [], "not_tried": {}}
    significant = {own.effect.name for own in ranking.significant}
    rows = [
        own.as_dict()
        | {
            "physics": own.effect.physics,
            "signature": own.effect.signature,
            "significant": own.effect.name in significant,
            "chance": _chance(own),
            "left": _left(own.predicted_misfit, ranking.misfit),
        }
        for own in ranking.candidates
    ]
    return plain({"candidates": rows, "not_tried": ranking.not_tried})


def where(session: Session) -> dict[str, Any]:
    """Misfit maps of all records, and in words what is missing."""
    kept = session.where_kept_back
    maps = [*session.where.maps, *(() if kept is None else kept.maps)]
    return plain(
        {
            "maps": [
                {
                    "record": own.record,
                    "channels": list(own.channels),
                    "edges_hz": own.edges_hz.tolist(),
                    "cells": [[_cell(float(misfit)) for misfit in row] for row in own.misfit.T],
                }
                for own in maps
            ],
            "worst": _worst(session.where),
            "sentence": "" if session.comparison.is_adequate else session.where.sentence(),
        }
    )


def signals(
    session: Session,
    record: int,
    channel: str,
    window: tuple[float, float] | None,
    pixels: int,
    inlet: str | None = None,
) -> dict[str, Any]:
    """One channel in a window: measured, simulated, and what is left beside its noise.

    Of a frequency response their sizes over frequency, for one excitation.

    Parameters
    ----------
    session : Session
    record : int
        Those to fit first, then those to validate on.
    channel : str
        Such as ``y.A_zeta``.
    window : tuple of float or None
        From and to, in s or Hz; default where the residual of a record is largest, all of a frequency response.
    pixels : int
        Width of the chart; what lies within one is shown by its smallest and largest value.
    inlet : str, optional
        Excitation of a frequency response; default: that whose response is missed most. In time all play together.

    Raises
    ------
    InputError
        If there is no such record, channel or excitation, or the window is empty.
    """
    pixels = chart(pixels)
    if window is not None and not window[0] < window[1]:
        raise InputError(f"window {window[0]:g} .. {window[1]:g}: expected from below to")
    comparison, k = place_of(session, record)
    column, one = column_of(comparison, k, channel), comparison.records[k]
    row = one.channels[column]
    factor, unit = shown_in(row.unit)
    noise = np.full(1, factor * row.noise_rms)
    _, x_unit, x = one.record.abscissa
    if one.record.is_in_time:
        inlet, window = None, window or worst_stretch(comparison, k, channel)
        simulated, residual = np.asarray(one.simulated)[:, column], np.asarray(one.residual)[:, column]
        simulated = simulated - np.nanmean(simulated)
        drawn = np.column_stack([simulated + residual, simulated, residual])
    else:
        response, simulated = one.record.response[:, column], np.asarray(one.simulated)[:, column]
        left = response - simulated
        i = input_of(one.record.inputs, inlet, np.abs(left) / one.record.std[:, column])
        drawn = np.abs(np.column_stack([response[:, i], simulated[:, i], left[:, i]]))
        inlet, noise = one.record.inputs[i], one.record.std[:, column, i].copy()
        noise *= factor
    first, last = (0, len(x)) if window is None else np.searchsorted(x, window).tolist()
    first = max(0, min(first, len(x) - FEWEST_SAMPLES))
    last = max(last, first + FEWEST_SAMPLES)
    x, drawn = x[first:last], factor * drawn[first:last]
    kept = thinned(drawn, np.arange(len(x)) * pixels // len(x))
    measured, simulated, residual = drawn[kept].T.tolist()
    return plain(
        {
            "record": one.record.name,
            "channel": channel,
            "input": inlet,
            "unit": unit,
            "x": x[kept].tolist(),
            "x_unit": x_unit,
            "measured": measured,
            "simulated": simulated,
            "residual": residual,
            "noise": (noise if len(noise) == 1 else noise[first:last][kept]).tolist(),
            "samples": len(x),
            "fit_percent": row.fit_percent,
            "noise_ceiling_percent": row.noise_ceiling_percent,
        }
    )


def place_of(session: Session, record: int) -> tuple[Comparison, int]:
    """The comparison that a record stands in, and where; those to fit come first, then those to validate on.

    Raises
    ------
    InputError
        If there is no such record.
    """
    own, kept = session.comparison, session.kept_back
    count = len(own.records)
    total = count + (0 if kept is None else len(kept.records))
    if not 0 <= record < total:
        raise InputError(f"record = {record}: expected 0 to {total - 1}")
    return (own, record) if kept is None or record < count else (kept, record - count)


def column_of(comparison: Comparison, k: int, channel: str) -> int:
    """Where a channel stands in a record; `InputError` if it has none of this name."""
    names = [row.channel for row in comparison.records[k].channels]
    if channel not in names:
        name = comparison.records[k].record.name
        raise InputError(f"{name}: no channel {channel}; it has {', '.join(names)}")
    return names.index(channel)


def input_of(inputs: tuple[str, ...], inlet: str | None, left: FloatArray) -> int:
    """Where an excitation stands, without a name that whose response is missed most; `InputError` if it is not there.

    `left`, shape (F, inputs), is the size of what the model misses, over its noise.
    """
    if inlet is None:
        return int(np.argmax(np.nansum(left**2, axis=0)))
    if inlet not in inputs:
        raise InputError(f"no response to {inlet}; there are those to {', '.join(inputs)}")
    return inputs.index(inlet)


def chart(pixels: int) -> int:
    """The width of a chart; `InputError` if none is drawn so wide."""
    if not FEWEST_PIXELS <= pixels <= MOST_PIXELS:
        raise InputError(f"pixels = {pixels}: expected {FEWEST_PIXELS} to {MOST_PIXELS}")
    return pixels


def thinned(signals: FloatArray, pixel: NDArray[np.intp]) -> NDArray[np.intp]:
    """Which samples to draw: those where a signal is smallest or largest within a pixel, and both ends.

    Parameters
    ----------
    signals : ndarray, shape (N, k)
        Drawn over the same samples; NaN where there is nothing.
    pixel : ndarray of int, shape (N,)
        Which pixel each sample falls in, rising.

    Returns
    -------
    ndarray of int
        In order; of a pixel with many equal extremes the first.
    """
    first = np.flatnonzero(np.diff(pixel, prepend=pixel[0] - 1))
    own = np.repeat(np.arange(len(first)), np.diff(first, append=len(pixel)))
    kept = [np.array([0, len(pixel) - 1])]
    for signal in signals.T:
        for least in (signal, -signal):
            reached = np.fmin.reduceat(least, first)[own] == least
            at = np.flatnonzero(reached)
            kept.append(at[np.unique(own[at], return_index=True)[1]])
    return np.asarray(np.unique(np.concatenate(kept)), dtype=np.intp)


def _findings(session: Session) -> dict[str, Any]:
    """Of the fit, or of the records where none was made, worst first; and the same in words."""
    of_records = (finding for own in session.comparison.records for finding in own.findings)
    found = worst_first(of_records if session.estimate is None else session.estimate.findings)
    return {"findings": [own.as_dict() for own in found], "notes": [own.line() for own in found]}


def _cell(misfit: float) -> dict[str, Any]:
    """A cell of the map: its misfit, as it is written there, and how dark it is."""
    if np.isnan(misfit):  # no line there
        return {"misfit": misfit, "text": "", "level": 0}
    text = misfit_text(misfit) if misfit < 1e3 else f"{misfit / 1e3:.3g}k"
    return {"misfit": misfit, "text": text, "level": int(np.searchsorted(LEVELS, misfit))}


def _chance(own: Candidate) -> str:
    """The p-value in words; what is too small for a number says only that it is."""
    # logarithm of the smallest p-value that is written as a number
    return f"{own.p_value:.1g}" if own.chance > -690.0 else "< 1e-300"


def _left(predicted: float, misfit: float) -> float:
    """How far a predicted misfit stands between noise, 0, and the present one, 1, on a logarithmic scale."""
    return float(np.clip(np.log(max(predicted, 1.0)) / np.log(max(misfit, ADEQUATE)), 0.0, 1.0))


def _records(session: Session) -> list[dict[str, Any]]:
    """All records, those to fit first, with a row a channel."""
    found = []
    for role, comparison in (("training", session.comparison), ("validation", session.kept_back)):
        for own in () if comparison is None else comparison.records:
            rows = [
                {"channel": row.channel, "misfit": row.misfit, "fit_percent": row.fit_percent} for row in own.channels
            ]
            _, unit, over = own.record.abscissa
            found.append(
                {"name": own.record.name, "role": role, "misfit": own.misfit, "channels": rows}
                | {"span": float(over[-1]), "span_unit": unit}
            )
    return found


def _parameter(session: Session, own: Parameter) -> dict[str, Any]:
    """Value, interval, what the last step did to it, and the ends of its slider."""
    fitted, before = session.fitted, session.before
    at = session.chain[0].model if fitted is None else fitted.model
    middle = next((p for p in at.parameters if p.name == own.name), own)
    found = None if session.estimate is None else session.estimate.parameters.get(own.name)
    error = None if found is None else found.std_error
    was = None if before is None else next((p.value for p in before.model.parameters if p.name == own.name), None)
    return {
        "name": own.name,
        "value": own.value,
        "unit": "" if own.unit == "1" else own.unit,
        "low": max(own.lower, middle.value - middle.scale),
        "high": min(own.upper, middle.value + middle.scale),
        "ci95": None if found is None else found.ci95,
        "was": was,
        "moved_by_std_errors": None if was is None or not error else (own.value - was) / error,
    }


def _worst(found: Localisation) -> dict[str, Any] | None:
    cell = next((own for own in found.cells if own.kind not in ("synchronous", "drift")), None)
    return None if cell is None else {"record": cell.record, "channel": cell.channel, "band_hz": list(cell.band_hz)}
