"""What an excitation does to a machine before it is played: its peaks against gap, bias and the limits of a person."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import InputError
from ambid.findings import Finding, Kind, Where, WithFindings
from ambid.identification.tolerances import percent
from ambid.model import Given, as_model
from ambid.record.checks import SMALLEST_CHANGE
from ambid.results import Tabular, plain
from ambid.rig import Rig
from ambid.rig.fields import LARGEST_VALUE
from ambid.robustness import ZONES

MOST_OF_POWER = 0.9
"""Part of an excitation's power that its band holds."""

ROUNDED = 1.0 + 1e-9
"""Part of a limit beyond which it is passed: what was scaled to it may be off by rounding."""
ABOVE_LIMIT = Kind(
    "peak_above_limit",
    "warning",
    "reaches {peak:.3g} {unit}[, {share:.3g|%} of the {reference}]; the limit is {limit:.3g} {unit}"
    "[, {limit_share:g|%}]",
)
WITHIN_LIMITS = Kind("peak_within_limits", "note", "a peak of i_e of {peak:.3g} {unit} stays within the limits")


@dataclass(frozen=True)
class Limits:
    """What an excitation may reach.

    Attributes
    ----------
    travel : float
        Largest \\|y\\| over the air gap; the force law is linear to a per cent up to the default.
    current : float
        Largest \\|i_c\\| over the bias current, likewise; the magnet pulls with bias and control current.
    excitation : float or None
        Largest \\|i_e\\| [A], or [V] of voltage-driven coils.
    slew_rate : float or None
        Largest slope of i_c [A/s]: what the supply's voltage leaves over the inductance of the coil.
    sensitivity : float
        Peak sensitivity of the loop, which no excitation changes, above which a design warns: that of zone A.
    """

    travel: float = 0.05
    current: float = 0.2
    excitation: float | None = None
    slew_rate: float | None = None
    sensitivity: float = ZONES[0][0]

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not SMALLEST_CHANGE <= value <= LARGEST_VALUE:
                raise InputError(
                    f"limit {name} = {value!r}: expected a number from {SMALLEST_CHANGE:g} to {LARGEST_VALUE:g}"
                )

    def of(self, rig: Rig) -> dict[str, FloatArray]:
        """By signal what is allowed on each axis, SI units, shape (axes,)."""
        each = [bearing for bearing in rig.bearings for _ in bearing.axes]
        allowed = {
            "y": self.travel * np.array([bearing.air_gap for bearing in each]),
            "i_c": self.current * np.array([bearing.bias_current for bearing in each]),
        }
        if self.excitation is not None:
            allowed["i_e"] = np.full(len(each), self.excitation)
        if self.slew_rate is not None:
            allowed["slope"] = np.full(len(each), self.slew_rate)
        return allowed


@dataclass(frozen=True)
class Peaks:
    """Largest values on one axis.

    Attributes
    ----------
    axis : str
    i_e : float
        [A], or [V] of voltage-driven coils.
    i_c : float
        [A].
    slope : float
        Of i_c, from sample to sample [A/s].
    y : float
        [m].
    i_c_over_bias, y_over_gap : float
    """

    axis: str
    i_e: float
    i_c: float
    slope: float
    y: float
    i_c_over_bias: float
    y_over_gap: float


@dataclass(frozen=True, repr=False)
class Forecast(Tabular, WithFindings):
    """What an excitation is and does; result of `forecast`.

    Attributes
    ----------
    sample_rate : float
        [Hz].
    period, periods : int
        Samples per period, and how many.
    line_spacing_hz : float
    band_hz : (float, float)
        From the lowest excited line to the frequency below which nine tenths of the power of i_e are.
    unit : str
        Of i_e.
    axes : tuple of Peaks
    load : float
        Largest peak over its limit: 1 is just allowed.
    limits : Limits
    findings : tuple of Finding
        Limits that are exceeded, and the peak that is not.
    """

    sample_rate: float
    period: int
    periods: int
    line_spacing_hz: float
    band_hz: tuple[float, float]
    unit: str
    axes: tuple[Peaks, ...]
    load: float
    limits: Limits
    findings: tuple[Finding, ...] = ()

    @property
    def seconds(self) -> float:
        """Length."""
        return self.period * self.periods / self.sample_rate

    def table(self) -> dict[str, list[Any]]:
        """An axis a row."""
        return {key: [getattr(own, key) for own in self.axes] for key in Peaks.__dataclass_fields__}

    def summary(self) -> list[str]:
        """Length, band, and which limits are exceeded."""
        return [
            f"{self.periods} periods of {self.period} samples at {self.sample_rate:g} Hz: {self.seconds:.3g} s; a line "
            f"every {self.line_spacing_hz:.3g} Hz, most of the power from {self.band_hz[0]:.3g} to "
            f"{self.band_hz[1]:.4g} Hz",
            *self.finding_lines(),
        ]

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return plain({**asdict(replace(self, findings=())), "seconds": self.seconds, **self.findings_as_dict()})

    def __str__(self) -> str:
        lines = self.summary()[:1]
        lines.append(f"{'axis':10s} {'i_e peak':>11s} {'i_c peak':>11s} {'of bias':>8s} {'y peak':>11s} {'of gap':>8s}")
        lines += [
            f"{own.axis:10s} {own.i_e:9.4g} {self.unit} {own.i_c:9.4g} A {percent(own.i_c_over_bias):>6s} % "
            f"{1e6 * own.y:8.4g} um {percent(own.y_over_gap):>6s} %"
            for own in self.axes
        ]
        return "\n".join([*lines, *self.finding_lines()])


