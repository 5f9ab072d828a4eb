"""The shape of what is missing, measured: taken from a port, fitted beside the base parameters, and taken anew."""

from __future__ import annotations

import numpy as np

from ambid.diagnosis.ports import needed_at_ports
from ambid.effects import MeasuredShape
from ambid.errors import ModelError
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import ROUGHLY
from ambid.noise import Comparison
from ambid.threads import with_one_blas_thread


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
    if record.period is not None and record.periods > 2:
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
    problem = WhitenedProblem(model, base.noise, model.free, roughly=model.without_nonlinear().is_stable)
    own = [model.parameters[i] for i in problem.free]
    lower, upper, at = np.array([(p.lower, p.upper, p.value) for p in own]).T / problem.scale
    end = problem.descend(at, (lower, upper), 8, ROUGHLY)  # it need not end, as the shape is taken anew
    if end.status == "stopped":
        raise KeyboardInterrupt from None
    return base.of(model.with_theta(end.theta))
