"""Static loading: K_i of every axis from known forces on the levitated rotor and the currents that carry them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import ByValue, FloatArray
from ambid.errors import IdentificationError, RigError
from ambid.findings import NOWHERE, Finding, Kind, WithFindings
from ambid.identification.estimate import ParameterEstimate, columns_of
from ambid.identification.load_dependence import centred, dependence_on_load
from ambid.identification.static_flux import flux_forces, of_flux, with_gain
from ambid.identification.static_line import Line, fit_by_flux, fit_line
from ambid.identification.static_slips import exchanged_bearings, far_from_nominal, of_deflection, require_units
from ambid.loop.geometry import axis_angles, axis_directions, lies_in_one_plane, modal_geometry, rotor_of
from ambid.record import StaticLoading
from ambid.record.checks import order_of_axes
from ambid.record.measurement import findings_of_loadings
from ambid.results import OfParameters, Tabular
from ambid.rig import PointMassRotor, Rig, as_rig
from ambid.threads import with_one_blas_thread

__all__ = ["StaticEstimate", "static_load"]

_LEAST_SHARE = 0.02  # an axis that carries less than this part of the most loaded one was not loaded
_WIDEST = 0.5  # relative half width of the 95 % interval of 1/K_i beyond which the data do not determine K_i
_UNKNOWN = Kind("deflection_unknown", "note", "the deflection of the rotor is not known, and left out: {reason}")
_SCATTER = Kind("force_current_scatter", "note", "K_i differs between the loadings by up to {scatter:.2%} rms")
_STEPS_ONLY = Kind(
    "intervals_of_steps",
    "note",
    "the intervals of {axes} rest on the scatter of single steps: an error of a whole loading, as of a load cell's "
    "gain, is not in them",
    "repeat the loading, three times or more",
)


@dataclass(frozen=True, repr=False, eq=False)
class StaticEstimate(ByValue, OfParameters[ParameterEstimate], WithFindings, Tabular):
    """Result of `static_load`, M steps of all loadings on n axes.

    Attributes
    ----------
    parameters : dict of str to ParameterEstimate
        ``K_i.<axis>`` [N/A], by load.
    parameters_by_flux : dict of str to ParameterEstimate
        The same by the flux densities of Hall sensors, of axes that have them; `flux_gain` of [tolerance] included.
    residual_newton : float
        Root mean square of `residuals` [N].
    residuals : ndarray, shape (M, n)
        K_i i_c less the force that the load asks of the axis, less their constant [N].
    magnet_forces : ndarray, shape (M, n)
        Force that the load asks of the current of each axis [N].
    axes : tuple of str
        Names of the columns.
    loadings : tuple of StaticLoading
        What it was found from.
    findings : tuple of Finding
        Those of the loadings, scatter between them, dependence of K_i on load, deflection of the rotor.
    """

    parameters: dict[str, ParameterEstimate]
    residual_newton: float
    residuals: FloatArray
    magnet_forces: FloatArray
    axes: tuple[str, ...]
    loadings: tuple[StaticLoading, ...]
    findings: tuple[Finding, ...]
    parameters_by_flux: dict[str, ParameterEstimate]

    @property
    def residual_newton_by_axis(self) -> dict[str, float]:
        """Root mean square of the residuals of each axis [N]."""
        return dict(zip(self.axes, _rms(self.residuals).tolist(), strict=True))

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return {
            "parameters": {name: k_i.as_dict() for name, k_i in self.parameters.items()},
            "parameters_by_flux": {name: k_i.as_dict() for name, k_i in self.parameters_by_flux.items()},
            "residual_newton": self.residual_newton,
            "residual_newton_by_axis": self.residual_newton_by_axis,
            "loadings": [loading.name for loading in self.loadings],
            "steps": len(self.residuals),
            **self.findings_as_dict(),
        }

    def table(self) -> dict[str, list[Any]]:
        """K_i by load, an axis a row, and the rms of the residuals."""
        return columns_of(self.parameters) | {"residual_newton": list(self.residual_newton_by_axis.values())}

    def summary(self) -> list[str]:
        """Residual, how much was measured, and the findings."""
        return [
            f"forces: f = K_i i + K_s s; residual {self.residual_newton:.3g} N rms, "
            f"steps: {len(self.residuals)}, loadings: {len(self.loadings)}",
            *self.finding_lines(),
        ]

    def __str__(self) -> str:
        lines = [f"{'parameter':14s} {'value':>13s} {'std error':>11s} {'residual N':>11s}   95 % interval", "-" * 82]
        for (name, k_i), residual in zip(self.parameters.items(), self.residual_newton_by_axis.values(), strict=True):
            low, high = k_i.ci95 or (np.nan, np.nan)
            interval = f"{low:.6g} .. {high:.6g} {k_i.unit}"
            lines.append(f"{name:14s} {k_i.value:13.6g} {k_i.std_error:11.3g} {residual:11.3g}   {interval}")
            if (flux := self.parameters_by_flux.get(name)) is not None:
                low, high = flux.ci95 or (np.nan, np.nan)
                interval = f"{low:.6g} .. {high:.6g} {flux.unit}"
                lines.append(f"{'  by flux':14s} {flux.value:13.6g} {flux.std_error:11.3g} {'':11s}   {interval}")
        return "\n".join([*lines, *self.summary()])


@with_one_blas_thread
def static_load(
    rig: Rig | str | Path,
    loadings: StaticLoading | str | Path | Sequence[StaticLoading | str | Path],
    *,
    deflection: bool = False,
) -> StaticEstimate:
    """Find K_i of every axis by static loading.

    Integral action holds the sensor displacements at zero, so that statics alone give what each magnet carries: the
    equilibrium of forces along two directions and of moments about two (of one force for a plain mass) is solved for
    the magnet forces f of each step. With a constant c of each axis and loading for gravity and offsets, and the noise
    e of the current, every axis is then one least-squares problem in K_i,

        i_c = f / K_i + c + e.

    The known load is the regressor: regressing on the current, whose noise is the larger, would bias K_i low. Where the
    loadings have flux densities b, K_i follows from the force by flux 2 A B_0 b/mu_0 too, with the load as instrument
    (Ljung, System Identification, 2nd ed., section 7.6): neither noise biases it, and no gain of a load cell is in it.

    Intervals are Student's for 1/K_i, inverted. From three comparable loadings on, they come from the scatter between
    the loadings, which holds what the steps of one loading have in common, such as drift or the gain of a load cell;
    L equal loadings leave L - 1 degrees of freedom. With fewer, they come from the M steps: HC3 covariance, because
    the scatter may grow with the load (wider than needed below about ten steps), and M - L - 1 degrees of freedom. No
    interval holds an error of the force that all loadings share.

    Parameters
    ----------
    rig : Rig, or path of its file
        Its bearings; with `deflection` also its rotor and its nominal K_s.
    loadings : StaticLoading, path of its file, or sequence of them
        Steps at one operating point of this rig.
    deflection : bool
        False takes the rotor as centred in the magnets, the classic method. True takes K_s s from f, where the kept
        bending modes give the displacement s at the magnets while the sensors read zero, and the rig its nominal K_s;
        supports of the rotor carry their part where it bends (a rotor that does not stays centred in them).
        Both s and f are proportional to the load, so that no residual shows which is right; a finding has how much it
        changes. Leaving out higher modes overestimates s where the sensors lie outboard (two modes by 12 % on the
        test bench); a rigid rotor has s = 0.

    Returns
    -------
    StaticEstimate

    Raises
    ------
    IdentificationError
        If statics do not determine the magnet forces (three bearings, say), the loads leave an axis out, there are
        too few steps, or K_i comes out negative.
    RecordError
        If a loading has other axes than the rig.
    RigError
        With `deflection`, if the modes of the rotor are not known where a load acts.

    References
    ----------
    HC3: J. G. MacKinnon and H. White, Journal of Econometrics 29 (1985), 305-325.
    """
    rig, given = as_rig(rig), (loadings,) if isinstance(loadings, StaticLoading | str | Path) else loadings
    read = [own if isinstance(own, StaticLoading) else StaticLoading.load(own, rig) for own in given]
    return _solved(rig, tuple(read), deflection)


def _solved(rig: Rig, loadings: tuple[StaticLoading, ...], deflection: bool) -> StaticEstimate:
    if not loadings:
        raise IdentificationError("no static loading was given; give at least one")
    for loading in loadings:
        if len(loading.z) < 3:
            raise IdentificationError(
                f"{_names([loading])}: {len(loading.z)} load steps; allowed is at least 3, for a slope, a constant and "
                "a measure of scatter; record more steps"
            )
    found = [own.at(record=loading.name) for loading in loadings for own in loading.findings]
    found += findings_of_loadings(loadings)
    of = np.repeat(np.arange(len(loadings)), [len(loading.z) for loading in loadings])
    z = np.concatenate([loading.z for loading in loadings])
    loads = _in_frame(rig, np.concatenate([loading.force for loading in loadings]))
    force = _magnet_forces(rig, z, loads)
    current = np.concatenate([_currents(rig, loading) for loading in loadings])
    _require_loaded(rig, loadings, _rms(centred(force, of)))
    try:
        moved, carried = _deflection_forces(rig, z, loads, force)
        bent = moved - carried
    except RigError as error:
        if deflection:
            raise
        found.append(_UNKNOWN(NOWHERE, reason=str(error)))
        moved = np.zeros_like(force)
    else:
        held = len([own for own in rig.rotor.support if own.stiffness])
        found += of_deflection(centred(force, of), centred(bent, of), held, deflection)
        force = force - bent if deflection else force

    lines = [fit_line(force[:, j], current[:, j], of) for j in range(len(rig.axes))]
    for axis, line in zip(rig.axes, lines, strict=True):
        _require_slope(_names(loadings), axis, line)
    k_i = np.array([1.0 / line.slope for line in lines])
    require_units(_names(loadings), rig, k_i)

    def fitted(order: list[int]) -> tuple[FloatArray, float]:
        others = [fit_line(force[:, j], current[:, k], of) for j, k in enumerate(order)]
        left = float(sum(line.residual @ line.residual for line in others))
        return np.array([1.0 / line.slope for line in others]), left

    found += [*far_from_nominal(rig, k_i), *exchanged_bearings(rig, fitted)]
    residuals = np.stack([line.residual / line.slope for line in lines], axis=1)
    found += _of_scatter(rig, lines)
    by_load = {f"K_i.{axis}": line.k_i() for axis, line in zip(rig.axes, lines, strict=True)}
    by_flux, flux = dict[str, ParameterEstimate](), flux_forces(rig, loadings, _names(loadings))
    for j, axis in enumerate(rig.axes):
        if axis in flux and axis in rig.force_per_flux:
            own = flux[axis] - (moved[:, j] if deflection else 0.0)
            line = fit_by_flux(own, force[:, j], current[:, j], of)
            _require_slope(f"{_names(loadings)}: by flux", axis, line)
            by_flux[f"K_i.{axis}"] = with_gain(line.k_i(), rig.known_to("flux_gain"))
    found += of_flux(rig, flux, by_load, by_flux)
    for j, axis in enumerate(rig.axes):
        # p-value, over all axes, below which a finding is made
        found += dependence_on_load(axis, force[:, j], current[:, j], of, 1e-3 / len(rig.axes))
    return StaticEstimate(
        parameters=by_load,
        residual_newton=float(_rms(residuals.ravel())),
        residuals=residuals,
        magnet_forces=force,
        axes=rig.axes,
        loadings=loadings,
        findings=tuple(found),
        parameters_by_flux=by_flux,
    )


def _currents(rig: Rig, loading: StaticLoading) -> FloatArray:
    """Currents of one loading in the order of the rig's axes."""
    return loading.i_c[:, order_of_axes(_names([loading]), loading.axes, rig.axes, "the rig")]


