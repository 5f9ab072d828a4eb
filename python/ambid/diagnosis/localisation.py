"""Where the model fails: frequency by channel by record, in which manner, at which port, and how it grows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ambid.arrays import ByValue, FloatArray
from ambid.diagnosis.drift import Change, changes_of, largest_change
from ambid.diagnosis.ports import Port, needed_at_ports
from ambid.findings import NOWHERE, Finding, Kind, Where, WithFindings
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.chance import RARE, SPREAD, misfit_bound
from ambid.noise.lines import RecordLines
from ambid.noise.response_lines import ResponseLines
from ambid.noise.shapes import TERMS
from ambid.noise.wave import OUTSTANDING
from ambid.record import Record
from ambid.results import Tabular, band_text
from ambid.threads import with_one_blas_thread

BEYOND_CHANCE = 3.0
"""Standard deviations by which a port must explain more than another to be distinguished from it."""
SHAPED = 0.3
"""Part of the excess misfit that an odd or even shape must explain to give the misfit its kind."""
PORT = Kind("missing_port", "note", "what is missing acts most likely as a {port} ({meaning})")
PORTS = Kind(
    "missing_port_unknown",
    "note",
    "what is missing acts as one of {ports}: these data do not determine at which of them",
)
SHAPE = Kind(
    "missing_shape",
    "note",
    "what is missing is {kind} and looks like [{coefficient:.3g}][±{magnitude:.3g}][ {unit}] times {shape}, which "
    "explains {share:.0f|%} of the excess misfit",
)
GROWTH = Kind("missing_growth", "note", "what is missing grows with the amplitude to the power {exponent:.1f}")
CHANGES = Kind(
    "parameter_changes",
    "note",
    "{parameter} changes during the record[ by {change:.2g|%} at {frequency_hz:.3g} Hz][ by {drift:.2g|%} from its "
    "begin to its end]",
)
LINE = Kind(
    "unexplained_line",
    "note",
    "a line at {frequency_hz:.2f} Hz belongs neither to the excitation nor to the model",
)


@dataclass(frozen=True)
class Cell:
    """Misfit of one channel in one band of one record, in units of its noise.

    Attributes
    ----------
    record, channel : str
    band_hz : tuple of float
    misfit : float
        Mean square of the whitened lines; 1 is noise alone.
    kind : str
        linear, odd, even, synchronous or drift; empty where the manner was not asked for.
    """

    record: str
    channel: str
    band_hz: tuple[float, float]
    misfit: float
    kind: str


@dataclass(frozen=True, repr=False, eq=False)
class MisfitMap(ByValue, Tabular):
    """Misfit by band and channel of one record, each channel judged against its own noise.

    Attributes
    ----------
    record : str
    channels : tuple of str
    edges_hz : ndarray, shape (bands + 1,)
    line_hz : float
        From one excited line to the next; of a frequency response the least step.
    misfit : ndarray, shape (bands, channels)
        Mean square of the whitened lines; 1 is noise alone.
    """

    record: str
    channels: tuple[str, ...]
    edges_hz: FloatArray
    line_hz: float
    misfit: FloatArray

    @property
    def by_chance(self) -> FloatArray:
        """Misfit of each band that chance may bring to some cell, by its number of lines, shape (bands,)."""
        lines = np.maximum(np.diff(self.edges_hz) / self.line_hz, 1.0)
        return np.array([misfit_bound(2.0 * count, RARE / self.misfit.size) for count in lines])

    def table(self) -> dict[str, list[Any]]:
        """A row each band, a column each channel."""
        edges = self.edges_hz.tolist()
        return {"low_hz": edges[:-1], "high_hz": edges[1:]} | dict(
            zip(self.channels, self.misfit.T.tolist(), strict=True)
        )

    def summary(self) -> list[str]:
        """The largest misfit, and where it is."""
        b, c = np.unravel_index(int(np.nanargmax(self.misfit)), self.misfit.shape)
        band = band_text(*self.edges_hz[b : b + 2].tolist())
        return [f"{self.record}: largest misfit {self.misfit[b, c]:.3g} times noise, {self.channels[c]}, {band} Hz"]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "record": self.record,
            "channels": list(self.channels),
            "edges_hz": self.edges_hz.tolist(),
            "misfit": self.misfit.tolist(),
        }


@dataclass(frozen=True)
class Growth:
    """What one record adds to how the misfit grows with amplitude.

    Attributes
    ----------
    record : str
    amplitude : float
        Rms of i_e [A], or of the reference r [m] where that drives alone.
    unexplained : float
        Rms of what repeats in the residual of y and is no noise [m].
    """

    record: str
    amplitude: float
    unexplained: float


@dataclass(frozen=True, repr=False, eq=False)
class Localisation(ByValue, WithFindings, Tabular):
    """Where the model fails; result of `localise`.

    Attributes
    ----------
    maps : tuple of MisfitMap
        One per record.
    ports : tuple of Port
        The port type that explains most first, of the record whose misfit is largest.
    tones : tuple of Tone
        Lines that belong neither to the excitation nor to the model.
    changes : tuple of Change
        What stands out most as a change of a parameter during each record.
    growth : tuple of Growth
        One per record of that operating point.
    exponent : float
        The unexplained response grows with this power of the amplitude: 1 is linear, 3 cubic; NaN for one amplitude.
    cells : tuple of Cell
        The map as a list, largest misfit first, with tones and changes.
    worst : int
        Index of the record whose misfit is largest.
    """

    maps: tuple[MisfitMap, ...]
    ports: tuple[Port, ...]
    tones: tuple[Tone, ...]
    changes: tuple[Change, ...]
    growth: tuple[Growth, ...]
    exponent: float
    cells: tuple[Cell, ...]
    worst: int = 0

    @property
    def change(self) -> Change | None:
        """Parameter that changes during a record, beyond chance."""
        return largest_change(self.changes)

    @property
    def kind(self) -> str:
        """linear, odd or even: the manner of what is missing on the excited lines."""
        terms = [term for port in (self.likely or self.ports)[:1] for term in port.terms]
        return terms[0].kind if terms and terms[0].share > SHAPED else "linear"

    @property
    def likely(self) -> tuple[Port, ...]:
        """The port types that what is missing may act at: several where chance can make the difference between them.

        A simple shape that explains more at one of them than any does at the others distinguishes it.
        """
        known = [port for port in self.ports if np.isfinite(port.misfit)]
        if not known:
            return ()
        least = min(max(port.misfit, 1.0) for port in known)
        limit = least * (1.0 + BEYOND_CHANCE * SPREAD * np.sqrt(4.0 / known[0].free))
        close = [port for port in known if port.misfit <= limit]
        shaped = sorted((port for port in close if port.terms), key=lambda port: -port.terms[0].score)
        if shaped and shaped[0].terms[0].share > SHAPED:
            first, *others = (port.terms[0].score for port in shaped)
            # the residuals of two shapes are no further apart than both are from nothing
            chance = max((BEYOND_CHANCE * 2.0 * (first**0.5 + other**0.5) for other in others), default=0.0)
            if all(first - other > chance for other in others):
                return (shaped[0],)
        return tuple(close)

    def table(self) -> dict[str, list[Any]]:
        """Cells, a row each, largest misfit first."""
        return {
            "record": [own.record for own in self.cells],
            "channel": [own.channel for own in self.cells],
            "low_hz": [own.band_hz[0] for own in self.cells],
            "high_hz": [own.band_hz[1] for own in self.cells],
            "misfit": [own.misfit for own in self.cells],
            "kind": [own.kind for own in self.cells],
        }

    def summary(self) -> list[str]:
        """The largest misfit of every record, and the findings."""
        return [*(line for own in self.maps for line in own.summary()), *self.finding_lines()]

    def sentence(self) -> str:
        """The findings in one sentence."""
        return "; ".join(finding.line() for finding in self.findings)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Port, shape and kind of what is missing, and what has a frequency of its own."""
        return (*self._of_port(), *self._of_time())

    def _of_port(self) -> Iterator[Finding]:
        likely = self.likely
        if len(likely) > 1:
            yield PORTS(NOWHERE, ports=[own.name for own in likely])
        if len(likely) != 1:
            return
        (port,) = likely
        yield PORT(NOWHERE, port=port.name, meaning=port.meaning)
        if not (port.terms and port.terms[0].share > SHAPED):
            return
        term, shape = port.terms[0], TERMS[port.name][port.terms[0].shape]
        own: dict[str, Any] = {"kind": term.kind, "shape": term.shape, "unit": shape.unit or None, "share": term.share}
        mean, size = float(np.mean(term.coefficients)), float(np.mean(np.abs(term.coefficients)))
        yield SHAPE(
            NOWHERE, coefficient=None if shape.is_across else mean, magnitude=size if shape.is_across else None, **own
        )

    def _of_time(self) -> Iterator[Finding]:
        if np.isfinite(self.exponent):
            yield GROWTH(NOWHERE, exponent=self.exponent)
        if (change := self.change) is not None:
            yield CHANGES(Where(record=change.record), **change.values)
        for tone in self.tones:
            if tone.power > OUTSTANDING:
                yield LINE(NOWHERE, frequency_hz=tone.frequency_hz)


