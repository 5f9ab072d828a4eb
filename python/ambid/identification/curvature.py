"""Does the curvature of a single magnet's force law count in a fit of its linearisation?

The pull of one magnet goes with ((i0 + i)/(s0 - s))^2. Of a pair that pulls against each other the even orders cancel;
of a single magnet they do not, and a step moves its K_i and K_s by as much, in parts, as it moves the gap. The fit is
done once more with the law in place of its slopes: how far the parameters move then, and whether J falls, decides.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects import Seen
from ambid.effects.magnet import ForceNonlinearity
from ambid.errors import ModelError, UnstableLoopError
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.minimum import SUBSTEPS, WhitenedProblem
from ambid.identification.problem import ROUGHLY, Limits
from ambid.noise import Adequacy, Comparison, Criterion

SEEN = 12.0
"""Fall of J by which records distinguish the law from its slopes, with no parameter more. Of two models that differ by
the mean lambda, the right one has the larger J by as much as f with a chance that is largest at lambda = f: that of
sqrt(f) standard deviations, three and a half of them."""
MATTERS = 0.5
"""Standard errors by which a parameter must move to be reported: less widens no interval by more than an eighth."""
MOVES = "y moves by {travel:.2g|%} of the gap and i_c by {swing:.2g|%} of the bias, and the force of a single magnet "
BY_LAW = "by the law {by_law:.4g} instead of {by_slopes:.4g}, and the intervals are widened by the difference"
SHOWN = Kind(
    "curved_force",
    "warning",
    f"{MOVES}is curved, as these records show: with its square law J/dof is {{misfit_by_law:.3g}}; {BY_LAW}",
)
POSSIBLE = Kind(
    "curved_force_possible",
    "warning",
    f"{MOVES}is curved, which these records neither show nor exclude; {BY_LAW}",
)


@dataclass(frozen=True)
class Curvature:
    """The fit with the law of a single magnet, beside that of its slopes.

    Attributes
    ----------
    values : dict of str to (float, float)
        Free parameters in the fit of the slopes, and in that of the law.
    shift : ndarray, shape (free,)
        First less second.
    travel, swing : float
        Largest departure of y and of i_c from where a record begins, over the air gap and over the bias current.
    misfits : tuple of float
        J/dof of both fits.
    fall : float
        Of J by the law, over J/dof where that is above 1.
    """

    values: dict[str, tuple[float, float]]
    shift: FloatArray
    travel: float
    swing: float
    misfits: tuple[float, float]
    fall: float

    @property
    def is_seen(self) -> bool:
        """Whether the records distinguish the law from its slopes."""
        return self.fall > SEEN

    def finding(self) -> Finding:
        """What is to be known beside the estimate."""
        return (SHOWN if self.is_seen else POSSIBLE)(
            NOWHERE,
            travel=self.travel,
            swing=self.swing,
            misfit=self.misfits[0],
            misfit_by_law=self.misfits[1],
            by_law={name: law for name, (_, law) in self.values.items()},
            by_slopes={name: slope for name, (slope, _) in self.values.items()},
        )


def with_curvature(adequacy: Adequacy, found: Curvature | None) -> Adequacy:
    """The tests of a fit beside that of what the law of a single magnet would change, where it was asked."""
    if found is None:
        return adequacy
    return adequacy.beside(Criterion("curvature", max(0.0, found.fall), 1.0, trials=0.5, least=SEEN))


def curvature(comparison: Comparison, free: Sequence[int], limits: Limits, covariance: FloatArray) -> Curvature | None:
    """Fit the law of a single magnet, if the records are of one, from where its slopes were fitted.

    Parameters
    ----------
    comparison : Comparison
        Of a linear model at its fit.
    free : sequence of int
        What was fitted.
    limits : tuple of ndarray
        Bounds of these parameters over their scales.
    covariance : ndarray, shape (free, free)
        Of the fit.

    Returns
    -------
    Curvature or None
        None where no single magnet is seen, where the records exclude its curvature, or where they neither show it nor
        leave it room to move a parameter.
    """
    law = _law(comparison)
    if law is None:
        return None
    slopes, noise, at = comparison.model, comparison.noise, list(free)
    try:
        model = slopes.add(law, {p.name: p.probe for p in law.parameters(slopes.rig)}).with_substeps(SUBSTEPS)
        problem = WhitenedProblem(model, noise, at)
        # of the fit with the law; it starts near its end
        end = problem.descend(model.theta[at] / problem.scale, limits, 30, ROUGHLY)
    except (UnstableLoopError, ModelError):
        return None
    if end.status == "stopped":
        raise KeyboardInterrupt from None
    fall, shift = float(comparison.cost - end.cost) / max(1.0, comparison.misfit), slopes.theta[at] - end.theta[at]
    leaves_all = fall <= SEEN and np.all(np.abs(shift) < MATTERS * np.sqrt(np.diag(covariance)))
    if fall < -SEEN or leaves_all:
        return None
    travel, swing = _excursion(comparison)
    return Curvature(
        values={slopes.names[i]: (float(slopes.theta[i]), float(end.theta[i])) for i in at},
        shift=shift,
        travel=travel,
        swing=swing,
        misfits=(comparison.misfit, float(end.cost) / comparison.dof),
        fall=fall,
    )


def _law(comparison: Comparison) -> ForceNonlinearity | None:
    """The law of a single magnet, if the records distinguish it from its slopes and one carries the weight."""
    model, records = comparison.model, comparison.noise.records
    are_driven = all(record.is_in_time and not record.is_free_response for record in records)
    law = ForceNonlinearity()
    if not are_driven or not model.is_linear or law.why_not(model.rig):
        return None
    likeliest, *_ = law.variants(Seen(model.rig, {}, (), comparison.held))
    return likeliest if likeliest.single else None


def _excursion(comparison: Comparison) -> tuple[float, float]:
    """Largest departure of y and of i_c, as simulated, from where a record begins, over gap and bias."""
    found = []
    for own in comparison.records:
        (bearing,) = comparison.model.at(own.record).rig.bearings
        y, i_c = np.nanmax(np.abs(own.simulated - own.simulated[0]), axis=0)[:2]
        found.append((y / bearing.air_gap, i_c / bearing.bias_current))
    travel, swing = np.max(found, axis=0)
    return float(travel), float(swing)
