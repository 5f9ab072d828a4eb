"""Margins of a loop: peaks of its sensitivity, their zones after ISO 14839-3, and how sure they are."""

from dataclasses import dataclass, field
from math import atan, degrees, inf, log10
from typing import Any

from ambid.arrays import ByValue, FloatArray
from ambid.findings import Finding, WithFindings
from ambid.model import Model
from ambid.results import Tabular, picture, plain
from ambid.robustness.sensitivity import PLACES, Place

ZONES = ((3.0, "A"), (4.0, "B"), (5.0, "C"), (inf, "D"))
"""Largest peak sensitivity of each zone, ISO 14839-3: 9.5, 12 and 14 dB."""


def zone_of(peak: float) -> str:
    """Zone of a peak sensitivity, A to D (ISO 14839-3); an unstable loop, whose peak is infinite, is in D."""
    return next((zone for most, zone in ZONES if peak < most), ZONES[-1][1])


@dataclass(frozen=True)
class Margin:
    """A peak over frequency, or a disk margin.

    Attributes
    ----------
    value : float
        At the model's values.
    frequency_hz : float
        Where it is.
    ci95 : tuple of float or None
        95 % interval by the draws, infinite (or 0, of a disk margin) at the end that reaches unstable loops; None where
        the model has no covariance.
    std_error : float or None
        By the slope of the peak over the parameters; None also where it has none, of all axes together.
    worst : float or None
        Over the 95 % ellipsoid of the parameters; infinite (0 of a disk margin) where it reaches an unstable loop.
    worst_at : dict of str to float
        The uncertain parameters there.
    """

    value: float
    frequency_hz: float
    ci95: tuple[float, float] | None = None
    std_error: float | None = None
    worst: float | None = None
    worst_at: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON; null where a number is infinite, and whether an unstable loop makes the worst so."""
        reaches = self.worst in (0.0, inf)
        return plain({**vars(self), "ci95": self.ci95 and list(self.ci95), "worst_is_unstable": reaches})


@dataclass(frozen=True)
class AxisMargins:
    """Margins of one axis, with all others closed.

    Attributes
    ----------
    axis : str
    sensitivity : Margin
        Peak of ``|S_jj|``, as ISO 14839-3 measures it.
    disk : Margin
        ``alpha = 1 / max |S_jj - 1/2|``, the symmetric disk margin: the loop stays stable while its gain and phase
        change by any factor ``(1 + d/2) / (1 - d/2)`` with ``|d| < alpha``.
    zone : str
        Of the peak, A to D (ISO 14839-3).
    zone_probability : dict of str to float
        By zone; empty where the model has no covariance. Unstable draws count as D.
    """

    axis: str
    sensitivity: Margin
    disk: Margin
    zone: str
    zone_probability: dict[str, float]


@dataclass(frozen=True, repr=False, eq=False)
class Margins(ByValue, Tabular, WithFindings):
    """Result of `margins`.

    Attributes
    ----------
    model : Model
    at : {"controller", "sensor"}
        Where the loop was broken.
    axes : tuple of AxisMargins
    multivariable : Margin
        Peak of the largest singular value of S.
    disk : Margin
        ``1 / max |S - I/2|`` with the largest singular value: all axes may change by such factors at once, and into
        each other; never more than with factors on each axis alone.
    zone : str
        Of the worst axis.
    zone_probability : dict of str to float
        Of the worst axis of each draw.
    draws, unstable, outside : int
        Loops that were drawn, those of them that are unstable, and draws that were left out since physics does not
        allow them.
    seed : int
    frequency_hz : ndarray, shape (F,)
    sensitivity : ndarray, shape (F, axes)
        ``|S_jj|`` at the model's values.
    band : ndarray, shape (2, F, axes), or None
        Ends of the 95 % interval of ``|S_jj|`` over the stable draws.
    findings : tuple of Finding
    """

    model: Model
    at: Place
    axes: tuple[AxisMargins, ...]
    multivariable: Margin
    disk: Margin
    zone: str
    zone_probability: dict[str, float]
    draws: int
    unstable: int
    outside: int
    seed: int
    frequency_hz: FloatArray
    sensitivity: FloatArray
    band: FloatArray | None
    findings: tuple[Finding, ...] = ()

    plot = picture("plot_sensitivity")

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return {
            "rig": self.model.rig.name,
            "at": self.at,
            "zone": self.zone,
            "zone_probability": self.zone_probability,
            "axes": {
                own.axis: {
                    "sensitivity": own.sensitivity.as_dict(),
                    "disk_margin": own.disk.as_dict(),
                    "zone": own.zone,
                    "zone_probability": own.zone_probability,
                }
                for own in self.axes
            },
            "multivariable": self.multivariable.as_dict(),
            "disk_margin": self.disk.as_dict(),
            "draws": self.draws,
            "unstable_draws": self.unstable,
            "draws_outside": self.outside,
            "seed": self.seed,
            "frequency_hz": self.frequency_hz.tolist(),
            "sensitivity": {own.axis: self.sensitivity[:, j].tolist() for j, own in enumerate(self.axes)},
            **self.findings_as_dict(),
        }

    def table(self) -> dict[str, list[Any]]:
        """A row each axis, and one for all together."""
        rows: list[tuple[str, Margin, Margin, str, dict[str, float]]] = [
            (own.axis, own.sensitivity, own.disk, own.zone, own.zone_probability) for own in self.axes
        ]
        rows.append(("all", self.multivariable, self.disk, "", {}))
        return {
            "axis": [name for name, *_ in rows],
            "peak": [peak.value for _, peak, *_ in rows],
            "peak_hz": [peak.frequency_hz for _, peak, *_ in rows],
            "ci95_low": [None if peak.ci95 is None else peak.ci95[0] for _, peak, *_ in rows],
            "ci95_high": [None if peak.ci95 is None else peak.ci95[1] for _, peak, *_ in rows],
            "worst": [peak.worst for _, peak, *_ in rows],
            "zone": [zone for *_, zone, _ in rows],
            "zone_probability": [chance.get(zone) for *_, zone, chance in rows],
            "disk_margin": [disk.value for _, _, disk, *_ in rows],
            "disk_margin_worst": [disk.worst for _, _, disk, *_ in rows],
        }

    def summary(self) -> list[str]:
        """Zone, what the disk margin means, and the findings."""
        worst = max(self.axes, key=lambda own: own.sensitivity.value)
        lines = [f"zone {self.zone} of ISO 14839-3 by {worst.axis}, the loop broken at {PLACES[self.at]}"]
        if self.zone_probability:
            shares = ", ".join(f"{zone} {_percent(share)}" for zone, share in self.zone_probability.items())
            lines.append(f"probability of each zone: {shares} ({self.draws} draws, seed {self.seed})")
        low, high, phase = tolerated(self.disk.value)
        most = f"{high:.3g}" if high < inf else "any"
        allowed = f"gains x {low:.3g} .. {most}, phases +-{phase:.3g} deg"
        lines.append(f"disk margin {self.disk.value:.3g} of all axes at once: {allowed}")
        return [*lines, *self.finding_lines()]

    def __str__(self) -> str:
        head = f"{'axis':14s} {'peak':>6s} {'dB':>6s} {'at Hz':>8s}  {'95 % interval':16s} "
        head += f"{'worst':>8s} {'zone':8s} {'disk':>5s}"
        lines = [head, "-" * len(head)]
        for own in self.axes:
            likely = own.zone_probability.get(own.zone)
            zone = own.zone if likely is None else f"{own.zone} {_percent(likely)}"
            lines.append(_line(own.axis, own.sensitivity, zone, own.disk))
        lines.append(_line("all, sigma_max", self.multivariable, "", self.disk))
        return "\n".join([*lines, "", *self.summary()])


def tolerated(alpha: float) -> tuple[float, float, float]:
    """What a disk margin allows: least and largest factor of the gain, and of the phase [deg] either way."""
    low, high = ((2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha)) if alpha < 2.0 else (0.0, inf)
    return low, high, 2.0 * degrees(atan(alpha / 2.0))


def _line(name: str, peak: Margin, zone: str, disk: Margin) -> str:
    span = "" if peak.ci95 is None else f"{peak.ci95[0]:.3f} .. {_size(peak.ci95[1])}"
    worst = "" if peak.worst is None else _size(peak.worst)
    level = f"{20.0 * log10(peak.value):.1f}"
    return (
        f"{name:14s} {peak.value:6.3f} {level:>6s} {peak.frequency_hz:8.4g}  {span:16s} {worst:>8s} {zone:8s} "
        f"{disk.value:5.3f}"
    ).rstrip()


def _size(peak: float) -> str:
    return f"{peak:.3f}" if peak < inf else "unstable"


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
