"""Which excitation does a model answer wrongly, at which output: the misfit input by output, band by band.

Excitations of several axes are played at the same time. On the excited lines of a band the residual of an output is

    r(l) = sum over inputs i of (a_i + b_i x) U_i(l) + what follows no excitation,

x from -1 to 1 over a few neighbouring lines: least squares, weighted by the output's noise, give the response
``a_i + b_i x`` that the model lacks to each input, beside all others, as far as their sequences differ there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.findings import Finding, Kind, Where, WithFindings
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.lines import RecordLines
from ambid.noise.response_lines import ResponseLines
from ambid.results import Tabular, band_text, picture, plain
from ambid.threads import with_one_blas_thread

BANDS = 8
"""Bands of equal ratio in frequency; the lowest are joined until each holds enough lines."""
LINES = 4
"""Neighbouring lines per excited axis that a response is taken from: twice the numbers that are fitted."""
TERMS = 2
"""Numbers that each response has over such lines: a value and a slope."""
SHARED = 100.0
"""An excitation that has less than one part in so many of its power apart from the others is not distinguished."""
FALSE_CELL = 1e-3
"""Chance that any cell of a matrix is significant where there is nothing but noise."""
SIGN = 4.0
"""Standard errors beyond which a mean has a sign: chance has it in one of 16 000."""
INSEPARABLE = Kind(
    "excitations_inseparable",
    "note",
    "{inputs} cannot be separated from {low_hz:.4g} to {high_hz:.4g} Hz",
    "excite axes with other sequences, or one after the other",
)


@dataclass(frozen=True, repr=False, eq=False)
class MisfitMatrix(ByValue, WithFindings, Tabular):
    """What each output of one record answers to each excitation beyond the model; result of `misfit_matrix`.

    Attributes
    ----------
    record : str
    outputs, inputs : tuple of str
        Such as ``y.A_zeta`` and ``i_e.A_eta``.
    edges_hz : ndarray, shape (bands + 1,)
    power : ndarray, shape (bands, outputs, inputs)
        Of that answer, over the power of the output's noise, mean over the lines, without what noise alone brings: 0 is
        nothing; NaN where an excitation is not distinguished from the others.
    response : ndarray of complex, shape (bands, outputs, inputs)
        The response that the model lacks [m/A, A/A], mean over the band.
    std : ndarray, shape (bands, outputs, inputs)
        Standard error of its real part, and of its imaginary part.
    is_told : ndarray of bool, shape (bands, outputs, inputs)
        Where it is more than chance brings, see `FALSE_CELL`; what follows no excitation counts as noise.
    rest : ndarray, shape (bands, outputs)
        Power, in times noise, of what follows no excitation in this manner: 1 is noise alone, more is motion that is
        not linear, or a response that bends within a few lines; NaN of a frequency response.
    """

    record: str
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    edges_hz: FloatArray
    power: FloatArray
    response: ComplexArray
    std: FloatArray
    is_told: NDArray[np.bool_]
    rest: FloatArray

    plot = picture("plot_misfit_matrix")

    @property
    def sign(self) -> NDArray[np.int_]:
        """Of the real part of `response`, shape (bands, outputs, inputs); 0 where it is not significant."""
        real = np.nan_to_num(self.response.real)
        return np.where(self.is_told & (np.abs(real) > SIGN * self.std), np.sign(real), 0).astype(int)

    @property
    def crossed(self) -> dict[str, float]:
        """How the two axes of a bearing answer each other beyond the model, of those that do, by bearing.

        Correlation over the bands of what the first axis answers to the second with what the second answers to the
        first: -1 is opposite sign, as a seal's cross-coupled stiffness has it; +1 is the same sign.
        """
        found = {}
        for first, second in combinations([name for name in self.outputs if name.startswith("y.")], 2):
            a, b = (name.removeprefix("y.") for name in (first, second))
            bearing = a.rpartition("_")[0]
            one, other = self._pair(first, f"i_e.{b}"), self._pair(second, f"i_e.{a}")
            known = np.isfinite(one) & np.isfinite(other)
            one, other = one[known], other[known]
            if bearing == b.rpartition("_")[0] and known.any():
                size = np.linalg.norm(one) * np.linalg.norm(other)
                found[bearing] = float(np.vdot(one, other).real / size)
        return found

    def lines(self, most: int = 6) -> list[str]:
        """The largest cells, and how the axes of a bearing answer each other, a sentence each."""
        cells = [place for place in zip(*np.nonzero(self.is_told), strict=True) if np.isfinite(self.power[place])]
        cells.sort(key=lambda place: -self.power[place])
        text = [self._line(*map(int, place)) for place in cells[:most]]
        for bearing, correlation in self.crossed.items():
            if abs(correlation) > 0.5:
                how = "opposite" if correlation < 0.0 else "the same"
                text.append(f"the axes of {bearing} answer each other with {how} sign (correlation {correlation:.2f})")
        return [*text, *self.notes]

    def table(self) -> dict[str, list[Any]]:
        """A row each band, output and input."""
        places = list(np.ndindex(*self.power.shape))
        return {
            "low_hz": [float(self.edges_hz[b]) for b, _, _ in places],
            "high_hz": [float(self.edges_hz[b + 1]) for b, _, _ in places],
            "output": [self.outputs[o] for _, o, _ in places],
            "input": [self.inputs[i] for _, _, i in places],
            "power": self.power.ravel().tolist(),
            "significant": self.is_told.ravel().tolist(),
        }

    def summary(self) -> list[str]:
        """How many cells are significant, and the largest of them."""
        count = int(self.is_told.sum())
        return [f"{self.record}: {count} of {self.is_told.size} cells are significant", *self.lines()]

    def to_json(self) -> dict[str, Any]:
        """Plain data; complex numbers are [re, im]."""
        return plain(
            {
                "record": self.record,
                "outputs": list(self.outputs),
                "inputs": list(self.inputs),
                "edges_hz": self.edges_hz.tolist(),
                "power": self.power.tolist(),
                "response": self.response.tolist(),
                "std": self.std.tolist(),
                "told": self.is_told.tolist(),
                "sign": self.sign.tolist(),
                "rest": self.rest.tolist(),
                "crossed": self.crossed,
                **self.findings_as_dict(),
            }
        )

    def _pair(self, output: str, inlet: str) -> ComplexArray:
        """The response of one pair in standard errors, shape (bands,); NaN where it is not significant or not there."""
        if output not in self.outputs or inlet not in self.inputs:
            return np.full(len(self.power), np.nan, dtype=complex)
        o, i = self.outputs.index(output), self.inputs.index(inlet)
        return np.where(self.is_told[:, o, i], self.response[:, o, i] * (1.0 / self.std[:, o, i]), np.nan)

    def _line(self, b: int, o: int, i: int) -> str:
        low, high = self.edges_hz[b : b + 2]
        sign = {1: ", real part > 0", -1: ", real part < 0", 0: ""}[int(self.sign[b, o, i])]
        return (
            f"{self.outputs[o]} by {self.inputs[i]}, {band_text(low, high)} Hz: {self.power[b, o, i]:.3g} times noise"
            f"{sign}"
        )

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Which excitations are too much alike, in which band."""
        found = []
        unknown = np.asarray(np.all(np.isnan(self.power), axis=1))
        for band, (low, high) in enumerate(zip(self.edges_hz[:-1], self.edges_hz[1:], strict=True)):
            names = [name for name, is_unknown in zip(self.inputs, unknown[band], strict=True) if is_unknown]
            if names:
                own: dict[str, Any] = {"low_hz": float(low), "high_hz": float(high)}
                found.append(INSEPARABLE(Where(record=self.record), inputs=names, **own))
        return tuple(found)


