"""Static loading with Hall sensors: K_i by the force that the flux makes, beside that by the load.

The difference b of the flux densities of opposed poles makes the force f = 2 A B_0 b/mu_0 about the bias, that
by the current and that by the place of the rotor: f = K_i i + K_s s. While integral action holds the sensors at
zero, s is what the rotor bends between sensor and magnet, which is known for the deflection of `static_load` alone.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import IdentificationError
from ambid.findings import Finding, Kind, Where
from ambid.identification.estimate import NORMAL_95, ParameterEstimate
from ambid.record import StaticLoading
from ambid.record.checks import order_of_axes
from ambid.rig import Rig

__all__ = ["flux_forces", "of_flux", "with_gain"]

DIFFERS = Kind(
    "force_by_flux_differs",
    "warning",
    "K_i = {by_flux:.4g} N/A by flux and {by_load:.4g} N/A by load, {ratio:.3f} times, beyond both intervals",
    "see the gain of the load cell, pole_area and bias_flux of the bearing and the place of the Hall sensors; a force "
    "that no flux shows, as of a seal or a coupling, does the same",
)
NO_GAIN = Kind(
    "flux_gain_unknown",
    "note",
    "the flux density was recorded, and is not used: what force it makes is not known",
    "add pole_area [m^2] or bias_flux [T] to the bearing",
)
BY_NOMINAL = Kind(
    "flux_gain_by_nominal",
    "note",
    "K_i by flux rests on the nominal K_i, as {missing} is not stated",
    "state pole_area and bias_flux of the bearing both",
)


def flux_forces(rig: Rig, loadings: Sequence[StaticLoading], where: str) -> dict[str, FloatArray]:
    """Force of each axis whose flux density all loadings have, and whose force by flux is known, (M,) each [N]."""
    columns = {axis: list[FloatArray]() for axis in rig.axes}
    for loading in loadings:
        if loading.b is not None:
            own = loading.b[:, order_of_axes(where, loading.axes, rig.axes, "the rig")]
            for axis, column in zip(rig.axes, own.T, strict=True):
                columns[axis] += [column] if np.isfinite(column).all() else []
    whole = {axis: np.concatenate(parts) for axis, parts in columns.items() if len(parts) == len(loadings)}
    partly = [axis for axis, parts in columns.items() if 0 < len(parts) < len(loadings)]
    if partly:
        raise IdentificationError(
            f"{where}: {', '.join(f'b.{axis}' for axis in partly)} is not in every loading; expected in all of them, "
            "or in none; add it, or leave out the loadings without it"
        )
    return {axis: rig.force_per_flux.get(axis, np.nan) * b for axis, b in whole.items()}


def with_gain(k_i: ParameterEstimate, gain: float) -> ParameterEstimate:
    """The same with the relative standard deviation to which the force by flux is known."""
    value, error, (low, high) = k_i.value or np.nan, k_i.std_error or 0.0, k_i.ci95 or (np.nan, np.nan)
    wide = NORMAL_95 * gain * value
    ends = float(value - np.hypot(value - low, wide)), float(value + np.hypot(high - value, wide))
    return ParameterEstimate(value, float(np.hypot(error, gain * value)), ends, k_i.unit, error)


def of_flux(
    rig: Rig,
    forces: Mapping[str, FloatArray],
    by_load: Mapping[str, ParameterEstimate],
    by_flux: Mapping[str, ParameterEstimate],
) -> Iterator[Finding]:
    """Flux densities without a gain, or with one of the nominal K_i, and K_i that differ beyond their intervals."""
    for bearing in rig.bearings:
        missing = "pole_area" if bearing.pole_area is None else "bias_flux" if bearing.bias_flux is None else ""
        for axis in bearing.axis_names:
            if axis not in forces:
                continue
            if axis not in rig.force_per_flux:
                yield NO_GAIN(Where(channel=f"b.{axis}"))
                continue
            if missing:
                yield BY_NOMINAL(Where(channel=f"b.{axis}"), missing=missing)
            load, flux = by_load[f"K_i.{axis}"], by_flux[f"K_i.{axis}"]
            (low, high), (least, most) = flux.ci95 or (np.nan, np.nan), load.ci95 or (np.nan, np.nan)
            if low > most or high < least:
                flux_n, load_n = flux.value or np.nan, load.value or np.nan
                yield DIFFERS(Where(axis=axis), by_flux=flux_n, by_load=load_n, ratio=flux_n / load_n)
