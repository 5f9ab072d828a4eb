"""A measured frequency response against a model: lines of its own, with a variance of their own.

Each frequency is a line on which every excitation in turn is one and all others are nothing. The response repeats by
what it is: there is no transient, no tone and no drift in it, and its noise is known before any model. It is of small
motion: a nonlinear model acts as its loop at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import polygamma

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import ModelError, RecordError
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.chance import RESPONSE_SPREAD
from ambid.noise.lines import White, as_lines
from ambid.noise.whitener import whitened
from ambid.record import FrequencyResponse
from ambid.record.frequency_gates import known_alike

HIDDEN = 0.5
"""Whitened difference by which nonlinear effects may change the loop at rest and count as absent there: it moves no
parameter by more than half a standard error."""

INDEPENDENT = np.array([1e-2, 1e6])
"""Between these the number of independent pairs is sought."""


class ResponseLines:
    """The lines of a measured frequency response, and their noise; what `RecordLines` is of a record in time.

    Parameters
    ----------
    response : FrequencyResponse
    model : Model
        Its residual shows how much the errors of pairs are one, where their covariance is not known.

    Attributes
    ----------
    numbers : int
        Real numbers of every whitened table: 2 for each pair of an output and an input at each frequency.
    judged : int
        How many of them were measured; the others are zero.
    measured_lines : ndarray of complex, shape (F, pairs)
        What was measured.
    whitening : ndarray of complex, shape (F, pairs, pairs)
    frequency_hz : ndarray, shape (F,)
    """

    is_in_time: Literal[False] = False
    noise_is_measured = True
    scatter = RESPONSE_SPREAD
    tones: tuple[Tone, ...] = ()
    angles = None

    def __init__(self, response: FrequencyResponse, model: Model) -> None:
        self.record, self.frequency_hz = response, response.frequency_hz
        self._base = model.at(response)
        pairs = response.response[0].size
        self._known = response.measured.reshape(-1, pairs)
        self.measured_lines = np.where(self._known, response.response.reshape(-1, pairs), 0.0)
        self.whitening = _whitening(response, self._known)
        self.numbers, self.judged = 2 * self._known.size, 2 * int(self._known.sum())

    def at(self, model: Model) -> Model:
        """The model at the operating point of the response."""
        return model.at(self.record)

    @cached_property
    def spreads(self) -> FloatArray:
        """That of the covariance, the same for every number, where there is one.

        Where the std alone is known, errors may go together, and the variance on a direction is up to the largest
        eigenvalue of their correlation. The more they do, the more the power of the residual scatters from frequency to
        frequency: with eigenvalues l of P pairs it is about a mean square of P / D independent numbers, D = sum l^2 /
        sum l, whose logarithm has the variance psi'(P / D), the trigamma function. Each is held against both of its
        neighbours, since misfit is smooth.
        """
        if self.record.covariance is not None:
            return np.full(self.numbers, self.record.spread)
        pairs = self._known.sum(axis=1)
        power = np.sum(self.white(self._base, []).residual.reshape(len(pairs), -1) ** 2, axis=1)[pairs > 0]
        apart = np.diff(np.log(np.maximum(power / pairs[pairs > 0], np.finfo(float).tiny)), n=2)
        most = float(np.median(pairs[pairs > 0]))
        independent = independent_numbers(float(np.mean(apart**2)) / 6.0)
        return np.full(self.numbers, np.clip(most / independent, 1.0, most))

    def white(self, here: Model, free: Sequence[int], *, roughly: bool = False, shortly: bool = False) -> White:
        """Residual and derivatives, as `RecordLines.white`; there is no transient, and no rough way."""
        response, slopes = self._response(here, free)
        nothing = np.zeros((self.numbers, 0))
        return White(self.whiten(self.measured_lines - response), self.whiten(slopes), 0, nothing)

    def slopes(self, here: Model, free: Sequence[int]) -> FloatArray:
        """Whitened derivatives of the response by the parameters in `free`, shape (numbers, free)."""
        return self.whiten(self._response(here, free)[1])

    def transients(self, here: Model) -> FloatArray:
        """An empty basis."""
        return np.zeros((self.numbers, 0))

    def departure(self, here: Model) -> FloatArray:
        """Whitened response less what was measured."""
        return self.whiten(self._response(here, [])[0] - self.measured_lines)

    def departure_from_rest(self, here: Model, free: Sequence[int] = ()) -> tuple[FloatArray, FloatArray]:
        """The same, and its derivatives: a response has no beginning."""
        return self.departure(here), self.slopes(here, free)

    def with_own_angles(self, model: Model) -> ResponseLines:
        """The same: no wave runs through it."""
        return self

    @property
    def whitened_measured(self) -> FloatArray:
        """What was measured."""
        return self.whiten(self.measured_lines)

    def whiten(self, lines: ComplexArray) -> FloatArray:
        """Numbers of shape (F, pairs) or (F, pairs, q), whitened, as real ones."""
        return whitened(self.whitening, lines)

    def simulated(self, here: Model) -> ComplexArray:
        """Response of a model, shape (F, outputs, inputs)."""
        return self._response(here, [])[0].reshape(self.record.response.shape)

    def points(self, here: Model) -> ComplexArray:
        """The frequencies as points of the unit circle, at the sample rate of the loop."""
        return np.exp(2j * np.pi * self.frequency_hz * here.loop.sample_time)

    def by_channel(self, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frequencies [Hz], and the power of whitened numbers in each output over its noise, shape (F, outputs)."""
        lines = as_lines(white, self._known.shape[1])[..., None]
        back = (np.linalg.pinv(self.whitening) @ lines).reshape(self.record.response.shape)
        left = np.where(self.record.measured, np.abs(back) ** 2, np.nan) / self.record.std**2
        count = np.sum(self.record.measured, axis=2)
        relative = np.nansum(left, axis=2) / np.maximum(count, 1)
        return self.frequency_hz, np.where(count > 0, relative, np.nan)

    def by_line(self, rows: FloatArray) -> FloatArray:
        """Rows of whitened numbers, summed frequency by frequency."""
        return np.asarray(rows.reshape(len(self._known), -1, rows.shape[1]).sum(axis=1))

    def _response(self, here: Model, free: Sequence[int]) -> tuple[ComplexArray, ComplexArray]:
        """Response, shape (F, pairs), and its derivatives by the parameters in `free`, (F, pairs, free)."""
        resting = here if here.is_linear else self._at_rest(here)
        loop, record, points = resting.loop, self.record, self.points(here)
        rows, columns = self._places(resting)
        acting = [k for k, i in enumerate(free) if here.names[i] in resting.names]
        own = [resting.names.index(here.names[free[k]]) for k in acting]
        shape = record.response.shape
        response, slopes = np.empty(shape, dtype=complex), np.zeros((*shape, len(free)), dtype=complex)
        for j, column in enumerate(columns):
            unit = np.zeros((len(points), len(loop.inputs)), dtype=complex)
            unit[:, column] = 1.0
            found, derivatives, _ = loop.core.lines(resting.theta, own, points, unit, None, False)
            response[:, :, j] = found[:, rows]
            slopes[:, :, j, acting] = derivatives[:, rows]
        pairs = self._known.shape[1]
        return response.reshape(-1, pairs), slopes.reshape(len(points), pairs, len(free))

    def _places(self, here: Model) -> tuple[list[int], list[int]]:
        """Where the outputs and inputs are among those of the loop."""
        record, loop = self.record, here.loop
        return _found(record, loop.outputs, record.outputs), _found(record, loop.inputs, record.inputs)

    def _at_rest(self, here: Model) -> Model:
        """A nonlinear model without its nonlinear effects, which must do nothing at rest.

        Raises
        ------
        ModelError
            If they change the loop at rest.
        """
        resting = here.without_nonlinear()
        points = self.points(here)
        apart = here.loop.transfer(here.theta, points) - resting.loop.transfer(resting.theta, points)
        rows, columns = self._places(here)
        apart = apart[:, rows][:, :, columns].reshape(self._known.shape)
        if float(np.linalg.norm(self.whiten(apart))) > HIDDEN:
            names = ", ".join(e.name for e in here.effects if e not in resting.effects)
            raise ModelError(
                f"{self.record.path or self.record.name}: {names} act at rest too, and a frequency response is "
                "judged without nonlinear effects; give records in time alone"
            )
        return resting


