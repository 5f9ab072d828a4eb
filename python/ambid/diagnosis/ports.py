"""Where in the loop does something act that the model lacks: the signal that a port would need, and its shape.

The residual on the excited lines is mapped back through the closed loop to a force at each magnet, a current at each
amplifier, or a displacement at each sensor. The port type that needs nothing beyond noise in the other directions is
where the missing physics acts; its needed signal, averaged over the periods, against s, ds/dt and i is its shape, which
is measured beside the base parameters and taken anew.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects import MeasuredShape
from ambid.errors import ModelError
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import ROUGHLY
from ambid.noise import Comparison
from ambid.noise.inlets import Sight
from ambid.noise.shapes import NoShapes, Shapes, Term
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread

PORTS = {
    "force": ("f", "N", "force at the magnets, whatever its cause: magnet, seal, rotor"),
    "current": ("i_ref", "A", "current at the amplifiers, command included"),
    "sensor": ("y", "m", "displacement at the sensors"),
    "reading": ("i_c", "A", "reading of the current alone"),
}
VOLTAGE = {"current": ("i_ref", "V", "voltage of the coils, command included")}
"""The same port where the command is a voltage."""
RIVAL = 30.0
"""Times what the best port leaves, to first order: what leaves more is no rival, however the parameters are bent."""


@dataclass(frozen=True)
class Port:
    """What one type of port would need so that the model meets the measurement.

    Attributes
    ----------
    name, unit, meaning : str
        force, current, sensor or reading.
    misfit : float
        J/dof that is left when this port is given whatever it needs: 1 where the missing physics acts; NaN where the
        port could explain anything, since there are no more channels than axes.
    free : int
        Degrees of freedom of that misfit.
    needed : ndarray, shape (N, axes)
        The needed signal over one period, in `unit`, mean over the periods of the record; of a frequency response,
        which has no signal, N is 0.
    against : dict of str to ndarray, shape (N, axes)
        ``s`` [m], ``v`` [m/s], ``i_f`` [A], ``i_ref`` [A] and ``y`` [m] of the model over the same period.
    terms : tuple of Term
        Shapes that the needed signal may have, the best first.
    weights : callable
        Least squares in units of noise, beside the parameters of the model: given signals over one period, shape
        (N, axes, k), the k weights at which they act at this port, and the part of the excess misfit that they explain.
        What is known of the weights beforehand are rows of k columns and what they should give, in standard deviations.
    share : float
        Part of the excess misfit that a signal at this port explains, whatever its shape.
    """

    name: str
    unit: str
    meaning: str
    misfit: float
    free: int
    needed: FloatArray
    against: dict[str, FloatArray]
    terms: tuple[Term, ...]
    weights: Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, float]] = field(repr=False, compare=False)
    share: float = 1.0


def needed_at_ports(comparison: Comparison, index: int = 0) -> tuple[Port, ...]:
    """Every port type with the signal that it would need, best first.

    Parameters
    ----------
    comparison : Comparison
        Of a fitted model; its nonlinear effects are linearised at rest in the way back to the port.
    index : int
        Of the record that is looked at.
    """
    part, rig = comparison.noise.parts[index], comparison.model.rig
    model, seen = comparison.model.at(part.record), _seen(part.record.channels, rig)
    if not (part.is_in_time or model.is_linear):
        model = model.without_nonlinear()
    sight = Sight.of(model, part, {name: signal for name, (signal, _, _) in seen.items()})
    shapes = Shapes.of(sight, part) if part.is_in_time else NoShapes(len(rig.axes), {})
    first = {name: sight.left_by(name) for name in seen}
    near = RIVAL * min(left.cost for left in first.values())
    found = []
    for name, (_, unit, meaning) in seen.items():
        left = sight.unbent(name, first[name]) if first[name].cost < near else first[name]
        misfit = left.cost / left.free if left.free > 0 else np.nan
        share = _share(sight.cost - sight.judged, left.cost - left.free)
        needed, terms, weights = shapes.needed(left), shapes.terms(name), partial(shapes.weights, name)
        found.append(Port(name, unit, meaning, misfit, left.free, needed, shapes.against, terms, weights, share))
    return tuple(sorted(found, key=_by_misfit_then_shape))


def _share(excess: float, left: float) -> float:
    """Part of what is more than noise that is gone with a signal."""
    return float(np.clip(1.0 - left / excess, 0.0, 1.0)) if excess > 0.0 else 0.0


def _seen(channels: Sequence[str], rig: Rig) -> dict[str, tuple[str, str, str]]:
    """The ports of which what was recorded shows something: no reading of a current that was not recorded."""
    ports = PORTS if rig.amplifier.resistance is None else PORTS | VOLTAGE
    return {
        name: own
        for name, own in ports.items()
        if name != "reading" or any(channel.startswith("i_c.") for channel in channels)
    }


def _by_misfit_then_shape(port: Port) -> tuple[float, float]:
    """Ports that leave about as little are ordered by how much of it a simple shape explains."""
    left = 1.0 if np.isnan(port.misfit) else max(port.misfit, 1.0)
    return round(np.log(left) / 0.2), -port.terms[0].score if port.terms else 0.0


@with_one_blas_thread
def measured_shape(
    comparison: Comparison, port: str = "force", over: str | None = None, rounds: int = 3
) -> MeasuredShape:
    """The shape of the signal that a port needs, so that the model meets the first record; its factor is 1.

    Parameters
    ----------
    comparison : Comparison
        Of a fitted model.
    port : {"force", "current", "sensor", "reading"}
    over : str, optional
        Signal of the loop that it is a function of; default: the one over which it explains most.
    rounds : int
        So often is it taken from the port.

    Returns
    -------
    MeasuredShape
        An effect; the values of the model's parameters beside it are those of an identification with it.

    Raises
    ------
    ModelError
        If there is no such port, or it needs nothing.
    """
    record = comparison.noise.records[0]
    if record.period is not None and record.periods > 2:  # a shape is a mean over all samples: more say little more
        record = record.rows(0, 2 * record.period)
    base = fit = Comparison(comparison.model, [record])
    shape: MeasuredShape | None = None
    for k in range(rounds):
        ports = {own.name: own for own in needed_at_ports(fit)}
        if port not in ports:
            raise ModelError(f"port {port}: expected one of {', '.join(ports)}")
        shape = MeasuredShape.from_port(ports[port], over, shape)
        if k + 1 < rounds:
            fit = _fitted(base, shape)
            factor = fit.model.parameters[fit.model.names.index(shape.slot("factor"))].value
            shape = shape.times(factor)
    if shape is None:
        raise ModelError(f"rounds = {rounds}; expected 1 or more")
    return shape


def _fitted(base: Comparison, shape: MeasuredShape) -> Comparison:
    """The base parameters and the factor of a shape, the rig file's values as they are."""
    model = base.model.add(shape, {"factor": 1.0}).with_substeps(1)
    problem = WhitenedProblem(model, base.noise, model.free, roughly=True)
    own = [model.parameters[i] for i in problem.free]
    lower, upper, at = np.array([(p.lower, p.upper, p.value) for p in own]).T / problem.scale
    end = problem.descend(at, (lower, upper), 8, ROUGHLY)  # it need not end, as the shape is taken anew
    if end.status == "stopped":
        raise KeyboardInterrupt from None
    return base.of(model.with_theta(end.theta))