def _in_frame(rig: Rig, loads: FloatArray) -> FloatArray:
    """Loads (M, 2) in global x, y, turned into the frame of the first bearing that `geometry` works in."""
    tilt = np.deg2rad(rig.bearings[0].tilt)
    return loads @ np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])


def _magnet_forces(rig: Rig, z: FloatArray, loads: FloatArray) -> FloatArray:
    """Magnet forces that balance each of the loads (M, 2) at z (M,), shape (M, n) [N].

    Where all axes lie in one plane, something else guides the rotor across it, and only that plane is balanced.
    """
    directions, plane = axis_directions(rig), _planes(rig)
    axis_parts, load_parts = directions @ plane.T, loads @ plane.T
    if not isinstance(rig.rotor, PointMassRotor):
        magnets = np.array([[bearing.position] for bearing in rig.bearings for _ in bearing.axes])
        axis_parts = np.hstack([axis_parts, magnets * axis_parts])
        load_parts = np.hstack([load_parts, z[:, None] * load_parts])
    axes, equations = axis_parts.shape
    if axes != equations or np.linalg.matrix_rank(axis_parts) < axes:
        raise IdentificationError(
            f"{rig.path or rig.name}: K_i of {', '.join(rig.axes)} is not identifiable by static loading: "
            f"{axes} axes share {equations} equations of equilibrium, allowed is as many axes, in two bearings at "
            "different positions; identify K_i in closed loop, or levitate on two bearings"
        )
    return np.asarray(-np.linalg.solve(axis_parts.T, load_parts.T).T, dtype=np.float64)


