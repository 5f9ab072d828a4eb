"""Result of a check: what was found wrong with a rig and its records, and both in figures on one page."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ambid.checking.law import Law
from ambid.checking.nominal import NominalLoop
from ambid.findings import SEVERITIES, Finding, WithFindings
from ambid.identification.tolerances import percent
from ambid.noise import noise_ceiling
from ambid.record import FrequencyResponse, Record
from ambid.results import Tabular, plain
from ambid.rig import Rig
from ambid.robustness import sensitivity_peaks, zone_of
from ambid.robustness.sensitivity import BrokenLoop

MOST_LISTED = 15
"""Findings that are printed, at most."""


@dataclass(frozen=True)
class LoopFigures:
    """A rig's nominal loop in figures.

    Attributes
    ----------
    mass : float
        [kg].
    bending_hz : tuple of float
        Free-free frequencies of the kept modes [Hz].
    open_loop_unstable : tuple of float
        Poles with the controller off [1/s].
    gain_factor : float or None
        On all K_i for a stable loop: 1 where the nominal one is; None where none was found. What follows is with it.
    slowest_pole : complex
        Of the closed loop [1/s].
    least_damped : tuple of (float, float)
        Frequency [Hz] and damping ratio of closed-loop modes.
    peak_sensitivity : float
        Largest ``|S|`` of any axis, all other axes closed; NaN for an unstable loop.
    peak_sensitivity_hz, peak_sensitivity_axis : float, str
        Where it is.
    bandwidth_hz : float
        Highest frequency at which an axis follows by more than 0.7.
    """

    mass: float
    bending_hz: tuple[float, ...]
    open_loop_unstable: tuple[float, ...]
    gain_factor: float | None
    slowest_pole: complex
    least_damped: tuple[tuple[float, float], ...]
    peak_sensitivity: float
    peak_sensitivity_hz: float
    peak_sensitivity_axis: str
    bandwidth_hz: float

    @classmethod
    def of(cls, loop: NominalLoop) -> LoopFigures:
        """Take the figures of a loop."""
        rate, hz = loop.rig.sample_rate, loop.rotor.frequencies_rad_s / (2.0 * np.pi)
        rigid = loop.rotor.shapes[:, hz == 0.0]
        translation, *_ = np.linalg.lstsq(rigid, np.ones(len(rigid)), rcond=None)
        swinging = loop.poles[loop.poles.imag > 0.0]
        damping = -swinging.real / np.abs(swinging)
        modes = dict.fromkeys(
            (float(f"{swinging[k].imag / (2 * np.pi):.4g}"), float(f"{damping[k]:.2g}")) for k in np.argsort(damping)
        )
        open_poles = loop.open_poles[loop.open_poles.real > 1e-6 * np.abs(loop.open_poles).max()]
        f = np.union1d(np.geomspace(min(1.0, 0.01 * rate), 0.4 * rate, 500), swinging.imag / (2.0 * np.pi))
        f = f[f <= 0.4 * rate]
        sensitivity = BrokenLoop(loop.model, "controller").sensitivity(loop.model.theta, f)
        follows = f[(np.abs(1.0 - np.einsum("ljj->lj", sensitivity)) > 0.7).any(axis=1)]
        stable = loop.gain_factor is not None
        peak, at_hz = sensitivity_peaks(loop.model) if stable else (np.array([np.nan]),) * 2
        worst = int(np.argmax(peak))
        return cls(
            mass=float(translation @ translation),
            bending_hz=tuple(hz[hz > 0.0].tolist()),
            open_loop_unstable=tuple(sorted(open_poles.real.tolist())),
            gain_factor=loop.gain_factor,
            slowest_pole=complex(loop.poles[0]),
            least_damped=tuple(modes)[:3],
            peak_sensitivity=float(peak[worst]),
            peak_sensitivity_hz=float(at_hz[worst]),
            peak_sensitivity_axis=loop.rig.axes[worst],
            bandwidth_hz=float(follows.max(initial=0.0)),
        )

    @property
    def zone(self) -> str:
        """Zone of the peak sensitivity, A to D (ISO 14839-3); empty for an unstable loop."""
        return "" if np.isnan(self.peak_sensitivity) else zone_of(self.peak_sensitivity)


@dataclass(frozen=True)
class RecordFigures:
    """A record in figures; values per axis in the rig's order, means removed.

    Attributes
    ----------
    name : str
    samples : int
    seconds : float
    period_samples : int or None
    periods : int
    i_e_amplitude : float
        Largest deviation from the mean on any axis, in `i_e_unit`.
    i_e_unit : str
        A, or V of voltage-driven coils.
    y_rms : tuple of float
        [m].
    share_of_gap : float
        Largest deviation of y from its mean over the air gap of its bearing.
    i_c_rms : tuple of float, or None
        [A].
    noise_ceiling_percent : dict of str to float
    """

    name: str
    samples: int
    seconds: float
    period_samples: int | None
    periods: int
    i_e_amplitude: float
    i_e_unit: str
    y_rms: tuple[float, ...]
    share_of_gap: float
    i_c_rms: tuple[float, ...] | None
    noise_ceiling_percent: dict[str, float]

    @classmethod
    def of(cls, record: Record, rig: Rig) -> RecordFigures:
        """Take the figures of a record of this rig, with i_e."""
        gaps = np.array([bearing.air_gap for bearing in rig.bearings for _ in bearing.axes])
        i_e = np.asarray(record.i_e)
        return cls(
            name=record.name,
            samples=record.samples,
            seconds=record.seconds,
            period_samples=record.period,
            periods=record.periods,
            i_e_amplitude=float(np.abs(i_e - i_e.mean(axis=0)).max()),
            i_e_unit=rig.amplifier.command_unit,
            y_rms=tuple(record.y.std(axis=0).tolist()),
            share_of_gap=float((np.abs(record.y - record.y.mean(axis=0)) / gaps).max()),
            i_c_rms=None if record.i_c is None else tuple(record.i_c.std(axis=0).tolist()),
            noise_ceiling_percent=noise_ceiling(record),
        )

    def line(self) -> str:
        """One line of text."""
        period = f"{self.periods} x {self.period_samples}" if self.period_samples else "no period"
        i_c = "no i_c" if self.i_c_rms is None else f"i_c {max(self.i_c_rms):.3g} A"
        text = (
            f"  {self.name}: {self.samples} samples, {self.seconds:.3g} s, {period}; "
            f"i_e {self.i_e_amplitude:.3g} {self.i_e_unit}, "
        )
        text += f"y {1e6 * max(self.y_rms):.3g} um rms (peak {percent(self.share_of_gap)} % of the gap), {i_c}"
        ceiling = [value for name, value in self.noise_ceiling_percent.items() if name.startswith("y.")]
        return text if np.isnan(ceiling).any() else f"{text}; noise ceiling of y {min(ceiling):.1f} %"


@dataclass(frozen=True)
class ResponseFigures:
    """Frequency responses in figures.

    Attributes
    ----------
    name : str
    frequencies : int
    band_hz : tuple of (float, float)
        Lowest and highest of them.
    outputs, inputs : tuple of str
    relative_std : dict of str to float
        Median of the std over the magnitude, by pair; NaN of one that was not measured.
    """

    name: str
    frequencies: int
    band_hz: tuple[float, float]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    relative_std: dict[str, float]

    @classmethod
    def of(cls, response: FrequencyResponse) -> ResponseFigures:
        """Take the figures of measured responses."""
        known = response.measured.reshape(len(response.frequency_hz), -1)
        h, std = (np.abs(table).reshape(known.shape) for table in (response.response, response.std))
        ratios = [std[own, k] / h[own, k] for k, own in enumerate(known.T)]
        relative = [float(np.median(own)) if len(own) else np.nan for own in ratios]
        return cls(
            name=response.name,
            frequencies=len(response.frequency_hz),
            band_hz=(float(response.frequency_hz[0]), float(response.frequency_hz[-1])),
            outputs=response.outputs,
            inputs=response.inputs,
            relative_std=dict(zip(response.pairs, relative, strict=True)),
        )

    def line(self) -> str:
        """One line of text."""
        low, high = self.band_hz
        text = f"  {self.name}: frequency response, {self.frequencies} frequencies from {low:.4g} to {high:.4g} Hz; "
        worst = max((std, pair) for pair, std in self.relative_std.items() if not np.isnan(std))
        text += f"{', '.join(self.outputs)} by {', '.join(self.inputs)}; "
        return text + f"median std {percent(worst[0])} % of {worst[1]}"


@dataclass(frozen=True, repr=False)
class Soundness(WithFindings, Tabular):
    """Result of `check`.

    Attributes
    ----------
    rig : str
        Its name.
    machine : str
        Axes, sample rate and controller in one line.
    loop : LoopFigures
    records : tuple of RecordFigures
    findings : tuple of Finding
        Worst first.
    laws : dict of str to tuple of Law
        By record whose command was recorded: the law that its controller runs.
    responses : tuple of ResponseFigures
        Of frequency responses, which are listed with their own findings.
    """

    rig: str
    machine: str
    loop: LoopFigures
    records: tuple[RecordFigures, ...]
    findings: tuple[Finding, ...]
    laws: dict[str, tuple[Law, ...]] = field(default_factory=dict)
    responses: tuple[ResponseFigures, ...] = ()

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that make every result worthless as things stand."""
        return tuple(finding for finding in self.findings if finding.severity == "error")

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The former name of `errors`.

        .. deprecated:: 0.2
        """
        warnings.warn("Soundness.faults is now Soundness.errors; it goes in 1.0", DeprecationWarning, stacklevel=2)
        return self.errors

    @property
    def is_sound(self) -> bool:
        """Whether there is no error."""
        return not self.errors

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it; null where a figure does not exist."""
        figures = asdict(replace(self, findings=()))
        return {**plain(figures), "is_sound": self.is_sound, **self.findings_as_dict()}

    def table(self) -> dict[str, list[Any]]:
        """Findings, a row each, worst first."""
        return {
            "severity": [finding.severity for finding in self.findings],
            "finding": [finding.line(advises=False) for finding in self.findings],
            "remedy": [finding.remedy for finding in self.findings],
        }

    def summary(self) -> list[str]:
        """Whether it is sound, and the number of findings."""
        counts = [(sum(f.severity == s for f in self.findings), s) for s in SEVERITIES]
        total = ", ".join(f"{n} {s}{'' if n == 1 else 's'}" for n, s in counts if n) or "nothing found"
        return [f"{'sound' if self.is_sound else 'NOT SOUND'}: {total}"]

    def __str__(self) -> str:
        loop = self.loop
        bending = ", ".join(f"{f:.4g}" for f in loop.bending_hz)
        unstable = ", ".join(f"{p:+.4g}" for p in loop.open_loop_unstable)
        damped = ", ".join(f"{f:.4g} Hz ({100 * zeta:.2g} %)" for f, zeta in loop.least_damped) or "none"
        factor = "" if loop.gain_factor in (1.0, None) else f" with all K_i x {loop.gain_factor:g}"
        kept = f"free-free bending {bending} Hz" if bending else "no bending mode in the model"
        lines = [
            f"{self.rig}: {self.machine}",
            f"  rotor {loop.mass:.4g} kg, {kept}",
            f"  controller off: {f'unstable poles {unstable} 1/s' if unstable else 'no unstable pole'}",
            f"  nominal loop{factor}: slowest pole {loop.slowest_pole.real:+.4g} 1/s; least damped {damped}",
        ]
        if loop.zone:
            lines.append(
                f"  peak sensitivity {loop.peak_sensitivity:.2f} at {loop.peak_sensitivity_hz:.3g} Hz on "
                f"{loop.peak_sensitivity_axis}: zone {loop.zone} of ISO 14839-3; bandwidth {loop.bandwidth_hz:.3g} Hz"
            )
        lines += [record.line() for record in self.records]
        lines += [response.line() for response in self.responses]
        lines += [f"  {name}: law of {law.line()}" for name, laws in self.laws.items() for law in laws]
        lines += self.summary()
        for finding in self.findings[:MOST_LISTED]:
            lines.append(f"  {finding.severity}: {finding.line(advises=False)}")
            lines += [f"      -> {finding.remedy}"] if finding.remedy else []
        if len(self.findings) > MOST_LISTED:
            lines.append(f"  and {len(self.findings) - MOST_LISTED} more")
        return "\n".join(lines)
