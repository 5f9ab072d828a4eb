"""Models, controllers and rotors from and to SciPy, python-control, MATLAB and ROSS."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.io

from ambid.arrays import FloatArray
from ambid.errors import InputError, ModelError, RigError
from ambid.findings import Kind
from ambid.loop.delay import with_late_commands
from ambid.loop.loop import open_plant
from ambid.model import Model
from ambid.reading import load_mat, reading
from ambid.rig import Controller, MatrixRotor, StateSpaceController, Support, TransferFunctionController
from ambid.rotor import reduced_rotor
from ambid.writing import whole_file

if TYPE_CHECKING:
    import scipy.signal

LATERAL = {4: (0, 1, 2, 3), 6: (0, 1, 3, 4)}
"""Places of [u_x, u_y, theta_x, theta_y] among four freedoms of a node, or among six with axial motion and torsion."""
RIGID = 1e-9
"""Part of the stiffness that a rigid motion of a free rotor meets, or of the damping that no mode has: rounding."""
ROSS_BEARING = Kind(
    "ross_bearing_left_out",
    "warning",
    "the bearing element {element} of ROSS at z = {position_m:.4g} m is left out: {why}",
    "give it in the rig if it is known, as a magnet or as a plain rotor.support",
)


@dataclass(frozen=True)
class _StateSpace:
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


def controller_from(system: Any, delay_samples: float = 0.0) -> StateSpaceController | TransferFunctionController:
    """Take over a controller of python-control or SciPy; see `Controller.from_lti`."""
    return Controller.from_lti(system, delay_samples)


def controller_from_mat(path: str | Path, delay_samples: float = 0.0) -> StateSpaceController:
    """Read a controller from a .mat file (v5) with A, B, C, D and, for a digital one, the sampling time ``dt`` [s].

    Parameters
    ----------
    path : str or Path
        K from y [m] to currents [A], as ``[A, B, C, D] = ssdata(K); dt = K.Ts; save('K.mat', ...)`` in MATLAB writes
        it; ``dt`` that is 0 or absent means analog.
    delay_samples : float
        As in `Controller`, of a digital one.

    Raises
    ------
    RigError
        If the file cannot be read, or has not these variables; and as for `StateSpaceController`.
    """
    names = ("A", "B", "C", "D")
    with reading(path, RigError, "a .mat file of version 5", "save it with the option -v7"):
        content = load_mat(Path(path))
    missing = [name for name in names if name not in content]
    if missing:
        found = ", ".join(content) or "nothing"
        raise RigError(f"{path}: no {', '.join(missing)}; expected A, B, C, D and dt, found {found}")
    dt = np.ravel(content.get("dt", 0.0))
    if dt.size != 1 or not (np.isrealobj(dt) and np.isfinite(dt[0]) and dt[0] >= 0.0):
        raise RigError(f"{path}: dt = {dt}; expected the sampling time in s, or 0 for an analog controller")
    keys: dict[str, Any] = {"implementation": "analog", "delay_samples": delay_samples}
    if dt[0] > 0.0:
        keys |= {"implementation": "digital", "sample_rate": 1.0 / float(dt[0])}
    try:
        return StateSpaceController(**{name: content[name].tolist() for name in names}, **keys)
    except RigError as error:
        raise RigError(f"{path}: {error}") from None


def rotor_from_ross(
    rotor: Any,
    *,
    flexible_modes: int = 0,
    modal_damping: float | tuple[float, ...] | None = None,
    bending_frequencies_hz: tuple[float, ...] | None = None,
) -> MatrixRotor:
    """Take over a ROSS rotor: its shaft, cones and disks, its damping, and bearings that are plain springs and dampers.

    Its damping is as exact as its mass: what couples modes, or damps rigid motions unlike each other, is the rotor's
    `C`, beside its `mass_damping` and `modal_damping`. Omitted, as `findings` state, are bearings that no `Support`
    describes; axial motion and torsion; and what ROSS has at other frequencies than 0, in bearings alone.

    Parameters
    ----------
    rotor : ross.Rotor
        ``M(0)``, ``K(0)``, ``C(0)``, ``G()``, ``nodes_pos`` and ``bearing_elements`` are read. It needs a node at every
        magnet and sensor. Of six freedoms a node, axial motion and torsion are left out. A bearing to ground that is
        alike in both directions, without cross-coupling and the same at every frequency, becomes a `Support`; others,
        magnetic ones among them, are left out: the magnets are given in the rig.
    flexible_modes, bending_frequencies_hz
        As for `MatrixRotor`.
    modal_damping : float or tuple of float, optional
        As for `MatrixRotor`; default: that of ROSS's damping matrix in each kept mode.

    Returns
    -------
    MatrixRotor
        What was left out, and why, is in its `findings`.

    Raises
    ------
    RigError
        If the object has not these members, its freedoms per node are not 4 or 6, or something beside its bearings
        holds the rotor; and as for `MatrixRotor`.

    References
    ----------
    Timbó et al., ROSS - Rotordynamic Open Source Software, JOSS 5 (2020) 2120.
    """
    try:
        z = np.array(rotor.nodes_pos, dtype=float)
        M, K, G, C = (np.asarray(own, dtype=float) for own in (rotor.M(0.0), rotor.K(0.0), rotor.G(), rotor.C(0.0)))
        bearings = list(rotor.bearing_elements)
    except (AttributeError, TypeError) as error:
        raise RigError(f"rotor: {type(rotor).__name__} object ({error}): expected a ross.Rotor") from None
    freedoms, rest = divmod(len(M), len(z))
    if rest or freedoms not in LATERAL:
        raise RigError(
            f"rotor: matrices of {len(M)} rows for {len(z)} nodes; expected 4 or 6 freedoms a node, and no other nodes "
            "than those of the shaft; make the ross.Rotor without n_link, and give what holds it as Support"
        )
    kept = (freedoms * np.arange(len(z))[:, None] + np.array(LATERAL[freedoms])).ravel()
    M, K, G, C = (matrix[np.ix_(kept, kept)] for matrix in (M, K, G, C))
    supports, findings = [], []
    for bearing in bearings:
        M_b, K_b, C_b = (np.asarray(of(0.0), dtype=float)[:2, :2] for of in (bearing.M, bearing.K, bearing.C))
        own = slice(4 * bearing.n, 4 * bearing.n + 2)
        for matrix, part in ((M, M_b), (K, K_b), (C, C_b)):
            matrix[own, own] -= part
        why = _why_no_support(bearing, M_b, K_b, C_b)
        if why:
            findings.append(
                ROSS_BEARING(element=bearing.tag or type(bearing).__name__, position_m=z[bearing.n], why=why)
            )
        elif K_b.any() or C_b.any():
            supports.append(Support(position=z[bearing.n], stiffness=K_b[0, 0], damping=C_b[0, 0]))
    held = _holding(K, z)
    if held > RIGID:
        raise RigError(
            f"rotor: its stiffness matrix holds it against the ground ({held:.2g} of its largest entry in a rigid "
            "motion) beside its bearing_elements; make the ross.Rotor without what holds it"
        )
    free = MatrixRotor(
        node_positions=z.tolist(),
        M=M.tolist(),
        K=K.tolist(),
        G=G.tolist(),
        C=None,
        flexible_modes=flexible_modes,
        modal_damping=modal_damping or 0.0,
        bending_frequencies_hz=bending_frequencies_hz,
        support=tuple(supports),
    )
    mass_damping, ratios, further = _modal_damping(free, C)
    if modal_damping is not None or not any(ratios):
        ratios = ()
    damped = {"mass_damping": mass_damping, "modal_damping": ratios or free.modal_damping, "C": further}
    return free.model_copy(update=damped).with_findings(findings)


def _why_no_support(bearing: Any, M: FloatArray, K: FloatArray, C: FloatArray) -> str:
    """Why a bearing of ROSS is no spring and damper to ground, alike in both directions; empty if it is one."""
    if "Magnetic" in type(bearing).__name__:
        return "the magnets are given in the rig"
    if M.any():
        return "it has inertia"
    if any(own[0, 1] or own[1, 0] for own in (K, C)):
        return "it has cross-coupling"
    if any(own[0, 0] != own[1, 1] for own in (K, C)):
        return "it is not alike in both directions"
    if any(np.ptp(np.atleast_1d(getattr(bearing, name, 0.0))) for name in ("kxx", "kyy", "cxx", "cyy")):
        return "it changes with the frequency"
    return "it damps negatively" if C[0, 0] < 0.0 else ""


def _modal_damping(rotor: MatrixRotor, C: FloatArray) -> tuple[float, tuple[float, ...], tuple[Any, ...] | None]:
    """Damping of the whole rotor over its mass [1/s], ratio of each kept mode, and the rest of C among kept modes."""
    reduced = reduced_rotor(rotor, ())
    modal = reduced.T_R.T @ C @ reduced.T_R
    n, rigid, w = len(reduced.frequencies_rad_s), reduced.rigid_modes, reduced.frequencies_rad_s
    of_modes = (np.diag(modal)[:n] + np.diag(modal)[n:]) / 2.0
    mass_damping = max(0.0, float(of_modes[:rigid].mean()))
    ratios = np.maximum(0.0, (of_modes[rigid:] - mass_damping) / (2.0 * w[rigid:]))
    taken = np.concatenate([np.full(rigid, mass_damping), mass_damping + 2.0 * ratios * w[rigid:]])
    rest = modal - np.diag(np.tile(taken, 2))
    if np.abs(rest).max() <= RIGID * np.abs(modal).max():
        return mass_damping, tuple(ratios.tolist()), None
    further = reduced.T_L.T @ rest @ reduced.T_L
    return mass_damping, tuple(ratios.tolist()), tuple(map(tuple, ((further + further.T) / 2.0).tolist()))


def to_scipy(model: Model) -> scipy.signal.StateSpace:
    """Closed loop of a model, sampled with zero-order hold, for SciPy.

    Parameters
    ----------
    model : Model
        Without nonlinear effects.

    Returns
    -------
    scipy.signal.StateSpace
        From i_e [A], and the waves of disturbances in the model, to y [m] and i_c [A]; ``dt`` is the rig's sampling
        time [s]. Their names, such as ``i_e.A_zeta``, are in the attributes ``input_names`` and ``output_names``.

    Raises
    ------
    ModelError
        If an effect of the model is not linear.
    """
    loop = _closed_loop(model)
    import scipy.signal  # slow to import, and seldom needed

    system = scipy.signal.StateSpace(loop.A, loop.B, loop.C, loop.D, dt=model.loop.sample_time)
    system.input_names, system.output_names = loop.inputs, loop.outputs
    return system


def to_control(model: Model) -> Any:
    """Closed loop of a model, sampled with zero-order hold, for python-control.

    Parameters
    ----------
    model : Model
        Without nonlinear effects.

    Returns
    -------
    control.StateSpace
        As `to_scipy` says. Names have ``_`` in place of the dot, which python-control does not allow: ``y_A_zeta``.

    Raises
    ------
    ModelError
        If an effect of the model is not linear.
    InputError
        If python-control is not installed.
    """
    loop = _closed_loop(model)
    return control_system((loop.A, loop.B, loop.C, loop.D, model.loop.sample_time), loop.inputs, loop.outputs)


def control_system(system: Sequence[Any], inputs: Sequence[str], outputs: Sequence[str]) -> Any:
    """A state space of python-control from what makes one; see `to_control`."""
    try:
        control = importlib.import_module("control")
    except ImportError:
        raise InputError("to_control needs the package control: pip install 'ambid[control]'") from None
    names = [[name.replace(".", "_") for name in side] for side in (inputs, outputs)]
    return control.ss(*system, inputs=names[0], outputs=names[1])


def to_mat(model: Model, path: str | Path) -> None:
    """Write a model for MATLAB, as a .mat file (v5).

    It holds the closed loop sampled with zero-order hold (``A``, ``B``, ``C``, ``D``, ``dt`` [s], ``inputs``,
    ``outputs``), the plant in continuous time from the commands i_ref [A] to y [m] and i_c [A] (``A_plant``, ...,
    ``inputs_plant``, ``outputs_plant``), and the values of the ``parameters`` (SI units), a dot in their names being
    an underscore. In MATLAB: ``ss(A, B, C, D, dt, 'InputName', inputs, 'OutputName', outputs)``.

    Parameters
    ----------
    model : Model
        Without nonlinear effects.
    path : str or Path
        With the suffix .mat.

    Raises
    ------
    ModelError
        If an effect of the model is not linear, or the suffix is not .mat.
    """
    path = Path(path)
    if path.suffix.lower() != ".mat":
        raise ModelError(f"{path}: the suffix is {path.suffix or 'missing'}; expected .mat")
    loop, plant = _closed_loop(model), _plant_at(model)
    content: dict[str, Any] = {"dt": model.loop.sample_time, "name": model.rig.name}
    for system, suffix in ((loop, ""), (plant, "_plant")):
        content |= {f"{key}{suffix}": getattr(system, key) for key in ("A", "B", "C", "D", "inputs", "outputs")}
    content["parameters"] = {p.name.replace(".", "_"): p.value for p in model.parameters}
    write_mat(path, content)


def write_mat(path: Path, content: Mapping[str, Any]) -> None:
    """Write variables as a .mat file (v5), a tuple of texts as a cell array."""
    cells = {
        name: np.array(value, dtype=object).reshape(-1, 1) if isinstance(value, tuple) else value
        for name, value in content.items()
    }
    with whole_file(path) as stream:
        scipy.io.savemat(stream, cells, long_field_names=True)


def require_linear(model: Model) -> None:
    """Refuse a model with nonlinear effects, which no state space can hold.

    Raises
    ------
    ModelError
        Naming one.
    """
    blocks = model.loop.lft.blocks
    if blocks:
        slots = {slot for block in blocks for slot in block.slots.values()}
        names = [effect.name for effect in model.effects if any(slot.startswith(f"{effect.name}.") for slot in slots)]
        raise ModelError(
            f"{', '.join(names) or blocks[0].law} is not linear, and a state space cannot hold it; "
            f"export model.without({names[0] if names else '...'!r})"
        )


def _closed_loop(model: Model) -> _StateSpace:
    """The sampled closed loop at the model's values."""
    require_linear(model)
    return _StateSpace(*model.loop.state_space(model.theta), model.loop.inputs, model.loop.outputs)


def _plant_at(model: Model) -> _StateSpace:
    """The plant in continuous time at the model's values, without its controller; a delay as a Pade approximant."""
    plant = with_late_commands(open_plant(model.rig, model.effects))
    values = {slot: p.value for p in model.parameters for slot in p.slots}
    A, B, C, D = plant.closed(values)
    kept = [k for k, name in enumerate(plant.inputs) if not name.startswith("i_late.")]
    return _StateSpace(A, B[:, kept], C, D[:, kept], tuple(plant.inputs[k] for k in kept), plant.outputs)


def _holding(K: FloatArray, z: FloatArray) -> float:
    """Largest force against a rigid motion, as a part of the largest stiffness times the motion."""
    ones, none = np.ones_like(z), np.zeros_like(z)
    lever = z - z.mean()
    motions = [
        (ones, none, none, none),
        (none, ones, none, none),
        (lever, none, none, ones),
        (none, lever, -ones, none),
    ]
    return max(
        float(np.abs(K @ motion).max() / (np.abs(K) @ np.abs(motion)).max())
        for motion in (np.column_stack(columns).ravel() for columns in motions)
    )