def _planes(rig: Rig) -> FloatArray:
    """Directions of the planes that are balanced, shape (planes, 2)."""
    return axis_directions(rig)[:1] if lies_in_one_plane(rig) else np.eye(2)


def _deflection_forces(
    rig: Rig, z: FloatArray, loads: FloatArray, magnet_forces: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """K_s s of the bent rotor by the nominal K_s, and what its supports add to the magnet forces, (M, n) each [N].

    By the kept modes, while the sensors read zero; the first less the second is taken off the force of each current.
    """
    rotor = rotor_of(rig, places=np.unique(z))
    where = modal_geometry(rig, rotor)
    omega = np.tile(rotor.frequencies_rad_s, rotor.planes)
    bends = omega > 0.0

    def bent(at: FloatArray, loads: FloatArray, magnet_forces: FloatArray) -> FloatArray:
        """Modal coordinates under loads (M, 2) at positions (M,) that magnets balance."""
        shapes = np.array([rotor.shape(place) for place in at])
        modal_forces = np.hstack([load[:, None] * shapes for load in _planes(rig) @ loads.T])
        modal_forces += magnet_forces @ where.force.T
        found = np.zeros(modal_forces.shape)
        found[:, bends] = modal_forces[:, bends] / omega[bends] ** 2
        read = found @ where.sensor.T
        found[:, ~bends] = -np.linalg.lstsq(where.sensor[:, ~bends], read.T, rcond=None)[0].T
        return found

    under_load = bent(z, loads, magnet_forces)
    k_s = np.array([k_s for bearing in rig.bearings for k_s in bearing.force_displacement])
    if not (supports := [own for own in rig.rotor.support if own.stiffness]):
        return under_load @ where.force * k_s, np.zeros(magnet_forces.shape)
    planes = _planes(rig)
    at = np.repeat([own.z for own in supports], len(planes))
    stiffness = np.repeat([own.stiffness for own in supports], len(planes))
    unit = np.tile(planes, (len(supports), 1))
    carried = _magnet_forces(rig, at, unit)
    by_unit = bent(at, unit, carried)
    shapes = np.vstack([np.kron(plane, rotor.shape(own.z)) for own in supports for plane in np.eye(len(planes))])
    # forces p = -K u of the supports, which move by u = (under_load + p by_unit) shapes'
    system = np.eye(len(at)) + by_unit @ shapes.T * stiffness
    p = np.linalg.solve(system.T, -(under_load @ shapes.T * stiffness).T).T
    return (under_load + p @ by_unit) @ where.force * k_s, p @ carried


def _require_loaded(rig: Rig, loadings: Sequence[StaticLoading], load: FloatArray) -> None:
    """Refuse loads that leave an axis out; `load` is the rms change of each axis [N]."""
    # part of the most loaded axis below which a load is what sums were rounded by
    load = np.where(load > 1e-12 * load.max(), load, 0.0)
    least = _LEAST_SHARE * load.max()
    idle = [j for j in range(len(load)) if load[j] <= least]
    if not idle:
        return
    angles = axis_angles(rig) + rig.bearings[0].tilt
    found = ", ".join(f"K_i.{rig.axes[j]} ({load[j]:.3g} N rms)" for j in idle)
    along = " and ".join(f"{angle:g}" for angle in sorted({angles[j] % 180.0 for j in idle}))
    raise IdentificationError(
        f"{_names(loadings)}: not identifiable: {found}; the loads leave these axes out, allowed is at least "
        f"{least:.3g} N rms, {_LEAST_SHARE:.0%} of the most loaded axis; add loads along {along} degrees from x, "
        "between the bearings"
    )


def _require_slope(where: str, axis: str, line: Line) -> None:
    """Refuse a K_i that the data do not determine, or that is negative."""
    if not line.half_width < _WIDEST * abs(line.slope):
        raise IdentificationError(
            f"{where}: K_i.{axis} is not identifiable: 1/K_i = {line.slope:.3g} A/N with a 95 % interval of "
            f"+-{line.half_width:.3g}, allowed is {_WIDEST:.0%} of the value; use larger loads, and more steps at each"
        )
    if line.slope < 0.0:
        raise IdentificationError(
            f"{where}: K_i.{axis} = {1.0 / line.slope:.4g} N/A; allowed is K_i > 0, f = K_i i + K_s s; F_x, F_y are "
            f"forces on the rotor and the current pulls against them: correct the sign of F_x, F_y or i_c.{axis}"
        )


def _of_scatter(rig: Rig, lines: Sequence[Line]) -> Iterator[Finding]:
    """What the intervals rest on."""
    scatter = max(float(np.std(line.by_loading) / line.slope) for line in lines)
    if max(len(line.by_loading) for line in lines) > 1:
        yield _SCATTER(NOWHERE, scatter=scatter)
    steps_only = [axis for axis, line in zip(rig.axes, lines, strict=True) if not line.clustered]
    if steps_only:
        yield _STEPS_ONLY(NOWHERE, axes=steps_only)


def _rms(values: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(values**2, axis=0))


def _names(loadings: Sequence[StaticLoading]) -> str:
    return ", ".join(str(loading.path or loading.name) for loading in loadings)
