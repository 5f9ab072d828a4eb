"""The std of a frequency response whose file states none: from coherence, or from its scatter about a smooth curve."""

from collections.abc import Sequence

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind

WIDTH, DEGREE = 9, 2
"""Neighbouring frequencies, and degree of the polynomial through them, that the scatter of a response is taken from."""
DIGITS = (4, 6)
"""Decimal digits of a coherence that are believed: files hold at least four, and errors of its own are in the sixth."""
SMOOTH = "from its scatter about a smooth curve over neighbouring frequencies, which is too large at sharp modes"
STD_FROM_COHERENCE = Kind(
    "std_from_coherence", "note", "std of {first}[ and {more} more pairs] from the coherence and {averages:g} averages"
)
AVERAGES_ESTIMATED = Kind(
    "averages_estimated",
    "note",
    "std of {first}[ and {more} more pairs] from the coherence; the number of averages was not given, and is estimated "
    f"{SMOOTH}",
    "give the number of averages",
)
COHERENCE_ONE = Kind(
    "coherence_one",
    "note",
    "the coherence of {pairs} is 1 at every frequency, as of a single average, and says nothing of the noise; not used",
    "average several segments, or give the std",
)
STD_FROM_SCATTER = Kind(
    "std_from_scatter", "note", "std of {first}[ and {more} more pairs] " + SMOOTH, "give std or coherence"
)


def std_of(
    where: str,
    frequency_hz: FloatArray,
    response: ComplexArray,
    std: FloatArray,
    coherence: FloatArray,
    averages: float | None,
    pairs: Sequence[str],
) -> tuple[FloatArray, list[Finding]]:
    """The std of every pair, shape of the response, and findings on those that were not given.

    Of n averages with coherence g the variance is ``|H|^2 (1 - g) / (g n)`` (Bendat and Piersol, Random Data, 4th ed.,
    chapter 9, g being the squared one). It is an estimate itself, of n - 1 degrees of freedom, and raised by
    n / (n - 2), so that the mean square of what is whitened by it is 1. Where n is not given, the coherence gives the
    weights of the frequencies relative to each other. A coherence of 1 at every frequency is that of a single average.

    Raises
    ------
    RecordError
        If a std is not positive, is given for a part of a pair, or cannot be estimated from so few frequencies.
    """
    shape = response.shape
    h, given, shared = (table.reshape(len(response), -1) for table in (response, std, coherence))
    found = np.full(h.shape, np.nan)
    from_coherence, from_scatter, always_one = [], [], []
    if averages is not None and not averages >= 1.0:
        raise RecordError(f"{where}: averages = {averages}; give 1 or more, or leave it out")
    for k, pair in enumerate(pairs):
        own = np.isfinite(h[:, k])
        if not own.any():
            continue
        f, values = frequency_hz[own], h[own, k]
        if _is_whole(where, "std", pair, f, given[own, k]):
            _require(where, "std", pair, f, given[own, k], np.inf)
            found[own, k] = given[own, k]
        elif _is_whole(where, "coherence", pair, f, shared[own, k]):
            _require(where, "coherence", pair, f, shared[own, k], 1.0)
            most = _most_coherent(shared[own, k])
            if (shared[own, k] > most).all():
                always_one.append(pair)
                found[own, k] = scatter(where, pair, f, values)
                from_scatter.append(pair)
                continue
            g = np.minimum(shared[own, k], most)
            of_one = np.abs(values) * np.sqrt((1.0 - g) / g)
            if averages is None:
                seen = scatter(where, pair, f, values)
                averages_seen = np.median(of_one**2) / np.median(seen**2)
            found[own, k] = of_one / np.sqrt(max((averages or averages_seen) - 2.0, 1.0))
            from_coherence.append(pair)
        else:
            found[own, k] = scatter(where, pair, f, values)
            from_scatter.append(pair)
        if not (found[own, k] > 0.0).all():
            raise RecordError(f"{where}: {pair} has no noise at {f[np.argmin(found[own, k])]:g} Hz; give its std")
    of_coherence = AVERAGES_ESTIMATED if averages is None else STD_FROM_COHERENCE
    findings = [COHERENCE_ONE(pairs=always_one)] if always_one else []
    findings += [
        kind(first=own[0], more=len(own) - 1 or None, pairs=own, averages=averages)
        for kind, own in ((of_coherence, from_coherence), (STD_FROM_SCATTER, from_scatter))
        if own
    ]
    return found.reshape(shape), findings


def _most_coherent(coherence: FloatArray) -> float:
    """Largest coherence that is believed: half of the last digit that the values have below 1."""
    digits = next((d for d in range(*DIGITS) if np.allclose(coherence, coherence.round(d), rtol=0.0, atol=1e-9)), 6)
    return 1.0 - 0.5 * 10.0**-digits


def scatter(where: str, pair: str, frequency_hz: FloatArray, values: ComplexArray) -> FloatArray:
    """Std of one pair from its distance to a smooth curve through its neighbours, shape (F,).

    It is raised by nu / (nu - 1) for the nu degrees of freedom that it is from, so that the mean square of what is
    whitened by it is 1.
    """
    count = len(values)
    if count < WIDTH:
        raise RecordError(
            f"{where}: {pair} has {count} frequencies and neither std nor coherence; its noise can be estimated from "
            f"{WIDTH} on: give std, or measure more"
        )
    free = WIDTH - DEGREE - 1
    power = np.empty(count - WIDTH + 1)
    for first in range(len(power)):
        x, own = frequency_hz[first : first + WIDTH], values[first : first + WIDTH]
        table = np.vander((x - x.mean()) / np.ptp(x), DEGREE + 1)
        left = own - table @ np.linalg.lstsq(table, own, rcond=None)[0]
        power[first] = np.sum(np.abs(left) ** 2) / free
    nearest = np.clip(np.arange(count) - WIDTH // 2, 0, len(power) - 1)
    return np.asarray(np.sqrt(power[nearest] * free / (free - 1.0)))


def _is_whole(where: str, key: str, pair: str, frequency_hz: FloatArray, values: FloatArray) -> bool:
    """Whether a pair has a value at all of its frequencies; refuses one that has some."""
    missing = np.isnan(values)
    if missing.any() and not missing.all():
        raise RecordError(
            f"{where}: {key} of {pair} is missing at {frequency_hz[np.argmax(missing)]:g} Hz and there at others; "
            "give it for the whole pair, or leave it out"
        )
    return not missing.any()


def _require(where: str, key: str, pair: str, frequency_hz: FloatArray, values: FloatArray, most: float) -> None:
    # analysers compute in single precision
    wrong = np.flatnonzero(~(np.isfinite(values) & (values > 0.0) & (values <= most * (1.0 + 1e-6))))
    if len(wrong):
        upper = "" if most == np.inf else f", up to {most:g}"
        raise RecordError(
            f"{where}: {key} of {pair} is {values[wrong[0]]:g} at {frequency_hz[wrong[0]]:g} Hz; expected a finite "
            f"number above 0{upper}"
        )