@with_one_blas_thread
def localise(comparison: Comparison) -> Localisation:
    """Map the misfit of a fitted model.

    Parameters
    ----------
    comparison : Comparison

    Raises
    ------
    RecordError
        If the noise of a record is not known.
    """
    left, model, noise = comparison.renewed(), comparison.model, comparison.noise
    changes = tuple(changes_of(left))
    misfits = [np.mean(white**2) for white in noise.by_record(noise.residual(model))]
    worst = int(np.argmax(misfits))
    ports = needed_at_ports(comparison, worst)
    kind = Localisation((), ports, left.tones, changes, (), np.nan, ()).kind
    growth = [
        _growth(part, model)
        for part in noise.in_time
        if part.window.is_periodic and part.record.point == noise.records[worst].point
    ]
    maps = misfit_maps(comparison)
    cells = _cells(maps, left, largest_change(changes), kind)
    return Localisation(maps, ports, left.tones, changes, tuple(growth), _exponent(growth), cells, worst)


def largest_cell(comparison: Comparison, left: Comparison, change: Change | None) -> Cell:
    """Where a model misses most; `left` is it in the noise of its own residual, with what changes in that."""
    return _cells(misfit_maps(comparison), left, change, "")[0]


def _cells(maps: Sequence[MisfitMap], left: Comparison, change: Change | None, kind: str) -> tuple[Cell, ...]:
    """The cells of all maps, tones and what changes, largest first."""
    cells = []
    for own in maps:
        for b, band in enumerate(zip(own.edges_hz[:-1], own.edges_hz[1:], strict=True)):
            for channel, misfit in zip(own.channels, own.misfit[b], strict=True):
                if np.isfinite(misfit):
                    cells.append(Cell(own.record, channel, (float(band[0]), float(band[1])), float(misfit), kind))
    for part in left.noise.in_time:
        cells += [_tone_cell(part.record, tone) for tone in part.tones]
    if change is not None:
        channel = ".".join(("y", *change.parameter.split(".")[1:]))
        power = change.criterion.statistic
        cells.append(Cell(change.record, channel, (0.0, change.frequency_hz), power, "drift"))
    return tuple(sorted(cells, key=lambda cell: -cell.misfit))


