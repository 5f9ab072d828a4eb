"""Gates that every frequency response passes: each refuses with what was found and what to do, or finds it.

Lines that say nothing are taken out, with a finding that says which.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray
from ambid.channels import FURTHER
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.record.checks import require_known_outputs
from ambid.rig import Rig

ZERO_FREQUENCY = Kind(
    "zero_frequency_not_used", "note", "the line at 0 Hz is not used: a mean is no response to the excitation"
)
ZERO_VALUES = Kind(
    "zero_values_not_used",
    "note",
    "values of exactly zero, not used: {count} ({pairs}[ and {more} more pairs], at {frequencies_hz:g} Hz)",
)
COHERENCE_MISSING = Kind(
    "coherence_missing",
    "note",
    "values whose coherence is zero or missing, not used: {count} ({pairs}[ and {more} more pairs], at "
    "{frequencies_hz:g} Hz)",
)
PAIRS_MISSING = Kind(
    "pairs_missing", "note", "pairs without a value at any frequency, not used: {count} ({pairs}[ and {more} more])"
)
FREQUENCIES_MISSING = Kind(
    "frequencies_missing",
    "note",
    "frequencies at which every value is missing or NaN, not used: {count} ({frequencies_hz:g}[ and {more} more] Hz)",
)
VALUES_MISSING = Kind(
    "values_missing",
    "note",
    "single values that are missing or NaN, left out: {count} "
    "({pairs}[ and {more} more pairs], at {frequencies_hz:g} Hz)",
)
MOST_LISTED = 3
"""Pairs, and frequencies of each, that a finding names one by one."""
LARGEST_TRAVEL = 1e3
"""Air gaps that the bias current of a bearing may move y by, by the response; a weakly damped mode moves some ten."""
FEWEST = 3
"""Frequencies of a response: each is compared with both of its neighbours, which shows how much errors go together."""


@dataclass(frozen=True)
class Lines:
    """Frequencies [Hz], shape (F,), and tables of shape (F, outputs, inputs), of the covariance (F, pairs, pairs)."""

    frequency_hz: FloatArray
    response: ComplexArray
    std: FloatArray
    coherence: FloatArray
    covariance: ComplexArray | None = None


def informative(lines: Lines, pairs: Sequence[str]) -> tuple[Lines, list[Finding]]:
    """Lines without the one at 0 Hz, with NaN for single values that are zero or have no coherence; and findings.

    A pair that is zero everywhere, or has no coherence anywhere, stays as it is.
    """
    findings = []
    at_zero = lines.frequency_hz == 0.0
    if at_zero.any():
        findings.append(ZERO_FREQUENCY(frequencies_hz=[0.0]))
        kept = ~at_zero
        covariance = None if lines.covariance is None else lines.covariance[kept]
        lines = Lines(
            lines.frequency_hz[kept], lines.response[kept], lines.std[kept], lines.coherence[kept], covariance
        )
    response = lines.response.copy()
    zero = (response == 0.0) & (np.nan_to_num(response) != 0.0).any(axis=0)
    counts = np.isnan(lines.std).all(axis=0) & (lines.coherence > 0.0).any(axis=0) & (lines.covariance is None)
    silent = (np.isnan(lines.coherence) | (lines.coherence == 0.0)) & counts
    silent &= np.isfinite(response) & ~zero
    for kind, wrong in ((ZERO_VALUES, zero), (COHERENCE_MISSING, silent)):
        if wrong.any():
            count, named = _named(wrong.reshape(len(wrong), -1), lines.frequency_hz, pairs)
            findings.append(kind(count=int(wrong.sum()), **named, more=_counted(count)["more"]))
            response[wrong] = np.nan
    return replace(lines, response=response), findings


def require_names(where: str, outputs: Sequence[str], inputs: Sequence[str], rig: Rig | None) -> None:
    """Refuse channels that are named twice, are no ``<signal>.<axis>``, or are of an axis that the rig lacks."""
    for kind, names, signals in (("output", outputs, ("y", "i_c", *FURTHER)), ("input", inputs, ("i_e", "r"))):
        if not names:
            raise RecordError(f"{where}: no {kind}; name at least one, such as {signals[0]}.A_zeta")
        for name in names:
            signal, _, axis = name.partition(".")
            if names.count(name) > 1:
                raise RecordError(f"{where}: {kind} {name} is there {names.count(name)} times; keep one")
            if signal not in signals or not axis:
                raise RecordError(
                    f"{where}: {kind} {name!r} is no channel; expected {', '.join(signals)} with an axis, such as "
                    f"{signals[0]}.A_zeta; rename it, or map it"
                )
            if rig is not None and kind == "output" and axis not in rig.axes:
                require_known_outputs(where, [name], rig)
            elif rig is not None and axis not in rig.axes:
                raise RecordError(
                    f"{where}: {kind} {name}: the rig has the axes {', '.join(rig.axes)}; rename or map it"
                )


def require_frequencies(where: str, frequency_hz: FloatArray, rig: Rig | None) -> None:
    """Refuse frequencies that do not rise, or are not between 0 and half the sample rate of the rig."""
    if len(frequency_hz) < FEWEST:
        raise RecordError(f"{where}: {len(frequency_hz)} frequencies, at least {FEWEST} are needed; measure more")
    most = np.inf if rig is None else 0.5 * rig.sample_rate
    wrong = np.flatnonzero(~(np.isfinite(frequency_hz) & (frequency_hz > 0.0) & (frequency_hz < most)))
    if len(wrong):
        upper = "" if rig is None else f" and below half the sample rate of the rig, {most:g} Hz"
        raise RecordError(
            f"{where}: frequency_hz is {frequency_hz[wrong[0]]:g} at place {wrong[0] + 1}; give Hz, above 0{upper}"
        )
    falls = np.flatnonzero(np.diff(frequency_hz) <= 0.0)
    if len(falls):
        k = falls[0]
        raise RecordError(
            f"{where}: frequency_hz goes from {frequency_hz[k]:g} to {frequency_hz[k + 1]:g} at place {k + 2}; "
            "sort it, each once"
        )


def require_values(where: str, frequency_hz: FloatArray, response: ComplexArray, pairs: Sequence[str]) -> None:
    """Refuse infinite values, and a response that was measured nearly nowhere, is zero throughout, or has no phase."""
    flat = response.reshape(len(response), -1)
    wrong = np.argwhere(np.isinf(flat))
    if len(wrong):
        k, pair = wrong[0]
        raise RecordError(
            f"{where}: {pairs[pair]} is {flat[k, pair]} at {frequency_hz[k]:g} Hz; leave the row out, or measure again"
        )
    if not np.isfinite(flat).any():
        raise RecordError(f"{where}: every value is NaN; measure at least one pair")
    count = int(np.isfinite(flat).any(axis=1).sum())
    if count < FEWEST:
        raise RecordError(
            f"{where}: {count} frequencies with a value, of {len(flat)}; at least {FEWEST} are needed; measure more"
        )
    for pair, values in zip(pairs, flat.T, strict=True):
        known = values[np.isfinite(values)]
        if len(known) and not known.any():
            raise RecordError(f"{where}: {pair} is zero at every frequency: a dead channel; measure again")
    if not flat.imag[np.isfinite(flat)].any():
        raise RecordError(
            f"{where}: every value is real, as of magnitudes without their phase; the response of a machine has one: "
            "give complex values, re and im"
        )


def findings_of_missing(frequency_hz: FloatArray, known: NDArray[np.bool_], pairs: Sequence[str]) -> list[Finding]:
    """What was not measured: pairs at no frequency, frequencies of no pair, and single values.

    Parameters
    ----------
    frequency_hz : ndarray, shape (F,)
    known : ndarray of bool, shape (F, outputs, inputs)
        Which values are there.
    pairs : sequence of str
        Their names.
    """
    flat = known.reshape(len(known), -1)
    has_pair, has_frequency = flat.any(axis=0), flat.any(axis=1)
    findings = []
    if not has_pair.all():
        left_out = [pairs[k] for k in np.flatnonzero(~has_pair).tolist()]
        findings.append(PAIRS_MISSING(pairs=left_out[:MOST_LISTED], **_counted(len(left_out))))
    if not has_frequency.all():
        own = frequency_hz[~has_frequency].tolist()
        findings.append(FREQUENCIES_MISSING(frequencies_hz=own[:MOST_LISTED], **_counted(len(own))))
    single: NDArray[np.bool_] = np.asarray(~flat)
    single[:, ~has_pair] = single[~has_frequency] = False
    if single.any():
        count, named = _named(single, frequency_hz, pairs)
        findings.append(VALUES_MISSING(**(_counted(count) | {"count": int(single.sum())}), **named))
    return findings


def _counted(count: int) -> dict[str, Any]:
    """How many there are, and how many more than are named."""
    return {"count": count, "more": count - MOST_LISTED if count > MOST_LISTED else None}


def _named(wrong: NDArray[np.bool_], frequency_hz: FloatArray, pairs: Sequence[str]) -> tuple[int, dict[str, Any]]:
    """How many pairs have wrong values, shape (F, pairs), and the first of them by name, with frequencies of each."""
    columns = np.flatnonzero(wrong.any(axis=0)).tolist()
    at = [frequency_hz[wrong[:, k]].tolist()[:MOST_LISTED] for k in columns[:MOST_LISTED]]
    return len(columns), {"pairs": [pairs[k] for k in columns[:MOST_LISTED]], "frequencies_hz": at}


def require_covariance(
    where: str, frequency_hz: FloatArray, response: ComplexArray, covariance: ComplexArray | None, pairs: Sequence[str]
) -> FloatArray:
    """Refuse a covariance that is none, of the pairs that were measured; returns the std, shape of the response."""
    values, known = np.asarray(covariance), np.isfinite(response.reshape(len(response), -1))
    std = np.full(known.shape, np.nan)
    for rows, kept in known_alike(known):
        inner = values[np.ix_(rows, kept, kept)]
        wrong = np.flatnonzero(~_is_covariance(inner))
        if len(wrong):
            raise RecordError(
                f"{where}: covariance at {frequency_hz[rows[wrong[0]]]:g} Hz is none of the errors of {len(pairs)} "
                "pairs: expected Hermitian and positive; leave it out, or give std"
            )
        std[np.ix_(rows, kept)] = np.sqrt(np.diagonal(inner, axis1=1, axis2=2).real)
    return std.reshape(response.shape)


def known_alike(known: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Frequencies at which the same pairs were measured, 1024 at a time for the memory, and which pairs these are."""
    for kept in known[:1] if (known == known[0]).all() else np.unique(known, axis=0):
        rows = np.flatnonzero((known == kept).all(axis=1))
        for some in np.array_split(rows, -(-len(rows) // 1024)):
            yield some, np.flatnonzero(kept)


def _is_covariance(values: ComplexArray) -> NDArray[np.bool_]:
    """Which matrices are finite, Hermitian and positive, by their correlations.

    One of these may be nothing by chance, and y and i_c have units far apart.
    """
    power = np.diagonal(values, axis1=1, axis2=2).real
    found: NDArray[np.bool_] = np.asarray(np.isfinite(values).all(axis=(1, 2)) & (power > 0.0).all(axis=1))
    root = np.sqrt(power[found])
    correlation = values[found] / (root[:, :, None] * root[:, None, :])
    # part of the root of two variances by which the two halves of a covariance may differ: files round
    is_even = (np.abs(correlation - correlation.conj().swapaxes(1, 2)) <= 1e-6).all(axis=(1, 2))
    try:
        np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        is_even &= (np.linalg.eigvalsh(correlation) > 0.0).all(axis=1)
    found[found] = is_even
    return found


def require_spread(where: str, spread: float | None, has_covariance: bool) -> None:
    """Refuse a spread that is none, or of no covariance."""
    if spread is None:
        return
    if not has_covariance:
        raise RecordError(f"{where}: spread = {spread:g} without a covariance that it is of; give both or none")
    if not 1.0 <= spread < np.inf:
        raise RecordError(f"{where}: spread = {spread:g}; expected 1 or more, as of a covariance that is known")


def require_si_units(
    where: str,
    frequency_hz: FloatArray,
    response: ComplexArray,
    outputs: Sequence[str],
    inputs: Sequence[str],
    rig: Rig,
) -> None:
    """Refuse responses of y that are far beyond what a machine can do, as those in micrometres are."""
    limits = {a: LARGEST_TRAVEL * b.air_gap / b.bias_current for b in rig.bearings for a in b.axis_names}
    for o, output in enumerate(outputs):
        for i, inlet in enumerate(inputs):
            if not (output.startswith("y.") and inlet.startswith("i_e.")):
                continue
            size = np.nan_to_num(np.abs(response[:, o, i]))
            k, most = int(np.argmax(size)), limits[output.removeprefix("y.")]
            if size[k] > most:
                raise RecordError(
                    f"{where}: {output} / {inlet} is {size[k]:.4g} m/A at {frequency_hz[k]:g} Hz, allowed is "
                    f"{most:.3g}: it looks like um/A or mm/A; give m/A"
                )
