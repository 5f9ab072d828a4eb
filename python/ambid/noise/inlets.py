"""A fitted model with an inlet at every port: what the signals there leave of a record, the known parameters refitted.

What is missing bends the known parameters of a base fit. Only where they are unbent again does the port at which it
acts leave noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambid.arrays import ComplexArray, FloatArray, stacked
from ambid.errors import ModelError, UnstableLoopError
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.plant import Plant
from ambid.model import Model
from ambid.noise.lines import RecordLines, as_lines
from ambid.noise.response_lines import ResponseLines
from ambid.rig import Rig

STILL = 0.01
"""Of the degrees of freedom: a refit that takes away less leaves the linearisation as it is."""


class _Inlets(Effect):
    """Further inputs at signals of the plant, by the name of the inlet; no physics."""

    name = "inlets"

    def __init__(self, signals: dict[str, str]) -> None:
        self.signals = signals

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """None."""
        return []

    def attach(self, plant: Plant) -> None:
        """An input of each axis at each signal."""
        for name, signal in self.signals.items():
            for axis in plant.axes:
                plant.inject(f"{signal}.{axis}", plant.input(f"{name}.{axis}"))


@dataclass(frozen=True)
class Left:
    """What a port leaves of the whitened excited lines.

    Attributes
    ----------
    needed : ndarray, shape (lines, inlets)
        What it needs, of least norm.
    residual : ndarray, shape (lines, channels)
    step : ndarray, shape (parameters,)
        By which the known parameters move with it, to first order.
    power : float
        What that step takes away beside the port.
    free : int
        Degrees of freedom of the residual.
    """

    needed: ComplexArray
    residual: ComplexArray
    step: FloatArray
    power: float
    free: int

    @property
    def cost(self) -> float:
        """Sum of squares that is left."""
        return float(np.sum(np.abs(self.residual) ** 2))


@dataclass(frozen=True)
class Sight:
    """The excited lines of a record or response, as a model at some values of its parameters sees them, whitened.

    Attributes
    ----------
    model : Model
        At the operating point of the record.
    part : RecordLines or ResponseLines
    signals : dict of str to str
        Name of each inlet, and the signal of the plant that it is added to, both without the axis.
    numbers : tuple of ndarray, shape (numbers,) and (numbers, parameters)
        Residual and slopes, of the other lines too.
    residual : ndarray, shape (lines, channels)
    slopes : ndarray, shape (lines, channels, parameters)
    ways : ndarray, shape (lines, channels, inlets)
        Responses to the inlets, all axes of the first signal first.
    """

    model: Model
    part: RecordLines | ResponseLines
    signals: dict[str, str]
    numbers: tuple[FloatArray, FloatArray]
    residual: ComplexArray
    slopes: ComplexArray
    ways: ComplexArray

    @classmethod
    def of(
        cls, model: Model, part: RecordLines | ResponseLines, signals: dict[str, str], through: Model | None = None
    ) -> Sight:
        """Look at a record, by ways through another model's loop where that of the model has none.

        Raises
        ------
        UnstableLoopError
            If the loop is unstable at the values of the model, or its linearisation at rest is.
        """
        through = through or model
        loop = through.watching((), [_Inlets(signals)])
        if (growth := loop.poles(through.theta)[0].real) >= 0.0:
            raise UnstableLoopError(f"the loop, linearised at rest, grows by {growth:.3g} 1/s: no way back to a port")
        inlets = [k for k, name in enumerate(loop.inputs) if name.split(".")[0] in signals]
        outputs, frequency = [loop.outputs.index(name) for name in part.record.channels], part.frequency_hz
        whitening = part.whitening[: len(frequency)]
        # of an analog loop in continuous time: a signal held from sample to sample is no displacement
        responses = loop.frequency_response(through.theta, frequency)[:, outputs][..., inlets]
        # each excitation of a response calls for a signal of its own
        pairs = whitening.shape[1]
        ways = np.einsum("koc,ij->koicj", responses, np.eye(pairs // len(outputs)))
        ways = whitening @ ways.reshape(len(frequency), pairs, -1)
        residual, slopes, *_ = part.white(model, list(range(len(model.names))))
        lines = as_lines(residual, pairs)[: len(frequency)], as_lines(slopes, pairs)[: len(frequency)]
        return cls(model, part, signals, (residual, slopes), *lines, ways)

    @property
    def judged(self) -> int:
        """Numbers among the lines that were measured."""
        return 2 * self.residual.size - (self.part.numbers - self.part.judged)

    @property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(np.sum(np.abs(self.residual) ** 2))

    def way(self, port: str) -> ComplexArray:
        """Responses to the inlets of a port, shape (lines, channels, inlets)."""
        each = self.ways.shape[-1] // len(self.signals)
        first = each * list(self.signals).index(port)
        return self.ways[..., first : first + each]

    def left_by(self, port: str) -> Left:
        """What a port leaves that is given whatever it needs, the known parameters refitted to first order."""
        way = self.way(port)
        seen, sizes, by = np.linalg.svd(way, full_matrices=False)
        kept = sizes > 1e-9 * sizes[:, :1]
        inverse = (by.conj().transpose(0, 2, 1) * (kept / np.where(kept, sizes, 1.0))[:, None]) @ (
            seen.conj().transpose(0, 2, 1)
        )
        beyond = self.slopes - way @ (inverse @ self.slopes)
        residual = self.residual - (way @ (inverse @ self.residual[..., None]))[..., 0]
        size = np.linalg.norm(self.slopes, axis=(0, 1))
        scale = np.where(size > 0.0, size, 1.0)
        columns = stacked(beyond.reshape(-1, len(scale))) / scale
        # what a port that can do all that a parameter does leaves of its response is rounding
        scaled, _, rank, _ = np.linalg.lstsq(columns, stacked(residual.reshape(-1, 1))[:, 0], rcond=1e-6)
        step, power = scaled / scale, float(np.sum((columns @ scaled) ** 2))
        needed = (inverse @ (self.residual - self.slopes @ step)[..., None])[..., 0]
        taken = 2 * int(kept.sum()) + int(rank)
        return Left(needed, residual - beyond @ step, step, power, self.judged - taken)

    def unbent(self, port: str, left: Left) -> Left:
        """What a port leaves as a model sees it whose known parameters are where they want to be beside it."""
        if left.power < STILL * left.free:
            return left
        own = {port: self.signals[port]}
        try:
            nearer = Sight.of(self.model.with_theta(self.model.theta + left.step), self.part, own)
        except (ModelError, UnstableLoopError):  # values that no machine has: no nearer than this
            return left
        further = nearer.left_by(port)
        return further if further.cost + further.power < left.cost + left.power else left
