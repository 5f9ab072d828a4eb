"""Margins of a model, nominal and under the uncertainty of its parameters."""

from collections.abc import Callable

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import InputError, UnstableLoopError
from ambid.findings import Finding, Kind
from ambid.model import Given, Model, as_model
from ambid.robustness.peaks import Peaks, find_peaks, gains, peaks_of, slopes_of
from ambid.robustness.result import ZONES, AxisMargins, Margin, Margins, zone_of
from ambid.robustness.sensitivity import BrokenLoop, Place
from ambid.robustness.uncertainty import COVERED, Draws, Uncertainty, drawn, is_stable, worst_of_ellipsoid
from ambid.threads import with_one_blas_thread

DRAWS = 500
"""Draws of the parameters: they give a probability to 2 % (one standard error), which no zone asks more of."""
FEWEST_DRAWS, MOST_DRAWS = 40, 100_000
"""Below, a 95 % interval has no draw beyond its ends; above, the curves of four axes fill a small computer's memory."""
APART = 0.25
"""Relative difference between the spread of the draws and that by slopes above which the peak is no straight function
of the parameters over the interval."""
NOT_LINEAR = Kind("nonlinear_effects_excluded", "note", "{effects}: not linear, excluded; valid for small motion")
NO_COVARIANCE = Kind(
    "no_covariance",
    "note",
    "the model has no covariance of its parameters: margins are nominal, without intervals",
    "identify, and give the model that was identified",
)
UNSTABLE_DRAWS = Kind(
    "unstable_draws",
    "warning",
    "{unstable} of {draws} draws of the parameters are unstable, and count as zone D",
    "excite more, or record longer, and identify again",
)
DRAWS_OUTSIDE = Kind("draws_excluded", "note", "{draws} draws are excluded: physics does not allow their values")
CURVED_PEAK = Kind(
    "curved_peak",
    "note",
    "{axes}: the spread of the draws differs by more than {limit:.0f|%} from that by the slope of the peak, which is "
    "curved over the interval",
    "use the interval, not the standard error",
)


