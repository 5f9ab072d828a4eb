"""Result of a check: what was found wrong with a rig and its records, and both in figures on one page."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ambid.checking.figures import LoopFigures, RecordFigures, ResponseFigures
from ambid.checking.law import Law
from ambid.findings import SEVERITIES, Finding, WithFindings
from ambid.results import plain

MOST_LISTED = 15
"""Findings that are printed, at most."""


@dataclass(frozen=True, repr=False)
class Soundness(WithFindings):
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

    def __repr__(self) -> str:
        loop = self.loop
        bending = ", ".join(f"{f:.4g}" for f in loop.bending_hz)
        unstable = ", ".join(f"{p:+.4g}" for p in loop.open_loop_unstable) or "none"
        damped = ", ".join(f"{f:.4g} Hz ({100 * zeta:.2g} %)" for f, zeta in loop.least_damped) or "none"
        factor = "" if loop.gain_factor in (1.0, None) else f" with all K_i x {loop.gain_factor:g}"
        kept = f"free-free bending {bending} Hz" if bending else "no bending mode in the model"
        lines = [
            f"{self.rig}: {self.machine}",
            f"  rotor {loop.mass:.4g} kg, {kept}",
            f"  controller off: unstable poles {unstable} 1/s",
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
        counts = [(sum(f.severity == s for f in self.findings), s) for s in SEVERITIES]
        total = ", ".join(f"{n} {s}{'' if n == 1 else 's'}" for n, s in counts if n) or "nothing found"
        lines.append(f"{'sound' if self.is_sound else 'NOT SOUND'}: {total}")
        for finding in self.findings[:MOST_LISTED]:
            lines.append(f"  {finding.severity}: {finding.line(advises=False)}")
            lines += [f"      -> {finding.remedy}"] if finding.remedy else []
        if len(self.findings) > MOST_LISTED:
            lines.append(f"  and {len(self.findings) - MOST_LISTED} more")
        return "\n".join(lines)
