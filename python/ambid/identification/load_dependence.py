"""Does K_i of a static loading depend on the load, as where iron saturates?"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from ambid.arrays import FloatArray
from ambid.findings import Finding, Kind, Where

IntArray = NDArray[np.int_]

FEW_LOADS = Kind(
    "too_few_loads",
    "note",
    "too few different loads to test whether K_i depends on the load",
    "use five or more",
)
FALLS = Kind(
    "force_current_falls",
    "warning",
    "K_i falls by {change:.2%} from no load to {load_newton:.4g} N (p = {p_value:.1g}): the iron saturates; the value "
    "is a large-signal one, below the small-signal K_i",
)
RISES = Kind(
    "force_current_rises",
    "warning",
    "K_i rises by {change:.2%} from no load to {load_newton:.4g} N (p = {p_value:.1g}), which saturation cannot bring",
    "see that the sensors read zero and the forces are true",
)


def dependence_on_load(
    axis: str, force: FloatArray, current: FloatArray, of: IntArray, significant: float
) -> Iterator[Finding]:
    """Test f^2 and f^3 beside a line of each loading (F-test): how K_i of an axis depends on the load.

    Parameters
    ----------
    axis : str
    force, current : ndarray, shape (M,)
    of : ndarray of int, shape (M,)
        Loading of each step.
    significant : float
        p-value below which it does.
    """
    scale = np.abs(force).max()
    f = force / scale
    each = np.eye(of.max() + 1)[of]
    straight = np.hstack([each, each * f[:, None]])
    curved = np.column_stack([straight, f**2, f**3])
    rest = [current - X @ np.linalg.lstsq(X, current, rcond=None)[0] for X in (straight, curved)]
    extra = np.linalg.matrix_rank(curved) - np.linalg.matrix_rank(straight)
    freedom = len(f) - np.linalg.matrix_rank(curved)
    if extra < 2 or freedom < 1:
        yield FEW_LOADS(Where(axis=axis))
        return
    rounding = 1e-18 * (current @ current)
    before, after = (max(r @ r, rounding) for r in rest)
    p_value = float(fdtrc(2, freedom, (before - after) / 2.0 / (after / freedom)))
    if p_value >= significant:
        return
    coefficients = np.linalg.lstsq(curved, current, rcond=None)[0]
    slope = np.bincount(of, centred(f, of) ** 2) @ coefficients[each.shape[1] : -2]
    slope /= np.sum(centred(f, of) ** 2)
    quadratic, cubic = coefficients[-2:]
    low, high = min(f.min(), 0.0), max(f.max(), 0.0)
    chord = slope + quadratic * (low + high) + cubic * (low**2 + low * high + high**2)
    fall = float(1.0 - slope / chord)
    kind = FALLS if fall > 0.0 else RISES
    yield kind(Where(axis=axis), change=abs(fall), load_newton=float(scale), p_value=p_value)


def centred(values: FloatArray, of: IntArray) -> FloatArray:
    """Values (M,) or (M, n) less their mean over each loading."""
    each = np.eye(of.max() + 1)[of]
    return values - each @ (each.T @ values / each.sum(axis=0).reshape(-1, *(1,) * (values.ndim - 1)))