def independent_numbers(scatter: float) -> float:
    """How many independent numbers make a mean square whose logarithm has this variance, within `INDEPENDENT`."""
    fewest, most = INDEPENDENT
    if scatter >= polygamma(1, fewest):
        return float(fewest)
    if scatter <= polygamma(1, most):
        return float(most)
    return float(np.exp(brentq(lambda own: polygamma(1, np.exp(own)) - scatter, *np.log(INDEPENDENT))))


def _found(record: FrequencyResponse, names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Where channels of a response are among those of the loop."""
    for name in wanted:
        if name not in names:
            raise RecordError(
                f"{record.path or record.name}: {name} is no channel of the loop, which has {', '.join(names)}; rename "
                "it, or leave it out"
            )
    return [names.index(name) for name in wanted]


def _whitening(response: FrequencyResponse, known: NDArray[np.bool_]) -> ComplexArray:
    """What gives real and imaginary parts of the errors the variance 1, (F, pairs, pairs); zero where unknown."""
    std = response.std.reshape(known.shape)
    pairs = known.shape[1]
    if response.covariance is None:
        own = np.sqrt(2.0) / np.where(known, std, np.inf)
        return np.asarray(own[:, :, None] * np.eye(pairs), dtype=complex)
    found = np.zeros((len(known), pairs, pairs), dtype=complex)
    for rows, kept in known_alike(known):
        chosen = np.ix_(rows, kept, kept)
        found[chosen] = np.sqrt(2.0) * np.linalg.inv(np.linalg.cholesky(response.covariance[chosen]))
    return found
