"""The sensitivity S of a model's loop, broken at one place, over frequency, and its exact slopes by the parameters."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ambid.arrays import ComplexArray, FloatArray, StateSpace
from ambid.errors import InputError
from ambid.loop.controller import LawError, Reading, law_errors
from ambid.loop.loop import open_plant
from ambid.loop.response import frequency_response
from ambid.model import Model

Place = Literal["controller", "sensor"]
PLACES = {"controller": "the controller's output", "sensor": "the sensors"}
"""Where the loop may be broken."""
BEYOND = 5.0
"""Factor by which the grid goes beyond the slowest and the fastest pole: there S is 0 or 1 to a few per cent, and has
no peak."""
AROUND_POLES = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
"""Frequencies of the grid around that of each pole, in its decay rates: every sharp peak of S stands on a pole."""


class BrokenLoop:
    """The loop of a model, broken at one place: ``S = (I + L)^-1``.

    At the controller's output L is K G, at the sensors G K; a digital loop is taken from sample to sample of its
    controller, with hold and delay exact, as the controller itself would measure it.

    Parameters
    ----------
    model : Model
        Without nonlinear effects, and without a scale of i_e.
    place : {"controller", "sensor"}

    Attributes
    ----------
    model : Model
        The same at the rate of its controller.
    axes : int

    Raises
    ------
    InputError
        If there is no such place.
    """

    def __init__(self, model: Model, place: Place) -> None:
        if place not in PLACES:
            raise InputError(f"at = {place!r}: expected {' or '.join(map(repr, PLACES))}")
        own, rig = model.rig.controller, model.rig
        if own.is_digital and own.rate(rig.sample_rate) != rig.sample_rate:
            model = model.at(rig.replace(sample_rate=own.rate(rig.sample_rate)))
        self.model, self.place, self.axes = model, place, len(rig.axes)
        self._loop = model.loop if place == "controller" else model.with_noise_inputs()
        kind = "i_e." if place == "controller" else "n."
        self._driven = [k for k, name in enumerate(self._loop.inputs) if name.startswith(kind)]
        self._law = Law(model) if place == "controller" else None

    def grid(self, theta: FloatArray) -> FloatArray:
        """Frequencies [Hz], shape (F,), that no peak of S falls between; a digital loop's end at Nyquist's."""
        poles = self._loop.poles(theta)
        size = np.abs(poles[np.abs(poles) > 0.0]) / (2.0 * np.pi)
        low, high = size.min() / BEYOND, BEYOND * size.max()
        if self.model.rig.controller.is_digital:
            high = 0.5 * self.model.rig.sample_rate
            low = min(low, high / 10.0)
        swinging = poles[poles.imag > 0.0]
        around = (swinging.imag[:, None] - swinging.real[:, None] * AROUND_POLES).ravel() / (2.0 * np.pi)
        # frequencies a decade of the grid, beside those of the poles
        decades = np.geomspace(low, high, 2 + round(40 * np.log10(high / low)))
        return np.union1d(decades, around[(around > low) & (around < high)])

    def sensitivity(self, theta: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
        """S, shape (F, axes, axes): a column is what an injection on one axis does to all."""
        response = self._loop.frequency_response(theta, frequency_hz)[:, :, self._driven]
        if self._law is None:
            return response[:, : self.axes]
        return np.eye(self.axes) - self._law.response(theta, frequency_hz) @ response

    def slopes(
        self, theta: FloatArray, frequency_hz: FloatArray, injected: ComplexArray, free: Sequence[int]
    ) -> ComplexArray:
        """Derivative of S, times an injection of shape (F, axes), by parameters: shape (F, axes, len(free))."""
        u = np.zeros((len(frequency_hz), len(self._loop.inputs)), dtype=np.complex128)
        u[:, self._driven] = injected
        found = self._loop.frequency_slopes(theta, frequency_hz, u, free)
        if self._law is None:
            return found[:, : self.axes]
        slopes = -np.einsum("lay,lyp->lap", self._law.response(theta, frequency_hz), found)
        read = np.einsum("lyu,lu->ly", self._loop.frequency_response(theta, frequency_hz), u)
        for index, part in self._law.parts(frequency_hz):
            if index in free:
                slopes[:, :, list(free).index(index)] -= np.einsum("lay,ly->la", part, read)
        return slopes


class Law:
    """K from the outputs y and i_c to the commands, with the errors of its gains that are in the model."""

    def __init__(self, model: Model) -> None:
        rig = self.rig = model.rig
        self._matrices = rig.controller.state_space(len(rig.axes), rig.sample_rate)
        self._read = Reading.of(rig, model.loop.outputs, ()).outputs
        plant = open_plant(rig, model.acting, (), model.structure.reference)
        filled_by = {slot: k for k, p in enumerate(model.parameters) for slot in p.slots}
        self._errors = [
            (filled_by[error.slot], error) for error in law_errors(plant, rig) if not error.excitation.any()
        ]

    def state_space(self, theta: FloatArray) -> StateSpace:
        """A, B, C, D of K, from the outputs, in samples if it is digital."""
        A, B, C, D = self._matrices
        for index, error in self._errors:
            C, D = C + theta[index] * error.C, D + theta[index] * error.D
        return A, B @ self._read, C, D @ self._read

    def response(self, theta: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
        """K, shape (F, axes, outputs)."""
        return frequency_response(self.state_space(theta), self._points(frequency_hz))

    def parts(self, frequency_hz: FloatArray) -> list[tuple[int, ComplexArray]]:
        """Derivative of K by each error of a gain, with the index of its parameter."""
        A, B, *_ = self._matrices

        def part(error: LawError) -> ComplexArray:
            return frequency_response((A, B, error.C, error.D), self._points(frequency_hz)) @ self._read

        return [(index, part(error)) for index, error in self._errors]

    def _points(self, frequency_hz: FloatArray) -> ComplexArray:
        s = 2j * np.pi * frequency_hz
        return np.asarray(np.exp(s / self.rig.sample_rate) if self.rig.controller.is_digital else s, np.complex128)
