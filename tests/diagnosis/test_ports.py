"""The port at which something acts leaves noise alone, once the known parameters that it had bent are refitted."""

import numpy as np
import pytest

from ambid import identify, localise
from ambid.noise.inlets import Sight
from hidden.experiment import experiment
from tiers import first_fast


@pytest.mark.parametrize(
    ("effect", "port", "not_at"),
    first_fast(
        [
            ("cubic_bearing_force", "force", {"current", "reading"}),
            ("loop_delay", "current", {"force", "sensor"}),
            ("flux_saturation", "force", {"current", "reading"}),
            ("back_emf", "current", {"force", "sensor", "reading"}),
        ],
    ),
)
def test_the_port_of_a_large_effect_leaves_noise_and_is_named(effect, port, not_at):
    """By the derivatives at the bent values the force port left 2.4 of saturation, and induced voltage was misread."""
    rig, train, _, _ = experiment(effect, "large", 777, kind="compressor")
    where = localise(identify(rig, train).comparison)
    left = {own.name: own.misfit for own in where.ports}
    # a voltage between the samples is no held current
    assert left[port] < (2.0 if effect == "back_emf" else 1.05), left
    likely = {own.name for own in where.likely}
    assert port in likely, left
    assert not likely & not_at, left


def test_a_port_and_the_parameters_leave_what_least_squares_over_both_leave(demo_estimate, demo_record):
    """The signal on every line and the parameters on all, in one dense problem of a few lines."""
    fit = demo_estimate.comparison
    sight = Sight.of(fit.model.at(demo_record), fit.noise.parts[0], {"force": "f", "current": "i_ref"})
    few = slice(0, 400, 16)
    short = Sight(
        sight.model, sight.part, sight.signals, sight.numbers, sight.residual[few], sight.slopes[few], sight.ways[few]
    )
    lines, channels, q = short.slopes.shape
    way, left = short.way("current"), short.left_by("current")
    axes = way.shape[2]
    dense = np.zeros((lines, channels, 2, lines, axes, 2))
    for k in range(lines):
        dense[k, :, 0, k, :, 0], dense[k, :, 0, k, :, 1] = way[k].real, -way[k].imag
        dense[k, :, 1, k, :, 0], dense[k, :, 1, k, :, 1] = way[k].imag, way[k].real
    rows = 2 * lines * channels
    known = np.stack([short.slopes.real, short.slopes.imag], axis=2).reshape(rows, q)
    both = np.hstack([dense.reshape(rows, -1), known / np.linalg.norm(known, axis=0)])
    wanted = np.stack([short.residual.real, short.residual.imag], axis=2).ravel()
    _, _, rank, _ = np.linalg.lstsq(both, wanted, rcond=1e-12)
    cost = np.sum((wanted - both @ np.linalg.lstsq(both, wanted, rcond=1e-12)[0]) ** 2)
    assert left.cost == pytest.approx(cost, rel=1e-8)
    assert left.free == rows - rank
