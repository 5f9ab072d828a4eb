"""What the page shows over frequency, as plain data: lines, responses, the misfit matrix, and what would be left."""

from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray
from ambid.diagnosis import MisfitMatrix, misfit_matrix, predict
from ambid.errors import InputError, ModelError, RecordError
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.responses import Responses, frequency_responses
from ambid.plot.misfit import SIGNS
from ambid.plot.responses import HIDDEN, SIGMAS, unbroken, unit_of
from ambid.plot.style import short_number, shown_in
from ambid.results import plain
from ambid.workbench.session import KEPT, Session
from ambid.workbench.views import LEVELS, chart, column_of, input_of, place_of, thinned

WORDS = {1: ", real part positive", -1: ", real part negative", 0: ""}
_one_at_a_time = Lock()


def lines(session: Session, record: int, channel: str, pixels: int) -> dict[str, Any]:
    """Misfit of one channel, line by line of the spectrum, on a logarithmic scale of so many pixels.

    Raises
    ------
    InputError
        If there is no such record or channel.
    """
    comparison, k = place_of(session, record)
    part, white = comparison.noise.parts[k], comparison.noise.by_record(comparison.residual)[k]
    frequency_hz, misfit = part.by_channel(white)
    column = column_of(comparison, k, channel)
    known = misfit[:, column] > 0.0
    f, left = frequency_hz[known], misfit[known, column]
    kept = _on_a_log_scale(f, left[:, None], pixels)
    return plain({"record": part.record.name, "frequency_hz": f[kept].tolist(), "misfit": left[kept].tolist()})


def responses(session: Session, record: int, channel: str, inlet: str | None, pixels: int) -> dict[str, Any]:
    """Response of one channel to one excitation: measured with its noise, of the model, and of that before the step.

    Parameters
    ----------
    session : Session
    record : int
        Those to fit first, then those to validate on.
    channel : str
        Such as ``y.A_zeta``.
    inlet : str or None
        Such as ``i_e.A_zeta``; default: that whose response is missed most, by the model before the step where there
        is one.
    pixels : int
        Width of the chart, on a logarithmic scale.

    Returns
    -------
    dict
        `why_not` says why there is nothing to draw; it is empty otherwise.

    Raises
    ------
    InputError
        If there is no such record or channel.
    """
    comparison, k = place_of(session, record)
    column_of(comparison, k, channel)
    found = {"record": comparison.records[k].record.name, "output": channel, "why_not": ""}
    before = () if session.before is None else (session.before.model,)
    try:
        with _one_at_a_time:  # a long record takes its time once, however often it is asked for
            compared = _responses(comparison, k, before)
        o = compared.measured.outputs.index(channel)
        i = input_of(compared.measured.inputs, inlet, np.sqrt(compared.left(-1)[:, o]))
    except (RecordError, InputError) as error:
        return found | {"why_not": str(error)}
    if not compared.measured.measured[:, o, i].any():
        return found | {"why_not": f"{channel} by {compared.measured.inputs[i]} was not measured"}
    return plain(found | _drawn(compared, o, i, _names(session), chart(pixels)))


def matrices(session: Session) -> list[dict[str, Any]]:
    """The misfit of every record that something drives, input by output and band by band."""
    found, first = [], 0
    for comparison in (session.comparison, session.kept_back):
        if comparison is None:
            continue
        left = list(_matrices(comparison))
        for k, own in enumerate(comparison.records):
            if left and left[0].record == own.record.name:  # one that nothing drives has none
                found.append({"index": first + k} | _matrix(left.pop(0)))
        first += len(comparison.records)
    return found


def prediction(session: Session, record: int, channel: str, effect: str) -> dict[str, Any]:
    """The misfit of one channel over frequency as it is, and as it would be with a candidate; nothing is fitted.

    Raises
    ------
    ModelError
        If the candidates were not ranked.
    InputError
        If there is no such candidate or channel, or the record is not among those that are fitted.
    """
    if session.ranking is None:
        raise ModelError("there is no ranking of this model yet; rank first")
    comparison, k = place_of(session, record)
    if comparison is not session.comparison:
        raise InputError(f"record = {record}: it is kept back; candidates are judged by the records that are fitted")
    column, found = column_of(comparison, k, channel), predict(session.ranking, effect)
    now, then = found.curves[k]
    known = np.isfinite(now.misfit[:, column])
    middle = np.sqrt(now.edges_hz[:-1] * now.edges_hz[1:])[known]
    return plain(
        {
            "effect": effect,
            "record": now.record,
            "channel": channel,
            "frequency_hz": middle.tolist(),
            "now": now.misfit[known, column].tolist(),
            "then": then.misfit[known, column].tolist(),
            "lines": found.lines(4),  # cells of the map that a prediction names: those that would fall most
        }
    )


@lru_cache(maxsize=KEPT)
def _responses(comparison: Comparison, k: int, before: tuple[Model, ...]) -> Responses:
    return frequency_responses(comparison, k, before)


@lru_cache(maxsize=KEPT)
def _matrices(comparison: Comparison) -> tuple[MisfitMatrix, ...]:
    return misfit_matrix(comparison)


