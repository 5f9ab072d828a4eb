"""What the misfit of a record without periods does not see, since it takes it for noise.

Without periods the noise is what no smooth response to the excitation leaves. What is missing and not linear, such as
friction, hardly bends a smooth response: it makes the noise louder, and J/dof stays 1. Two things contradict that.
Over all lines together, as the fit has them, no more may be left of a channel than its noise: J counts every line
alike, and what is missing on a few loud ones is lost in it. And noise has no shape: what does not come from the
excitation cannot follow a function of the motion that the excitation brings.
"""

from __future__ import annotations

import numpy as np

from ambid.errors import UnstableLoopError
from ambid.findings import Kind, Where
from ambid.model import Model
from ambid.noise.adequacy import Criterion
from ambid.noise.chance import ADEQUATE
from ambid.noise.inlets import Sight
from ambid.noise.lines import RecordLines
from ambid.noise.measured import Measured
from ambid.noise.shapes import Shapes

LONGEST = 131_072
"""Samples of a record without periods that are searched for a shape, from the first on: as many lines are judged of
these as of all, and the signals at the ports of four axes would take another third of a gigabyte a million samples."""
PORTS = {"force": "f", "current": "i_ref", "sensor": "y"}
"""Ports at which a shape may act, and the signal that it is added to."""
OVER_CEILING = Kind(
    "residual_above_noise",
    "warning",
    "{ratio:.2g} times the power of the noise is left, so that the fit stays below the attainable fit, at few "
    "frequencies beside all that the misfit counts alike: physics is missing, and parameters may be further off than "
    "their intervals state",
    "excite periodically, which separates noise from response",
)


def power_left(part: RecordLines, here: Model) -> Criterion:
    """The channel of a record without periods that is left with most beyond its noise.

    The sum of the powers of all lines is compared with that of the noise there, which is about chi-squared with
    2 (sum P)^2 / sum P^2 degrees of freedom (Welch and Satterthwaite). Lines of tones are excluded: they are reported
    by themselves.

    Parameters
    ----------
    part : RecordLines
    here : Model
        At the operating point of the record.
    """
    power, usual = part.noise_power(), part.beside_tones
    left, power = np.abs(part.residual_lines(here)[usual]) ** 2, power[usual]
    ratio = left.sum(axis=0) / power.sum(axis=0)
    degrees = 2.0 * power.sum(axis=0) ** 2 / np.sum(power**2, axis=0)
    name, trials = part.record.name, len(ratio)
    channels = [
        Criterion("power", own, free, np.inf, trials, ADEQUATE, where=Where(record=name, channel=channel))
        for channel, own, free in zip(part.record.channels, ratio.tolist(), degrees.tolist(), strict=True)
    ]
    return max(channels, key=lambda own: own.statistic / own.limit)


def shape_left(part: RecordLines, model: Model, least: float = 0.0) -> Criterion | None:
    """The nonlinear shape that a model leaves of a record most surely; None where it cannot be determined.

    Parameters
    ----------
    part : RecordLines
    model : Model
        Fitted; its nonlinear effects are linearised at rest in the way from a port, or left out of it where rest is
        not stable: of noise every way is as good.
    least : float
        Score of a shape that formulas of the effects may leave.
    """
    part = _beginning(part, model)
    here = part.at(model)
    try:
        through = here if here.is_linear or here.is_stable else here.without_nonlinear()
        sight = Sight.of(here, part, PORTS, through)
    except UnstableLoopError:
        return None
    shapes = Shapes.of(sight, part)
    spread = 1.0 if part.noise_is_measured else float(np.mean(part.spectrum.spread))
    found = [(port, term) for port in PORTS for term in shapes.terms(port) if term.kind != "linear"]
    port, term = max(found, key=lambda own: own[1].score)
    degrees = len(term.coefficients)
    return Criterion(
        "shape",
        term.score / spread / degrees,
        degrees,
        trials=len(found),
        least=least / spread / degrees,
        where=Where(record=part.record.name),
        values={"port": port, "kind": term.kind, "shape": term.shape, "score": term.score / spread},
    )


def _beginning(part: RecordLines, model: Model) -> RecordLines:
    """The first `LONGEST` samples of a record without periods that has more."""
    if part.noise_is_measured or part.record.samples <= LONGEST:
        return part
    return RecordLines(model, Measured(part.record.rows(0, LONGEST)), part.tones, angles=part.angles)
