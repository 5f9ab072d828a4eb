"""What may be changed for another experiment: amplitude, length, channels, speed, bias current, controller gain."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ambid.channels import by_signal
from ambid.errors import RigError
from ambid.model import Model
from ambid.record import Record
from ambid.rig import PidController, Rig


@dataclass(frozen=True)
class Change:
    """An experiment beside the one that was made.

    Attributes
    ----------
    what : str
        In words.
    amplitude : float
        Over the present one.
    rig : Rig or None
        At another operating point; None at the present one.
    record : tuple of str
        What is to be recorded that was not: ``i_c``, or further channels.
    """

    what: str
    amplitude: float = 1.0
    rig: Rig | None = None
    record: tuple[str, ...] = ()

    def at(self, model: Model) -> Model:
        """A model at the operating point of the experiment."""
        if self.rig is None:
            return model
        n = len(model.rig.axes)
        anything = Record("planned", model.rig.sample_rate, model.rig.axes, np.zeros((2, n)), np.zeros((2, n)), None)
        return model.covering([anything.at(self.rig)]).at(self.rig)


def changes(rig: Rig, record: Iterable[str]) -> Iterator[Change]:
    """All experiments that may be tried next on a machine; `record` is what could be recorded and is not."""
    yield Change("the same once more")
    for channels in by_signal(record).values():
        yield Change(f"record {', '.join(channels)}", record=tuple(channels))
    for factor in (0.5, 2.0):
        yield Change(f"{factor:g} times the amplitude", amplitude=factor)
    for factor in (0.5, 1.5) if rig.speed > 0.0 else ():
        yield Change(f"speed {factor * rig.speed:.4g} rad/s", rig=rig.replace(speed=factor * rig.speed))
    # bias currents that are tried, over the present one: K_i follows it, and K_s its square
    for factor in (0.75, 1.25):
        with suppress(RigError):  # beyond what a rig file may hold
            bearings = tuple(
                bearing.model_copy(
                    update={
                        "bias_current": factor * bearing.bias_current,
                        "force_current": tuple(factor * value for value in bearing.force_current),
                        "force_displacement": tuple(factor**2 * value for value in bearing.force_displacement),
                    }
                )
                for bearing in rig.bearings
            )
            yield Change(f"{factor:g} times the bias current", rig=rig.replace(bearings=bearings))
    if isinstance(rig.controller, PidController):
        for key in ("proportional", "derivative"):
            for factor in (0.8, 1.25):
                gain = np.asarray(getattr(rig.controller, key)) * factor
                if gain.any():
                    gains = gain.tolist() if gain.ndim == 0 else tuple(gain.tolist())
                    other = rig.controller.model_copy(update={key: gains})
                    yield Change(f"{factor:g} times controller.{key}", rig=rig.replace(controller=other))
