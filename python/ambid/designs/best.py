"""The best excitation for a purpose: accuracy of all parameters, a wanted accuracy of some, or sight of an effect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.arrays import ByValue, FloatArray
from ambid.checking import LoopFigures
from ambid.checking.nominal import NominalLoop
from ambid.designs.intervals import FEWEST, Prospect, prospect
from ambid.designs.length import LONGEST, missed, of_signals, periods_of, without_signals
from ambid.designs.options import SIGNALS, Option, Task, compared
from ambid.designs.peaks import Forecast, Limits, forecast
from ambid.designs.sight import Visibility, visible
from ambid.effects import Effect, find
from ambid.errors import InputError, ModelError
from ambid.excitation import MULTISINE, PRBS
from ambid.findings import Finding, Kind, Where, WithFindings
from ambid.identification.estimate import NORMAL_95
from ambid.model import Given, Model, as_model
from ambid.noise.foreseen import Instruments
from ambid.results import Tabular, plain
from ambid.threads import with_one_blas_thread

SENSITIVE = Kind(
    "peaks_uncertain",
    "warning",
    "peak sensitivity {peak:.2f} at {frequency_hz:.3g} Hz (zone {zone} of ISO 14839-3), the limit is {limit:g}: a "
    "small error of the rig file changes the predicted peaks much",
    "begin at a quarter of the amplitude",
)


@dataclass(frozen=True, repr=False, eq=False)
class Design(ByValue, Tabular, WithFindings):
    """An experiment that is worth making; result of `design`.

    Attributes
    ----------
    i_e : ndarray, shape (N, axes)
        To be played.
    option : Option
        The excitation that was chosen, one period.
    options : tuple of Option
        All that were compared, the best first.
    efficiency : float
        Proven part of the best criterion that the powers of the lines reach with as much power; NaN of a sequence.
    forecast : Forecast
        Peaks against limits.
    prospect : Prospect
        Intervals of the parameters.
    wanted : dict of str to float
        Half widths of 95 % intervals that were asked for, SI units.
    visibility : Visibility
        Smallest sizes of effects that the record shows.
    without : dict of str to float
        By further signal, such as ``b``: seconds that the best experiment without it takes for the same accuracy;
        infinite where no length does.
    findings : tuple of Finding
    """

    i_e: FloatArray
    option: Option
    options: tuple[Option, ...]
    efficiency: float
    forecast: Forecast
    prospect: Prospect
    wanted: dict[str, float]
    visibility: Visibility
    without: dict[str, float]
    findings: tuple[Finding, ...]

    @property
    def gain(self) -> float:
        """So many times longer the best binary sequence would take; NaN where none was compared."""
        return min((own.cost for own in self.options if own.signal == PRBS), default=np.nan) / self.option.cost

    def table(self) -> dict[str, list[Any]]:
        """A parameter a row: the interval that is foreseen, and what was asked for."""
        return self.prospect.table() | {"wanted": [self.wanted.get(name) for name in self.prospect.parameters]}

    def summary(self) -> list[str]:
        """The excitation, its length, and what it gains."""
        made = ", ".join(f"{key} {value:.4g}" for key, value in self.option.settings.items())
        lines = [f"{self.option.signal} ({made} {self.forecast.unit}), {self.forecast.seconds:.3g} s"]
        if self.option.signal == MULTISINE:
            lines[0] += f"; its powers are proven to be within {100 * (1 / self.efficiency - 1):.2g} % of the best"
            if np.isfinite(self.gain):
                lines.append(f"the best binary sequence within the same limits takes {self.gain:.2g} times as long")
        return [*lines, *self.finding_lines()]

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return plain(
            {
                "signal": self.option.signal,
                "settings": self.option.settings,
                "efficiency": self.efficiency,
                "time_of_best_prbs": self.gain,
                "forecast": self.forecast.to_json(),
                **self.prospect.to_json(),
                "wanted": self.wanted,
                "seconds_without": self.without,
                "options": [{"signal": o.signal, **o.settings, "cost": o.cost} for o in self.options],
                "effects": [own.as_dict() for own in self.visibility.effects],
                "not_shown": self.visibility.not_shown,
                **self.findings_as_dict(),
            }
        )

    def __str__(self) -> str:
        lines = [*self.summary(), str(self.forecast), str(self.prospect)]
        if self.visibility.effects:
            lines.append(f"{'effect':24s} {'smallest size that half of such records show':46s} looks like")
        for own in self.visibility.effects:
            size = f"{own.parameter} {own.size:.3g} {own.unit}" if np.isfinite(own.size) else "none that is allowed"
            twins = [f"{n} ({self._apart(own.typical * f, own.unit)})" for n, f in own.twins.items()]
            lines.append(f"{own.effect:24s} {size:46s} {', '.join(twins)}".rstrip())
        return "\n".join(lines)

    @staticmethod
    def _apart(size: float, unit: str) -> str:
        return f"apart from {size:.3g} {unit} on" if np.isfinite(size) else "never apart"


@with_one_blas_thread
def design(
    model: Given,
    instruments: Instruments,
    *,
    accuracy: Mapping[str, float | str] | None = None,
    effects: Sequence[Effect | str] = (),
    limits: Limits | None = None,
    seconds: float | None = None,
    signal: str | None = None,
    spread: float = 0.05,
) -> Design:
    """Find the excitation that brings most information within limits.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        What the machine is taken to be: the best powers are those at its values.
    instruments : Instruments
        Noise, stated or of a record.
    accuracy : mapping of str to float or str, optional
        Half width of the 95 % interval that is wanted, by name or pattern: a number in SI units, or a share such as
        ``"1%"``. By default the confidence region of all parameters is to be small.
    effects : sequence of Effect or str
        Effects that are to be seen: their sizes are to be known best, beside all parameters.
    limits : Limits, optional
    seconds : float, optional
        Longest record; by default as long as the wanted accuracy needs, else eight periods.
    signal : {"prbs", "multisine"}, optional
        By default the better of both.
    spread : float
        Part of a multisine's power that all lines share, 0 to 1: the best powers are on few lines, and show nothing of
        a model's misfit.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If an argument is out of its range, or no excitation determines all parameters.
    ModelError
        If a name is unknown, or an effect makes no sense on this rig or is nonlinear: information about it is no matter
        of powers.
    UnstableLoopError
        If the model's loop is unstable.
    """
    base = as_model(model)
    limits = limits or Limits()
    _require(signal, spread, seconds)
    full, free = _with_sizes(base.exact(), effects)  # powers are a matter of what noise makes uncertain
    known = Model(base.rig, full.parameters, full.effects)
    wanted = _half_widths(full, accuracy or {})
    weights = _weights(full, base, free, wanted)
    scale = np.array([full.parameters[k].scale for k in free])
    period = _period(base, seconds)
    task = Task(full, free, scale, weights, instruments, limits, period, spread)
    options, efficiency = compared(task, signal)
    chosen = options[0]
    periods, findings = periods_of(task, chosen, known, wanted, seconds)
    i_e = np.tile(chosen.wave, (periods, 1))
    period = len(chosen.wave)
    # a start may last longer than was looked at
    i_e /= max(1.0, forecast(base, i_e, period=period, limits=limits).load)
    expected = prospect(known, i_e, period=period, instruments=instruments)
    shown = visible(prospect(base, i_e, period=period, instruments=instruments).comparison)
    others = without_signals(task, signal, known, wanted, expected)
    return Design(
        i_e=i_e,
        option=chosen,
        options=tuple(options),
        efficiency=efficiency if chosen.signal == MULTISINE else np.nan,
        forecast=forecast(base, i_e, period=period, limits=limits),
        prospect=expected,
        wanted=wanted,
        visibility=shown,
        without=others,
        findings=(
            *findings,
            *missed(expected, wanted, findings),
            *of_signals(task, chosen, known, wanted, expected, others),
            *_sensitive(base, limits),
        ),
    )


def _require(signal: str | None, spread: float, seconds: float | None) -> None:
    if signal not in (None, *SIGNALS):
        raise InputError(f"signal = {signal!r}: allowed are {' and '.join(SIGNALS)}")
    if not 0.0 <= spread <= 1.0:
        raise InputError(f"spread = {spread!r}: expected a part of the power, from 0 to 1")
    if seconds is not None and not 0.0 < seconds <= LONGEST:
        raise InputError(f"seconds = {seconds!r}: expected more than 0, and {LONGEST:g} at the most")


def _with_sizes(base: Model, effects: Sequence[Effect | str]) -> tuple[Model, list[int]]:
    """The model with effects as small as they may be, and the parameters that move its response there."""
    full = base
    for effect in effects:
        own = find(effect) if isinstance(effect, str) else effect
        home = full.home_of(own)
        smallest = {} if home is None else {p.name: _smallest(p.lower, p.upper, p.probe) for p in own.parameters(home)}
        full = full.add(own, smallest)
    if not full.is_linear:
        raise ModelError(
            "the model or an effect is nonlinear, and what a record shows of it is no matter of the powers of lines; "
            "design for the linear part, and see the smallest sizes that are stated there"
        )
    w = np.exp(2j * np.pi * np.linspace(0.001, 0.4, 50))
    u = np.ones((50, full.loop.core.inputs), dtype=complex)
    everything = list(range(len(full.names)))
    slopes = full.loop.core.lines(full.theta, everything, w, u, None, False)[1]
    moves = np.abs(slopes).max(axis=(0, 1)) * [p.scale for p in full.parameters]
    return full, [k for k in everything if moves[k] > 1e-9 * moves.max()]


def _smallest(lower: float, upper: float, typical: float) -> float:
    """Zero where it may be, else the least where that is all but zero, else a typical value."""
    if lower <= 0.0 <= upper:
        return 0.0
    return lower if 0.0 < lower <= 1e-3 * typical else typical


def _half_widths(model: Model, accuracy: Mapping[str, float | str]) -> dict[str, float]:
    """Wanted half width of the interval of each parameter, SI units."""
    found: dict[str, float] = {}
    for pattern, text in accuracy.items():
        share = isinstance(text, str) and text.strip().endswith("%")
        try:
            number = float(str(text).strip().rstrip("%"))
        except ValueError:
            number = np.nan
        if not (np.isfinite(number) and number > 0.0):
            raise InputError(f"accuracy of {pattern} = {text!r}: expected a number above zero, or a share such as '1%'")
        for k in model.index([pattern]):
            parameter = model.parameters[k]
            if share and parameter.name.split(".")[0] in {own.name for own in model.effects}:
                raise InputError(f"accuracy of {parameter.name} = {text!r}: an effect has no value; give SI units")
            half = number / 100.0 * abs(parameter.value) if share else number
            least, most = 1e-15 * parameter.scale, 1e15 * parameter.scale
            if not least <= half <= most:
                allowed = f"{least:.3g} to {most:.3g} {parameter.unit}, half the width of its 95 % interval"
                raise InputError(f"accuracy of {parameter.name} = {text!r}: expected {allowed}")
            found[parameter.name] = half
    return found


def _weights(full: Model, base: Model, free: list[int], wanted: Mapping[str, float]) -> FloatArray | None:
    """C of the A-criterion, relative to the scales: one over the square of what is wanted; typical sizes of effects."""
    aims = dict(wanted)
    for p in full.parameters:
        if p.name not in base.names:
            aims.setdefault(p.name, p.scale)
    if not aims:
        return None
    own = [full.parameters[k] for k in free]
    return np.diag([(p.scale * NORMAL_95 / aims[p.name]) ** 2 if p.name in aims else 0.0 for p in own])


def _period(model: Model, seconds: float | None) -> int:
    """Samples, so that a line lies within the width of every pole, and four periods within the time."""
    rate, width = model.rig.sample_rate, model.decay_rate / np.pi
    least, most = 512, 16384
    if seconds is not None:
        most = min(most, int(seconds * rate / FEWEST))
        if most < 16 * len(model.rig.axes):
            raise InputError(f"seconds = {seconds:g}: {FEWEST} periods of {most} samples are too short; give more")
    if width * most <= rate:  # a pole at zero, or nearly so, has no width
        return most
    return int(min(max(2 ** np.ceil(np.log2(rate / width)), least), most))


def _sensitive(model: Model, limits: Limits) -> tuple[Finding, ...]:
    """That the loop is so sensitive that what is foreseen at its values may be far off; powers do not change that."""
    figures = LoopFigures.of(NominalLoop(model.to_rig()))
    if not figures.peak_sensitivity > limits.sensitivity:
        return ()
    return (
        SENSITIVE(
            Where(axis=figures.peak_sensitivity_axis),
            peak=figures.peak_sensitivity,
            frequency_hz=figures.peak_sensitivity_hz,
            zone=figures.zone,
            limit=limits.sensitivity,
        ),
    )