@with_one_blas_thread
def margins(
    model: Given,
    *,
    at: Place = "controller",
    draws: int = DRAWS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Margins:
    """Find peaks of the sensitivity, disk margins and zones after ISO 14839-3, with their uncertainty.

    Peaks are exact over frequency, for each axis with all others closed, and for all together.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        Such as `Estimate.model` or one that `Model.load` read; without a covariance of its parameters the margins are
        nominal. Nonlinear effects are excluded, which is a finding.
    at : {"controller", "sensor"}
        Where the loop is broken: at the controller's output or at the sensors.
    draws : int
        Of the parameters from their normal distribution.
    seed : int
    progress : callable, optional
        Takes the number of draws that are done, and of all.

    Returns
    -------
    Margins

    Raises
    ------
    InputError
        If `at`, `draws` or `seed` is not allowed.
    UnstableLoopError
        If the loop is unstable at the model's values: it has no margins.
    ModelError
        If most draws have values that physics does not allow.
    """
    if not FEWEST_DRAWS <= draws <= MOST_DRAWS:
        raise InputError(f"draws = {draws}: expected {FEWEST_DRAWS} to {MOST_DRAWS}")
    if seed < 0:
        raise InputError(f"seed = {seed}: expected 0 or more")
    model = as_model(model)
    linear, findings = of_small_motion(model)
    loop, theta = BrokenLoop(linear, at), linear.theta
    if not is_stable(loop, theta):
        slowest = loop.model.poles()[0]
        raise UnstableLoopError(
            f"{model.rig.path or model.rig.name}: the loop is unstable at these values (a pole at {slowest:.4g} 1/s), "
            "and has no margins; check the rig, or identify first and give the model"
        )
    grid = loop.grid(theta)
    values = gains(loop.sensitivity(theta, grid))
    peaks = find_peaks(lambda f: loop.sensitivity(theta, f), grid, values)
    uncertainty, found = Uncertainty.of(linear), None
    every = list(map(Margin, peaks.values.tolist(), peaks.frequency_hz.tolist()))
    if uncertainty is None:
        findings.append(NO_COVARIANCE())
    else:
        found = drawn(loop, uncertainty, draws, seed, grid, progress or (lambda *_: None))
        every = _spread(loop, uncertainty, peaks, found)
        findings += _of_draws(every[: loop.axes], found, linear.rig.axes)
    n = loop.axes
    axes = tuple(
        AxisMargins(axis, every[j], _disk(every[n + j]), zone_of(every[j].value), _chances(found, [j]))
        for j, axis in enumerate(linear.rig.axes)
    )
    tail = 0.5 * (1.0 - COVERED)
    return Margins(
        model=model,
        at=at,
        axes=axes,
        multivariable=every[2 * n],
        disk=_disk(every[2 * n + 1]),
        zone=zone_of(float(peaks.values[:n].max())),
        zone_probability=_chances(found, range(n)),
        draws=0 if found is None else len(found.z),
        unstable=0 if found is None else found.unstable,
        outside=0 if found is None else found.outside,
        seed=seed,
        frequency_hz=grid,
        sensitivity=values[:, :n],
        band=None if found is None or not len(found.curves) else np.quantile(found.curves, (tail, 1.0 - tail), axis=0),
        findings=tuple(findings),
    )


def sensitivity_peaks(model: Model) -> tuple[FloatArray, FloatArray]:
    """Peaks of ``|S_jj|`` of every axis of a linear model, broken at the controller's output, and where they are.

    Returns
    -------
    values, frequency_hz : ndarray, shape (axes,)
    """
    loop = BrokenLoop(model, "controller")
    peaks = peaks_of(loop, model.theta)
    return peaks.values[: loop.axes], peaks.frequency_hz[: loop.axes]


def of_small_motion(model: Model) -> tuple[Model, list[Finding]]:
    """The model as its loop answers small motion, and what was left out; errors of the record are not in the loop."""
    linear = model.without_nonlinear()
    left_out = [effect.name for effect in model.effects if effect not in linear.effects]
    for effect in linear.effects:
        if effect.in_record:
            linear = linear.without(effect.name)
    if linear is model:
        return model, []
    kept = [model.names.index(name) for name in linear.names]
    if model.covariance is not None:
        linear = linear.with_covariance(model.covariance[np.ix_(kept, kept)])
    if not left_out:
        return linear, []
    return linear, [NOT_LINEAR(effects=left_out)]


def _spread(loop: BrokenLoop, uncertainty: Uncertainty, peaks: Peaks, found: Draws) -> list[Margin]:
    """Every peak with its interval, standard error and worst case."""
    slopes = slopes_of(loop, uncertainty.theta, peaks, uncertainty.free) @ uncertainty.root
    errors = np.linalg.norm(slopes, axis=1)
    within = np.linalg.norm(found.z, axis=1) <= uncertainty.radius
    names = loop.model.names
    every = []
    for gain, (value, frequency) in enumerate(zip(peaks.values, peaks.frequency_hz, strict=True)):
        starts = [uncertainty.towards(slopes[gain])]
        if within.any():
            starts.append(found.z[within][found.peaks[within, gain].argmax()])
        worst, theta = worst_of_ellipsoid(loop, uncertainty, gain, starts)
        every.append(
            Margin(
                value=float(value),
                frequency_hz=float(frequency),
                ci95=found.interval(gain),
                std_error=float(errors[gain]) if gain < 2 * loop.axes else None,
                worst=worst,
                worst_at={names[k]: float(theta[k]) for k in uncertainty.free},
            )
        )
    return every


def _disk(peak: Margin) -> Margin:
    """The disk margin, one over the peak of |S - 1/2|."""
    low, high = (None, None) if peak.ci95 is None else peak.ci95
    return Margin(
        value=1.0 / peak.value,
        frequency_hz=peak.frequency_hz,
        ci95=None if low is None or high is None else (1.0 / high, 1.0 / low),
        std_error=None if peak.std_error is None else peak.std_error / peak.value**2,
        worst=None if peak.worst is None else 1.0 / peak.worst,
        worst_at=peak.worst_at,
    )


def _chances(found: Draws | None, axes: list[int] | range) -> dict[str, float]:
    """Share of the draws whose worst axis is in each zone."""
    if found is None:
        return {}
    zones = [zone_of(peak) for peak in found.peaks[:, list(axes)].max(axis=1)]
    return {zone: zones.count(zone) / len(zones) for _, zone in ZONES}


def _of_draws(of_axes: list[Margin], found: Draws, axes: tuple[str, ...]) -> list[Finding]:
    """What a reader must know of the draws."""
    findings = []
    if found.unstable:
        findings.append(UNSTABLE_DRAWS(unstable=found.unstable, draws=len(found.z)))
    if found.outside:
        findings.append(DRAWS_OUTSIDE(draws=found.outside))
    curved = []
    for j, (axis, own) in enumerate(zip(axes, of_axes, strict=True)):
        stable = found.peaks[np.isfinite(found.peaks[:, j]), j]
        if own.std_error and len(stable) > 1 and abs(stable.std() / own.std_error - 1.0) > APART:
            curved.append(axis)
    if curved:
        findings.append(CURVED_PEAK(axes=curved, limit=APART))
    return findings