@with_one_blas_thread
def misfit_matrix(comparison: Comparison) -> tuple[MisfitMatrix, ...]:
    """The misfit of every record, input by output.

    Parameters
    ----------
    comparison : Comparison

    Returns
    -------
    tuple of MisfitMatrix
        One per record that something drives.

    Raises
    ------
    RecordError
        If the noise of a record is not known.
    """
    found = []
    for part in comparison.noise.parts:
        here = part.at(comparison.model)
        own = _of_lines(part, here) if part.is_in_time else _of_response(part, here)
        if own is not None:
            found.append(own)
    return tuple(found)


def _of_lines(part: RecordLines, here: Model) -> MisfitMatrix | None:
    inputs, u = part.excitations
    if not inputs:
        return None
    count, frequency = len(u), part.frequency_hz
    root = 1.0 / np.sqrt(part.noise_power()[:count])
    white = part.residual_lines(here)[:count] * root
    width = LINES * len(inputs)
    edges, bands = _bands(frequency, width)
    shape = (len(bands), white.shape[1], len(inputs))
    power, std, is_told = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape, dtype=bool)
    response, rest = np.full(shape, np.nan, dtype=complex), np.full(shape[:2], np.nan)
    for b, band in enumerate(bands):
        parts = [rows for rows in np.array_split(band, max(1, len(band) // width)) if len(rows) > TERMS * len(inputs)]
        if not parts:
            continue
        fits = [_fit(u[rows], root[rows], white[rows]) for rows in parts]
        free = sum(fit.free for fit in fits)
        rest[b] = sum(fit.left for fit in fits) / free
        noise = np.maximum(rest[b], 1.0)[:, None]
        separable = np.array([fit.is_separable for fit in fits])
        lines: FloatArray = separable.T @ np.array([float(len(rows)) for rows in parts])
        known = np.greater(lines, 0.0)
        seen, by_chance, score = (
            np.einsum("ki,koi->oi", separable, np.array([getattr(fit, name) for fit in fits]))
            for name in ("power", "by_chance", "score")
        )
        weight = np.array([own[None, :] / fit.variance for own, fit in zip(separable, fits, strict=True)])
        mean = np.sum(weight * np.array([fit.value for fit in fits]), axis=0)
        total = weight.sum(axis=0)
        power[b][:, known] = (np.maximum(seen - noise * by_chance, 0.0)[:, known]) / lines[known]
        response[b][:, known] = mean[:, known] / total[:, known]
        std[b][:, known] = (np.sqrt(0.5 * noise / np.where(known, total, 1.0)))[:, known]
        degrees = 2 * TERMS * separable.sum(axis=0)
        ratio = score / (np.maximum(degrees, 1) * noise)
        is_told[b] = known & (fdtrc(np.maximum(degrees, 1), 2 * free, ratio) < FALSE_CELL / power.size)
    channels = tuple(part.record.channels)
    return MisfitMatrix(part.record.name, channels, inputs, edges, power, response, std, is_told, rest)


@dataclass(frozen=True)
class _Fit:
    """Of a few lines; tables of shape (outputs, inputs) but `left`, (outputs,), and `is_separable`, (inputs,)."""

    power: FloatArray
    by_chance: FloatArray
    score: FloatArray
    value: ComplexArray
    variance: FloatArray
    left: FloatArray
    free: int
    is_separable: NDArray[np.bool_]


def _fit(u: ComplexArray, root: FloatArray, white: ComplexArray) -> _Fit:
    """Least squares of the residual of every output, `white` in units of its noise, by all excitations at once."""
    n, inputs = u.shape
    x = np.linspace(-1.0, 1.0, n)
    size = np.linalg.norm(u, axis=0)
    is_there = size > 1e-9 * size.max()
    alike = np.eye(inputs) * 1e-12 + (u / np.where(is_there, size, 1.0)).conj().T @ (u / np.where(is_there, size, 1.0))
    apart = is_there & (np.diag(np.linalg.pinv(alike)).real < SHARED)
    table = (u[:, :, None] * np.stack([np.ones(n), x], axis=1)[:, None, :]).reshape(n, -1)
    own = root.T[:, :, None] * table  # (outputs, n, inputs * TERMS)
    gram = own.conj().transpose(0, 2, 1) @ own
    inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
    theta = (inverse @ own.conj().transpose(0, 2, 1) @ white.T[:, :, None])[..., 0]
    left = np.sum(np.abs(white.T - (own @ theta[..., None])[..., 0]) ** 2, axis=1)
    blocks = np.arange(inputs * TERMS).reshape(inputs, TERMS)
    grams, inverses = (m[:, blocks[:, :, None], blocks[:, None, :]] for m in (gram, inverse))
    by_input = theta.reshape(len(theta), inputs, TERMS)
    power = np.einsum("oia,oiab,oib->oi", by_input.conj(), grams, by_input).real
    by_chance = np.einsum("oiab,oiba->oi", grams, inverses).real
    score = 2.0 * np.einsum("oia,oiab,oib->oi", by_input.conj(), np.linalg.pinv(inverses), by_input).real
    variance = np.maximum(inverses[:, :, 0, 0].real, 1e-300)
    return _Fit(power, by_chance, score, by_input[:, :, 0], variance, left, n - inputs * TERMS, apart)


def _of_response(part: ResponseLines, here: Model) -> MisfitMatrix:
    """Of a frequency response, which has each excitation by itself."""
    record = part.record
    left, std = record.response - part.simulated(here), record.std
    is_known = np.isfinite(left)
    left, std = np.where(is_known, left, 0.0), np.where(is_known, std, 1.0)  # quotients of NaN warn
    edges, bands = _bands(record.frequency_hz, 1)
    shape = (len(bands), *left.shape[1:])
    power, is_told = np.full(shape, np.nan), np.zeros(shape, dtype=bool)
    response, error = np.full(shape, np.nan, dtype=complex), np.full(shape, np.nan)
    for b, rows in enumerate(bands):
        known = is_known[rows]
        relative = np.where(known, np.abs(left[rows] / std[rows]) ** 2, 0.0)
        weight = np.where(known, std[rows] ** -2, 0.0).sum(axis=0)
        count = known.sum(axis=0)
        chance = chdtrc(2 * np.maximum(count, 1), 2.0 * relative.sum(axis=0))
        is_told[b] = (count > 0) & (chance < FALSE_CELL / power.size)
        with np.errstate(invalid="ignore", divide="ignore"):
            power[b] = np.where(count, np.maximum(relative.sum(axis=0) / count - 1.0, 0.0), np.nan)
            response[b] = np.where(known, left[rows] / std[rows] ** 2, 0.0).sum(axis=0) / weight
            error[b] = np.sqrt(0.5 / weight)
    rest = np.full(shape[:2], np.nan)
    return MisfitMatrix(record.name, record.outputs, record.inputs, edges, power, response, error, is_told, rest)


def _bands(frequency: FloatArray, least: int) -> tuple[FloatArray, list[NDArray[np.intp]]]:
    """Edges of bands, and the lines of each: so many at least, unless there are fewer in all."""
    edges = np.geomspace(frequency[0], frequency[-1] * 1.0001, BANDS + 1)
    kept, lines = [edges[0]], list(_between(edges, frequency, least))
    kept += [high for high, _ in lines]
    return np.array(kept), [rows for _, rows in lines]


def _between(edges: FloatArray, frequency: FloatArray, least: int) -> Iterator[tuple[float, NDArray[np.intp]]]:
    first, total = 0, len(frequency)
    for high in edges[1:]:
        end = int(np.searchsorted(frequency, high))
        if high == edges[-1] or (end - first >= least and total - end >= least):
            yield float(high), np.arange(first, end)
            first = end
