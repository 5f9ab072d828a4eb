"""Natural frequencies of the closed loop over the speed of rotation, with the direction of their whirl."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.errors import InputError
from ambid.findings import Finding, WithFindings
from ambid.loop.mode import Modes
from ambid.model import Given, Model, as_model
from ambid.results import Tabular, picture, plain, speed_text
from ambid.robustness.eigenvalues import damping_ratio, pole_map
from ambid.robustness.procedure import of_small_motion
from ambid.threads import with_one_blas_thread

SPEEDS = 61
"""Speeds of the diagram: from one to the next a pole stays nearer to itself than to the next one."""
MOST_DAMPED = 0.7
"""Damping ratio from which on a pole has no peak, and no place in the diagram."""
SAME = 0.5
"""Cost above which a pole is not the one of the speed before: a quarter of its size away, or of another shape."""
PLANAR = 0.2
"""Part of the motion that goes one way more than the other, below which a whirl has no direction."""


@dataclass(frozen=True)
class Whirl:
    """A natural frequency that was identified at one speed.

    Attributes
    ----------
    speed : float
        [rad/s]
    frequency_hz, damping : float
    std_error_hz : float
        NaN where the model has no covariance.
    direction : float
        1 with the rotation, -1 against it, 0 in a plane, as all that does not turn.
    """

    speed: float
    frequency_hz: float
    damping: float
    std_error_hz: float
    direction: float


@dataclass(frozen=True)
class Critical:
    """A speed that a natural frequency is the same as, so that unbalance meets it.

    Attributes
    ----------
    speed : float
        [rad/s]
    damping : float
        Ratio; from some 0.3 on nothing is to be feared.
    whirl : str
        Unbalance drives a backward one only where the bearings are not the same in both directions.
    """

    speed: float
    damping: float
    whirl: str

    def line(self) -> str:
        """In words."""
        speed = speed_text(float(f"{self.speed:.4g}"))
        return f"critical speed {speed}, {self.whirl} whirl, damping {self.damping:.3f}"


@dataclass(frozen=True, repr=False, eq=False)
class Campbell(ByValue, Tabular, WithFindings):
    """Result of `campbell`.

    Attributes
    ----------
    model : Model
    speed : ndarray, shape (S,)
        [rad/s]
    frequency_hz, damping, direction : ndarray, shape (S, branches)
        NaN where a branch is damped too much, or is none; direction as of `Whirl`.
    measured : tuple of Whirl
    findings : tuple of Finding
    """

    model: Model
    speed: FloatArray
    frequency_hz: FloatArray
    damping: FloatArray
    direction: FloatArray
    measured: tuple[Whirl, ...]
    findings: tuple[Finding, ...] = ()

    plot = picture("plot_campbell")

    @property
    def whirls(self) -> tuple[str, ...]:
        """Of each branch: forward, backward or planar."""
        turning = self.direction[self.speed > 0.0]
        return tuple(whirl_of(float(np.nanmedian(own))) for own in turning.T)

    @property
    def critical(self) -> tuple[Critical, ...]:
        """Speeds where a branch crosses the frequency of rotation, slowest first."""
        found = []
        for own, damping, whirl in zip(self.frequency_hz.T, self.damping.T, self.whirls, strict=True):
            apart = 2.0 * np.pi * own - self.speed
            for k in np.flatnonzero((apart[:-1] > 0.0) & (apart[1:] <= 0.0)):
                part = apart[k] / (apart[k] - apart[k + 1])
                speed, ratio = (float(v[k] + part * (v[k + 1] - v[k])) for v in (self.speed, damping))
                found.append(Critical(speed, ratio, whirl))
        return tuple(sorted(found, key=lambda own: own.speed))

    def table(self) -> dict[str, list[Any]]:
        """A row each branch and speed."""
        rows = [
            (speed, branch, self.whirls[branch], *values)
            for branch in range(self.frequency_hz.shape[1])
            for speed, *values in zip(
                self.speed.tolist(),
                self.frequency_hz[:, branch].tolist(),
                self.damping[:, branch].tolist(),
                strict=True,
            )
            if np.isfinite(values[0])
        ]
        names = ("speed", "branch", "whirl", "frequency_hz", "damping")
        return {name: [row[k] for row in rows] for k, name in enumerate(names)}

    def summary(self) -> list[str]:
        """Critical speeds, and the findings."""
        lines = [own.line() for own in self.critical]
        reach = speed_text(float(self.speed[-1]))
        return [*(lines or [f"no critical speed up to {reach}"]), *self.finding_lines()]

    def to_json(self) -> dict[str, Any]:
        """Plain data; null where a branch is not."""
        return plain(
            {
                "rig": self.model.rig.name,
                "speed": self.speed.tolist(),
                "branches": [
                    {"whirl": whirl, "frequency_hz": frequency.tolist(), "damping": damping.tolist()}
                    for whirl, frequency, damping in zip(self.whirls, self.frequency_hz.T, self.damping.T, strict=True)
                ],
                "critical": [vars(own) for own in self.critical],
                "measured": [{**vars(own), "whirl": whirl_of(own.direction)} for own in self.measured],
                **self.findings_as_dict(),
            }
        )

    def __str__(self) -> str:
        head = f"{'speed rad/s':>12s} {'Hz':>10s} {'+-':>8s} {'damping':>8s}  whirl"
        lines = ["at the operating points:", head, "-" * len(head)]
        for own in self.measured:
            spread = f"{own.std_error_hz:8.2g}" if np.isfinite(own.std_error_hz) else f"{'-':>8s}"
            lines.append(
                f"{own.speed:12.5g} {own.frequency_hz:10.4f} {spread} {own.damping:8.4f}  {whirl_of(own.direction)}"
            )
        return "\n".join([*lines, "", *self.summary()])


@with_one_blas_thread
def campbell(
    model: Given, speeds: Sequence[float] | None = None, *, measured: Sequence[Model] | None = None
) -> Campbell:
    """Find the natural frequencies of the closed loop over the speed of rotation.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        Nonlinear effects are excluded, which is a finding.
    speeds : sequence of float, optional
        Rising, two or more [rad/s]; default: 0 to a quarter beyond the largest measured one.
    measured : sequence of Model, optional
        Models identified at one speed each, whose poles are to be held against the diagram; default: the model at its
        own operating points.

    Returns
    -------
    Campbell

    Raises
    ------
    InputError
        If the machine has one axis, which cannot whirl, or the speeds do not rise from 0 or more.
    """
    model = as_model(model)
    linear, findings = of_small_motion(model)
    pairs = _planes(linear)
    if not len(pairs):
        where = model.rig.path or model.rig.name
        raise InputError(f"{where}: no bearing has two axes, so that nothing can whirl; look at its poles")
    known = [model] if measured is None else list(measured)
    seen = tuple(own for each in known for own in _identified(each))
    if speeds is None:
        most = max((own.speed for own in seen), default=0.0)
        speed = np.linspace(0.0, 1.25 * most if most > 0.0 else 1000.0, SPEEDS)
    else:
        speed = np.asarray(speeds, dtype=np.float64)
        if speed.ndim != 1 or len(speed) < 2 or not (np.isfinite(speed).all() and speed[0] >= 0.0):
            raise InputError("speeds: expected two or more finite ones [rad/s], from 0 on")
        if not (np.diff(speed) > 0.0).all():
            raise InputError(f"speeds: expected rising ones, found {speed[int(np.argmin(np.diff(speed)) + 1)]:g}")
    tracks = _followed([_modes_at(linear, float(own)) for own in speed])
    shape = (len(speed), len(tracks))
    frequency, damping, direction = (np.full(shape, np.nan) for _ in range(3))
    for branch, track in enumerate(tracks):
        for k, (pole, moved) in track.items():
            frequency[k, branch] = pole.imag / (2.0 * np.pi)
            damping[k, branch] = damping_ratio(np.array([pole]))[0]
            direction[k, branch] = _direction(moved, pairs) if speed[k] else 0.0
    there = np.isfinite(frequency[speed > 0.0]).any(axis=0)
    order = np.argsort(np.nanmin(frequency[:, there], axis=0)) if there.any() else np.array([], dtype=int)
    frequency, damping, direction = (table[:, there][:, order] for table in (frequency, damping, direction))
    return Campbell(model, speed, frequency, damping, direction, seen, tuple(findings))


def whirl_of(direction: float) -> str:
    """In a word."""
    return "planar" if abs(direction) < PLANAR else "forward" if direction > 0.0 else "backward"


def _planes(model: Model) -> list[tuple[int, int]]:
    """Places of y of the two axes of every bearing that has them, among the outputs."""
    outputs = model.loop.outputs
    named = [(f"y.{b.name}_zeta", f"y.{b.name}_eta") for b in model.rig.bearings]
    return [(outputs.index(zeta), outputs.index(eta)) for zeta, eta in named if zeta in outputs and eta in outputs]


def _direction(moved: ComplexArray, pairs: Sequence[tuple[int, int]]) -> float:
    """Of the power of the motion, the part with the rotation less the part against it; eta is ahead of zeta."""
    zeta, eta = moved[[z for z, _ in pairs]], moved[[e for _, e in pairs]]
    forward, backward = (float(np.sum(np.abs(zeta + sign * 1j * eta) ** 2)) for sign in (1, -1))
    total = forward + backward
    return (forward - backward) / total if total > 0.0 else 0.0


def _is_seen(model: Model, poles: ComplexArray | complex) -> NDArray[np.bool_]:
    """Whether a pole swings, and below half the sample rate: beyond are those of a delay, which nothing moves with."""
    rates = np.asarray(poles).imag
    return np.asarray((rates > 0.0) & (rates < np.pi * model.rig.sample_rate))


def _modes_at(model: Model, speed: float) -> Modes:
    """Swinging modes at a speed."""
    here = model.at(model.rig.replace(speed=speed))
    found = here.loop.modes(here.theta)
    swinging = np.isfinite(found.poles) & _is_seen(here, found.poles) & (damping_ratio(found.poles) < MOST_DAMPED)
    shapes = found.shapes * ~found.has_twin  # a mixture of two that are alike turns neither way
    return Modes(found.poles[swinging], shapes[:, swinging], found.slopes[swinging])


def _identified(model: Model) -> Iterator[Whirl]:
    """Natural frequencies at every operating point of a model, each with its standard error."""
    for rig in (model.rig, *model.points):
        here = model.at(rig)
        linear, _ = of_small_motion(here)
        pairs, errors = _planes(linear), pole_map(here)
        modes = linear.loop.modes(linear.theta)
        shapes = modes.shapes * ~modes.has_twin
        for pole, frequency, damping, (spread, _) in zip(
            errors.closed, errors.frequency_hz, errors.damping, errors.std_error, strict=True
        ):
            if _is_seen(here, pole) and damping < MOST_DAMPED:
                moved = shapes[:, int(np.argmin(np.abs(modes.poles - pole)))]
                turned = _direction(moved, pairs) if rig.speed else 0.0
                yield Whirl(rig.speed, float(frequency), float(damping), float(spread), turned)


def _followed(each: Sequence[Modes]) -> list[dict[int, tuple[complex, ComplexArray]]]:
    """Branches, each as pole and shape by the index of the speed: from one speed to the next the nearest, and alike."""
    tracks: list[dict[int, tuple[complex, ComplexArray]]] = []
    last: list[int] = []
    for k, modes in enumerate(each):
        shapes = modes.shapes / np.maximum(np.linalg.norm(modes.shapes, axis=0), np.finfo(float).tiny)
        now = [-1] * len(modes.poles)
        if last:
            poles = np.array([tracks[t][k - 1][0] for t in last])
            before = np.array([tracks[t][k - 1][1] for t in last]).T
            away = np.abs(poles[:, None] - modes.poles) / np.abs(poles)[:, None]
            cost = 2.0 * away + 0.25 * (1.0 - np.abs(before.conj().T @ shapes) ** 2)
            for row, column in zip(*linear_sum_assignment(np.minimum(cost, SAME)), strict=True):
                if cost[row, column] < SAME:
                    now[column] = last[row]
        for column, pole in enumerate(modes.poles):
            if now[column] < 0:
                now[column] = len(tracks)
                tracks.append({})
            tracks[now[column]][k] = (complex(pole), shapes[:, column])
        last = now
    return tracks
