"""The measured shape itself as an effect: what a port needs, as a table over a signal, times a factor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.plant import Plant
from ambid.rig import Rig

PORTS = {"force": "f", "current": "i_ref", "sensor": "y", "reading": "i_c"}
"""Ports that may need a signal, and the signals of the plant that it is added to."""
OVER = ("s", "v", "i_f", "i_ref", "y")
"""Signals that a shape may be a function of."""
FEWEST = 10
"""Samples that each point of a shape is the mean of, at least."""
POINTS = 12
"""Of a shape, at the most."""
LARGEST = 10.0
"""Factor that a refit may give the shape; it was measured as large as it is."""


class NeededAtPort(Protocol):
    """What `ambid.localise` finds at a port; see `ambid.diagnosis.ports.Port`."""

    @property
    def name(self) -> str:
        """Of the port."""

    @property
    def needed(self) -> FloatArray:
        """What the port needs, sample by sample."""

    @property
    def terms(self) -> Sequence[Any]:
        """Simple shapes of it, the best first."""

    @property
    def against(self) -> dict[str, FloatArray]:
        """Signals of the loop that it may be a function of."""

    @property
    def weights(self) -> Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, float]]:
        """See `ambid.diagnosis.ports.Port`."""


@dataclass(frozen=True)
class MeasuredShape(Effect):
    """A table of the signal that a port needs, over one signal of the loop; the same at every axis.

    Attributes
    ----------
    port : str
        ``force``, ``current``, ``sensor`` or ``reading``.
    over : str
        ``s`` [m], ``v`` [m/s], ``i_f`` [A], ``i_ref`` [A] or ``y`` [m].
    at, values : tuple of float
        Points of the shape, `at` rising; between them and beyond it goes on as straight lines.
    """

    name = "measured_shape"
    physics = "what the records need at a port, as they show it over one signal; its cause is for a person to name"
    equation = "port + g shape(signal)"
    signature = "as the residual it was taken from"
    source = "the records"

    port: str = "force"
    over: str = "v"
    at: tuple[float, ...] = (-1.0, 1.0)
    values: tuple[float, ...] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse an unknown port or signal, and points that do not rise."""
        super().__post_init__()
        if self.port not in PORTS or self.over not in OVER:
            raise ModelError(
                f"measured_shape: port {self.port}, over {self.over}; expected one of {', '.join(PORTS)}, over one of "
                f"{', '.join(OVER)}"
            )
        if not (len(self.at) == len(self.values) > 1 and np.all(np.diff(self.at) > 0.0)):
            raise ModelError(
                f"measured_shape: {len(self.at)} points and {len(self.values)} values; expected as many of both, two "
                "or more, the points rising"
            )

    @classmethod
    def from_port(
        cls, port: NeededAtPort, over: str | None = None, before: MeasuredShape | None = None
    ) -> MeasuredShape:
        """The shape of what a port needs.

        Parameters
        ----------
        port : Port
            Of `Localisation.ports`.
        over : str, optional
            The signal; default: the one over which the shape explains most of the needed signal.
        before : MeasuredShape, optional
            The shape that is in the model already; what is still needed is added to it. What the model's own parameters
            had taken up of it before comes out so, step by step.

        Raises
        ------
        ModelError
            If the port needs nothing, or has too few samples.
        """
        names = (before.over,) if before is not None else OVER if over is None else (over,)
        known = [name for name in names if name in port.against]
        if not known or not np.any(port.needed):
            raise ModelError(f"the {port.name} port needs no signal over {' or '.join(names)}")
        shapes = {name: _shape(port, port.against[name], before) for name in known}
        best = max(known, key=lambda name: shapes[name][2])
        at, values, _ = shapes[best]
        return cls(port.name, best, tuple(at.tolist()), tuple(values.tolist()))

    @property
    def symmetry(self) -> float:
        """-1 of an odd shape, 1 of an even one, otherwise 0."""
        turned, values = np.array(self.values[::-1]), np.array(self.values)
        alike = np.allclose(np.array(self.at[::-1]), -np.array(self.at))
        return next((sign for sign in (-1.0, 1.0) if alike and np.allclose(sign * turned, values)), 0.0)

    def times(self, factor: float) -> MeasuredShape:
        """The shape with its values times a factor, such as the one that a refit gave it."""
        return replace(self, values=tuple(factor * value for value in self.values))

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Factor of the shape: 1 as measured."""
        meaning = "factor g of the shape, 1 as it was measured"
        return [EffectParameter("factor", "1", 1.0, lower=-LARGEST, upper=LARGEST, meaning=meaning)]

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """As measured, or as much of it as the residual calls for."""
        return {"factor": float(np.clip(amplitudes[0], 0.1, LARGEST))}

    def attach(self, plant: Plant) -> None:
        """The table at every axis."""
        reach = max(abs(self.at[0]), abs(self.at[-1]))
        for axis in plant.axes:
            signal = plant[f"{self.over}.{axis}"]
            # the cubic splines of the table round the corners of the shape
            shape = plant.table(self._value, [signal], reach=[reach], slot=self.slot("factor"), nodes=101)
            plant.inject(f"{PORTS[self.port]}.{axis}", shape)

    def _value(self, x: FloatArray) -> FloatArray:
        return np.interp(x, self.at, self.values)


def _shape(port: NeededAtPort, x: FloatArray, before: MeasuredShape | None) -> tuple[FloatArray, FloatArray, float]:
    """Points of x with as many samples between each two, the values there that explain most, and how much that is.

    A port whose best simple shape is odd or even gets one that is so, too: half as many values say it better.
    """
    sign = _symmetry(port) if before is None else before.symmetry
    own = np.abs(x) if sign else x
    at = np.quantile(own, np.linspace(0.0, 1.0, int(np.clip(x.size // FEWEST, 4, POINTS))))
    at = np.unique(np.concatenate([[0.0], at[1:]]) if sign else at)
    hats = np.stack([np.interp(own, at, one) for one in np.eye(len(at))], axis=-1)
    old = np.zeros(len(at)) if before is None else np.interp(at, before.at, before.values)
    size = float(np.std(port.needed)) if before is None else float(np.std(before.values))
    # of the size of what is needed: by how much a shape bends at a point, before the records speak
    bends = np.diff(np.eye(len(at)), 2, axis=0) / (0.1 * size)
    signed = (np.sign(x)[..., None] if sign < 0.0 else 1.0) * hats
    if sign < 0.0:  # nothing at 0; the bends are those of the half beyond
        more, share = port.weights(signed[..., 1:], bends[1:, 1:], -(bends @ old)[1:])
        values = old + np.concatenate([[0.0], more])
    else:
        more, share = port.weights(signed, bends, -(bends @ old))
        values = old + more - float(np.mean(hats @ more))
    if sign:
        at, values = np.concatenate([-at[:0:-1], at]), np.concatenate([sign * values[:0:-1], values])
    return at, values, share


def _symmetry(port: NeededAtPort) -> float:
    """-1 where the best simple shape at a port is odd, 1 where it is even, otherwise 0."""
    return {"odd": -1.0, "even": 1.0}.get(port.terms[0].kind if port.terms else "", 0.0)