def misfit_maps(comparison: Comparison, white: FloatArray | None = None, bands: int = 12) -> tuple[MisfitMap, ...]:
    """The misfit of every record by band and channel: of the last model of a diagnosis, that nothing is left.

    Parameters
    ----------
    comparison : Comparison
    white : ndarray, optional
        Whitened residual of all records in a row; default: that of the comparison.
    bands : int
        Of equal ratio in frequency.

    Raises
    ------
    RecordError
        If the noise of a record is not known.
    """
    noise = comparison.noise
    residual = noise.by_record(comparison.residual if white is None else white)
    return tuple(_map(part, own, bands) for part, own in zip(noise.parts, residual, strict=True))


def _map(part: RecordLines | ResponseLines, white: FloatArray, bands: int) -> MisfitMap:
    """From the power of each line and channel over that of its noise."""
    frequency, alone = part.by_channel(white)
    edges = np.geomspace(frequency[0], frequency[-1] * 1.0001, bands + 1)
    table = np.full((bands, alone.shape[1]), np.nan)
    for b in range(bands):
        inside = (frequency >= edges[b]) & (frequency < edges[b + 1])
        if inside.any():
            table[b] = np.mean(alone[inside], axis=0)
    return MisfitMap(part.record.name, tuple(part.record.channels), edges, float(np.diff(frequency).min()), table)


def _growth(part: RecordLines, model: Model) -> Growth:
    record, window = part.record, part.window
    residual = part.residual_lines(model.at(record))[: len(window.excited)]
    power, n = part.noise_power()[: len(window.excited)], len(record.axes)
    repeats = 2.0 * np.sum(np.abs(residual[:, :n]) ** 2 - power[:, :n]) / (n * window.samples)
    return Growth(record.name, record.amplitude, float(np.sqrt(max(repeats, 0.0))))


def _exponent(growth: list[Growth]) -> float:
    seen = [g for g in growth if g.unexplained > 0.0 and g.amplitude > 0.0]
    amplitudes = np.log([g.amplitude for g in seen])
    if len(seen) < 2 or np.ptp(amplitudes) < 0.1:
        return np.nan
    return float(np.polyfit(amplitudes, np.log([g.unexplained for g in seen]), 1)[0])


def _tone_cell(record: Record, tone: Tone) -> Cell:
    half = record.sample_rate / record.samples
    band = (tone.frequency_hz - half, tone.frequency_hz + half)
    return Cell(record.name, record.channels[tone.channel], band, tone.power, "synchronous")
