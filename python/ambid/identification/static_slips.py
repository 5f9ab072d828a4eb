"""Slips of people in static loadings: K_i far from its nominal value, in other units, or of the other bearing."""

from collections.abc import Callable, Iterator
from itertools import permutations
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import IdentificationError
from ambid.findings import NOWHERE, Finding, Kind, Where
from ambid.rig import Rig

UNITS = {1e-3: "F in kN, or i_c in mA", 1e3: "F in mN, or i_c in kA", 1e-6: "F in MN, or i_c in uA"}
"""What makes K_i so many times its nominal value."""
LIKE_A_UNIT = 2.5
"""Factor around a power of a thousand within which all axes must lie for it to be a unit."""
USUAL = 1.5
"""Factor to either side of the nominal K_i that air gaps, iron and coils bring."""
MUCH_BETTER = 0.25
"""Part of the sum of squares, or of the unevenness, that is left once bearings are exchanged, where they were."""
NOTICEABLE = 5e-4
"""Relative change of K_i by the deflection of the rotor that is worth a note."""
UNEVEN = 0.05
"""Relative differences of K_i from the nominal ones, a common factor aside, that magnets of one rig hardly have."""
FAR = Kind(
    "force_current_far_from_nominal",
    "warning",
    "K_i = {value:.4g} N/A is {factor:.2g} times the rig's {nominal:g} N/A",
    "see that loads and currents are of this rig at this bias current, in N and A, and the axes named right",
)
WHICH = "see which bearing is which in i_c, and from which end z is counted"
EXCHANGED = Kind(
    "bearings_exchanged",
    "warning",
    "the currents of bearings {bearings} fit {factor:.2g} times better as those of {others}",
    WHICH,
)
EXCHANGED_BY_NOMINAL = Kind(
    "bearings_exchanged_by_nominal",
    "warning",
    "K_i over that of the rig differs by {uneven:.2g|%} between the bearings {bearings}, and by {even:.2g|%} with the "
    "currents taken as those of {others}",
    WHICH,
)
BENT = Kind(
    "deflection_included",
    "note",
    "K_i includes {least:+.2%} to {most:+.2%} for K_s s[ and what {supports} supports carry] as the rotor bends; it "
    "rests on the nominal K_s, and is in no interval",
)
NOT_BENT = Kind(
    "deflection_left_out",
    "note",
    "K_s s[ and what {supports} supports carry] as the rotor bends was left out; by the nominal K_s it changes K_i by "
    "{least:+.2%} to {most:+.2%}",
    "include the deflection of the rotor",
)


def require_units(where: str, rig: Rig, k_i: FloatArray) -> None:
    """Refuse K_i (n,) that is the nominal one times a thousand or so on all axes.

    Raises
    ------
    IdentificationError
        With the factor, and the units that bring it.
    """
    ratio = k_i / _nominal(rig)
    for factor, units in UNITS.items():
        if np.all((ratio > factor / LIKE_A_UNIT) & (ratio < factor * LIKE_A_UNIT)):
            values = ", ".join(f"{value:.4g}" for value in k_i)
            raise IdentificationError(
                f"{where}: K_i = {values} N/A, {np.median(ratio):.3g} times the rig's: "
                f"it looks like {units}; give N and A"
            )


def far_from_nominal(rig: Rig, k_i: FloatArray) -> Iterator[Finding]:
    """Name the axes whose K_i (n,) is far from the nominal one."""
    for axis, value, nominal in zip(rig.axes, k_i, _nominal(rig), strict=True):
        if not 1.0 / USUAL < value / nominal < USUAL:
            own: dict[str, Any] = {"value": float(value), "nominal": float(nominal), "factor": float(value / nominal)}
            yield FAR(Where(axis=axis), **own)


def exchanged_bearings(rig: Rig, fitted: Callable[[list[int]], tuple[FloatArray, float]]) -> Iterator[Finding]:
    """Find whether the currents fit far better with bearings exchanged, or give K_i far nearer to what the rig says.

    Parameters
    ----------
    rig : Rig
    fitted : callable
        K_i (n,) and the sum of squares that is left, with the columns of the currents in another order.
    """
    first = np.cumsum([0, *(len(bearing.axes) for bearing in rig.bearings)])
    groups = [list(range(a, b)) for a, b in zip(first[:-1], first[1:], strict=True)]
    k_i, as_named = fitted([j for group in groups for j in group])
    uneven = _unevenness(rig, k_i)
    for order in permutations(range(len(groups))) if len(groups) <= 3 else ():
        if order == tuple(range(len(groups))) or [len(groups[k]) for k in order] != [len(group) for group in groups]:
            continue
        k_i, left = fitted([j for k in order for j in groups[k]])
        names = [bearing.name for bearing in rig.bearings]
        pair: dict[str, Any] = {"bearings": names, "others": [names[k] for k in order]}
        if left < MUCH_BETTER * as_named:
            yield EXCHANGED(NOWHERE, factor=as_named / left, **pair)
            return
        even = _unevenness(rig, k_i)
        if uneven > UNEVEN and even < MUCH_BETTER * uneven and left < 2.0 * as_named:
            yield EXCHANGED_BY_NOMINAL(NOWHERE, uneven=uneven, even=even, **pair)
            return


def _unevenness(rig: Rig, k_i: FloatArray) -> float:
    """Rms of the logarithm of K_i over the nominal one, but for a common factor; infinite where one is negative."""
    ratio = k_i / _nominal(rig)
    return float(np.log(ratio).std()) if (ratio > 0.0).all() else np.inf


def _nominal(rig: Rig) -> FloatArray:
    return np.array([k_i for bearing in rig.bearings for k_i in bearing.force_current])


def of_deflection(force: FloatArray, bent: FloatArray, supports: int, included: bool) -> Iterator[Finding]:
    """Find by how much the bent rotor changes K_i; both arrays without their constants."""
    change = -np.sum(force * bent, axis=0) / np.sum(force**2, axis=0)
    if np.abs(change).max() < NOTICEABLE:
        return
    sizes: dict[str, Any] = {"least": float(change.min()), "most": float(change.max()), "supports": supports or None}
    yield (BENT if included else NOT_BENT)(NOWHERE, **sizes)