def forecast(model: Given, i_e: FloatArray, *, period: int | None = None, limits: Limits | None = None) -> Forecast:
    """Tell what an excitation does to a machine that is at rest when it begins.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
    i_e : ndarray, shape (N, axes)
    period : int, optional
        Samples per period; by default all are one period.
    limits : Limits, optional

    Returns
    -------
    Forecast

    Raises
    ------
    InputError
        If the excitation is not so many whole periods.
    UnstableLoopError
        If the model's loop is unstable.
    """
    model = as_model(model)
    rig, limits = model.rig, limits or Limits()
    period = len(i_e) if period is None else period
    if period < 1 or len(i_e) % period:
        raise InputError(f"period = {period}: expected a part of the {len(i_e)} samples of i_e; give whole periods")
    found = model.simulate(i_e)
    i_c = np.asarray(found.i_c)
    largest = {
        "i_e": np.abs(i_e).max(axis=0),
        "i_c": np.abs(i_c).max(axis=0),
        "slope": np.abs(np.diff(i_c, axis=0)).max(axis=0) * rig.sample_rate,
        "y": np.abs(found.y).max(axis=0),
    }
    unlimited = Limits(travel=1.0, current=1.0).of(rig)
    share = {key: largest[key] / unlimited[key] for key in ("y", "i_c")}
    allowed = limits.of(rig)
    power = np.sum(np.abs(np.fft.rfft(i_e[:period], axis=0)) ** 2, axis=1)
    power[0] = 0.0
    spacing = rig.sample_rate / period
    within = np.cumsum(power) / max(power.sum(), np.finfo(float).tiny)
    lowest = int(np.argmax(power > 1e-9 * power.max()))
    axes = tuple(
        Peaks(
            axis,
            **{key: float(own[k]) for key, own in largest.items()},
            i_c_over_bias=float(share["i_c"][k]),
            y_over_gap=float(share["y"][k]),
        )
        for k, axis in enumerate(rig.axes)
    )
    load = max(float((largest[key] / own).max()) for key, own in allowed.items())
    return Forecast(
        sample_rate=rig.sample_rate,
        period=period,
        periods=len(i_e) // period,
        line_spacing_hz=spacing,
        band_hz=(lowest * spacing, int(np.searchsorted(within, MOST_OF_POWER)) * spacing),
        unit=rig.amplifier.command_unit,
        axes=axes,
        load=load,
        limits=limits,
        findings=(*_above(axes, allowed, limits, rig.amplifier.command_unit), *_within(axes, load, rig)),
    )


def _above(axes: tuple[Peaks, ...], allowed: dict[str, FloatArray], limits: Limits, unit: str) -> Iterator[Finding]:
    """Every peak that exceeds its limit."""
    shares = {"y": ("y_over_gap", limits.travel, "air gap"), "i_c": ("i_c_over_bias", limits.current, "bias current")}
    units = {"y": "m", "i_c": "A", "i_e": unit, "slope": "A/s"}
    for k, own in enumerate(axes):
        for signal, limit in allowed.items():
            peak = getattr(own, signal)
            if peak > limit[k] * ROUNDED:
                share, most, reference = shares.get(signal, (None, None, None))
                yield ABOVE_LIMIT(
                    Where(channel=f"{'i_c' if signal == 'slope' else signal}.{own.axis}"),
                    peak=peak,
                    unit=units[signal],
                    limit=float(limit[k]),
                    share=None if share is None else getattr(own, share),
                    limit_share=most,
                    reference=reference,
                )


def _within(axes: tuple[Peaks, ...], load: float, rig: Rig) -> Iterator[Finding]:
    """The peak that would do, where this one does not."""
    if load > ROUNDED:
        # part of the amplitude that would just reach a limit: it is written with three digits
        yield WITHIN_LIMITS(peak=0.995 * max(own.i_e for own in axes) / load, unit=rig.amplifier.command_unit)