def _names(session: Session) -> list[str]:
    """Of the model and of that before the step."""
    return [f"now ({session.did})", *(() if session.before is None else [f"before ({session.before.did})"])]


def _drawn(compared: Responses, o: int, i: int, names: list[str], pixels: int) -> dict[str, Any]:
    measured = compared.measured
    known = measured.measured[:, o, i]
    f, std, response = measured.frequency_hz[known], measured.std[known, o, i], measured.response[known, o, i]
    size = np.abs(response)
    left = [np.abs(response - own.at_measured[known, o, i]) for own in compared.modelled]
    kept = _on_a_log_scale(f, np.column_stack([size, std, *left]), pixels)
    f, std, response, size = f[kept], std[kept], response[kept], size[kept]
    factor, unit = _shown_in(measured.outputs[o], measured.inputs[i])
    return {
        "input": measured.inputs[i],
        "inputs": list(measured.inputs),
        "unit": unit,
        "frequency_hz": f.tolist(),
        "size": (factor * size).tolist(),
        # of the measured size: a band of the noise down to nothing has no place on a logarithmic scale
        "low": (factor * np.maximum(size - SIGMAS * std, 0.1 * size)).tolist(),
        "high": (factor * (size + SIGMAS * std)).tolist(),
        "phase": np.where(size > SIGMAS * std, np.degrees(np.angle(response)), np.nan).tolist(),
        "noise": (factor * std).tolist(),
        "sigmas": SIGMAS,
        "models": [
            {"name": name, "left": (factor * apart[kept]).tolist()}
            | _modelled(own.frequency_hz, own.response[:, o, i], HIDDEN * size.min(), factor, pixels)
            for name, own, apart in zip(names, compared.modelled, left, strict=True)
        ],
    }


def _modelled(f: FloatArray, response: ComplexArray, least: float, factor: float, pixels: int) -> dict[str, Any]:
    """Magnitude and phase of a model; nothing below the magnitude that any record could show."""
    size = np.where(np.abs(response) > least, np.abs(response), np.nan)
    phase = np.where(np.isfinite(size), np.degrees(np.angle(response)), np.nan)
    kept = _on_a_log_scale(f, np.column_stack([size, phase]), pixels)
    return {
        "frequency_hz": f[kept].tolist(),
        "size": (factor * size[kept]).tolist(),
        "phase": unbroken(phase[kept]).tolist(),
    }


def _shown_in(output: str, inlet: str) -> tuple[float, str]:
    """Factor and unit of a response: displacements by currents in µm/A, as displacements are drawn in µm."""
    of, _, by = unit_of(output, inlet).rpartition("/")
    factor, name = shown_in(of) if (of, by) == ("m", "A") else (1.0, of)
    return factor, f"{name}/{by}"


def _matrix(own: MisfitMatrix) -> dict[str, Any]:
    """A table for each band: rows are outputs, columns excitations, and last what follows none of them."""
    bands = []
    for b, (low, high) in enumerate(zip(own.edges_hz[:-1].tolist(), own.edges_hz[1:].tolist(), strict=True)):
        rows = [[_answer(own, b, o, i) for i in range(len(own.inputs))] for o in range(len(own.outputs))]
        rest = [_rest(float(value)) for value in own.rest[b]]
        bands.append({"low": low, "high": high, "rows": rows, "rest": rest})
    return {
        "record": own.record,
        "outputs": list(own.outputs),
        "inputs": list(own.inputs),
        "bands": bands,
        "lines": own.lines(),
    }


def _answer(own: MisfitMatrix, b: int, o: int, i: int) -> dict[str, Any]:
    """A cell: its text with the sign of the real part, how dark it is, and the same in words."""
    power, sign = float(own.power[b, o, i]), int(own.sign[b, o, i])
    if np.isnan(power):
        return {"text": "?", "level": 0, "words": "not distinguished from the other excitations"}
    if not own.is_told[b, o, i]:
        return {"text": "", "level": 0, "words": "may be chance"}
    words = f"{_short(power)} times noise{WORDS[sign]}"
    return {"text": SIGNS[sign] + _short(power), "level": max(1, _level(power)), "words": words}


def _rest(power: float) -> dict[str, Any]:
    level = 0 if np.isnan(power) else _level(power)
    words = f"{_short(power)} times noise" if level else "not known" if np.isnan(power) else "noise alone"
    return {"text": _short(power) if level else "", "level": level, "words": words}


def _level(power: float) -> int:
    return int(np.searchsorted(LEVELS, power))


def _short(power: float) -> str:
    return f"{power / 1e3:.2g}k" if power >= 995.0 else short_number(power)


def _on_a_log_scale(f: FloatArray, signals: FloatArray, pixels: int) -> NDArray[np.intp]:
    """Which frequencies to draw on a logarithmic scale of so many pixels."""
    along = np.log(f / f[0]) / np.log(max(f[-1] / f[0], 1.0 + 1e-9))
    return thinned(signals, np.asarray(along * chart(pixels), dtype=np.intp))
