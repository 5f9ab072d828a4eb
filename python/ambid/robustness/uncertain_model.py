"""The uncertain model: G, the Delta of uncertain numbers around it, and the controller that closes the loop."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambid.arrays import FloatArray, StateSpace
from ambid.errors import ModelError
from ambid.identification.estimate import NORMAL_95
from ambid.interop import control_system, require_linear, write_mat
from ambid.loop.assembly import Lft
from ambid.loop.delay import with_late_commands
from ambid.loop.loop import open_plant
from ambid.model import Given, as_model
from ambid.results import of_unit
from ambid.robustness.sensitivity import Law
from ambid.robustness.uncertainty import Uncertainty
from ambid.writing import whole_file


@dataclass(frozen=True, repr=False)
class UncertainModel:
    """The plant as an upper linear fractional transformation: ``x' = A x + B [w; u]``, ``[z; y] = C x + D [w; u]``.

    ``w = Delta z``; entry k of the diagonal Delta is ``scale[k] * theta[parameter[k]] ** power[k]``. The loop is closed
    by the commands ``u = -K y + i_e``; it is the same as that of the model.

    Attributes
    ----------
    name : str
        Of the rig.
    A, B, C, D : ndarray
        G in continuous time; a delay of the commands is a Pade approximant in it.
    inputs, outputs : tuple of str
        Names of u and y, such as ``i_ref.A_zeta`` and ``y.A_zeta``.
    parameter : ndarray of int, shape (w,)
    scale, power : ndarray, shape (w,)
    parameters, units : tuple of str
    values : ndarray, shape (parameters,)
        Nominal values.
    ci95 : ndarray, shape (parameters, 2)
        95 % ranges; NaN for parameters that were not free.
    covariance : ndarray, shape (parameters, parameters)
        NaN for parameters that were not free.
    controller : tuple of ndarray
        A, B, C, D of K from y, the outputs, to the commands of all axes.
    dt : float
        Sampling time of a digital K [s]; 0 of an analog one.
    delay_samples : float
        Of a digital K.
    """

    name: str
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameter: np.ndarray
    scale: FloatArray
    power: FloatArray
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    ci95: FloatArray
    covariance: FloatArray
    controller: StateSpace
    dt: float
    delay_samples: float
    _uncertainty: Uncertainty

    def delta(self, theta: ArrayLike | None = None) -> FloatArray:
        """Delta at values of all parameters, or at the nominal ones, shape (w, w)."""
        theta = self.values if theta is None else np.asarray(theta, dtype=np.float64)
        return np.diag(self.scale * theta[self.parameter] ** self.power)

    def plant(self, theta: ArrayLike | None = None) -> StateSpace:
        """A, B, C, D from u to y, with Delta at values of all parameters closed around G."""
        delta = self.delta(theta)
        w = len(delta)
        gain = np.linalg.solve(np.eye(w) - delta @ self.D[:w, :w], delta)
        to_x, to_y = self.B[:, :w] @ gain, self.D[w:, :w] @ gain
        return (
            self.A + to_x @ self.C[:w],
            self.B[:, w:] + to_x @ self.D[:w, w:],
            self.C[w:] + to_y @ self.C[:w],
            self.D[w:, w:] + to_y @ self.D[:w, w:],
        )

    def samples(self, count: int, seed: int = 0) -> FloatArray:
        """Draws of all parameters from their normal distribution, shape (count, parameters); some may be unphysical."""
        z = np.random.default_rng(seed).standard_normal((count, len(self._uncertainty.free)))
        return self._uncertainty.at(z)

    def to_control(self, count: int, seed: int = 0) -> list[Any]:
        """Plants of python-control at `count` draws of the parameters, see `samples`.

        Returns
        -------
        list of control.StateSpace
            From i_ref to y and i_c; names have ``_`` in place of the dot.

        Raises
        ------
        InputError
            If python-control is not installed.
        """
        draws = self.samples(count, seed)
        return [control_system(self.plant(theta), self.inputs, self.outputs) for theta in draws]

    def to_mat(self, path: str | Path) -> list[Path]:
        """Write G, Delta, ranges, covariance and K as a .mat file (v5), and the script that makes a MATLAB uss of it.

        Parameters
        ----------
        path : str or Path
            Such as ``bench.mat``; the script is ``bench_uss.m`` beside it. It closes the nominal loop in plain MATLAB
            or Octave, and makes the uncertain objects where the Robust Control Toolbox is there.

        Returns
        -------
        list of Path
            What was written.

        Raises
        ------
        ModelError
            If the suffix is not .mat, or the name would be none of a MATLAB script.
        """
        content = {key: getattr(self, key) for key in ("A", "B", "C", "D", "name", "inputs", "outputs", "units")}
        content |= {f"K_{key}": matrix for key, matrix in zip("ABCD", self.controller, strict=True)}
        content |= {
            "K_dt": self.dt,
            "K_delay": self.delay_samples,
            "delta_parameter": self.parameter[:, None] + 1.0,
            "delta_scale": self.scale[:, None],
            "delta_power": self.power[:, None],
            "parameters": tuple(re.sub(r"\W", "_", name) for name in self.parameters),
            "nominal": self.values[:, None],
            "lower95": self.ci95[:, :1],
            "upper95": self.ci95[:, 1:],
            "covariance": self.covariance,
        }
        path = Path(path)
        script = script_beside(path)
        write_mat(path, content)
        text = SCRIPT.read_text(encoding="utf-8").replace("FILE.mat", path.name)
        with whole_file(script) as stream:
            stream.write(text.encode())
        return [path, script]

    def __repr__(self) -> str:
        own = ", ".join(f"{p.shape[0]} x {p.shape[1]}" for p in (self.A, self.delta()))
        return f"UncertainModel({self.name!r}: A and Delta {own})"

    def __str__(self) -> str:
        rows = [
            f"  {name:14s} {value:12.6g}   {low:.6g} .. {high:.6g}{of_unit(unit)}"
            for name, value, (low, high), unit in zip(self.parameters, self.values, self.ci95, self.units, strict=True)
            if np.isfinite(low)
        ]
        return "\n".join([f"{self!r}, 95 % ranges", *rows])


def uncertain(model: Given) -> UncertainModel:
    """Take a model with its uncertainty apart: G, Delta and K.

    Errors of the controller's gains and the scale of i_e are not in G: K is taken at the model's values of them.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        Linear, with the covariance of its parameters, such as `Estimate.model` or one that `Model.load` read.

    Raises
    ------
    ModelError
        If it has no covariance, an effect is not linear, or the 95 % range of a parameter leaves what physics allows.
    """
    model = as_model(model)
    require_linear(model)
    uncertainty = Uncertainty.of(model)
    if uncertainty is None or model.covariance is None:
        raise ModelError(
            f"{model.rig.name}: the model has no covariance of its parameters; identify, and save the model"
        )
    errors = np.sqrt(np.diag(model.covariance))
    ci95 = np.column_stack([model.theta - NORMAL_95 * errors, model.theta + NORMAL_95 * errors])
    for p, (low, high) in zip(model.parameters, ci95, strict=True):
        if low < p.lower or high > p.upper:
            raise ModelError(
                f"{p.name}: the 95 % range {low:.4g} .. {high:.4g}{of_unit(p.unit)} leaves what physics allows, "
                f"{p.lower:g} .. {p.upper:g}; take its effect out, fix it in the identification, or record more"
            )
    plant = with_late_commands(open_plant(model.rig, model.acting, (), model.structure.reference))
    A, B, C, D, inputs = _ports_first(plant)
    index = {slot: k for k, p in enumerate(model.parameters) for slot in p.slots}
    own, rate = model.rig.controller, model.rig.sample_rate
    return UncertainModel(
        name=model.rig.name,
        A=A,
        B=B,
        C=C,
        D=D,
        inputs=inputs,
        outputs=plant.outputs,
        parameter=np.array([index[port.slot] for port in plant.ports]),
        scale=np.array([port.scale for port in plant.ports]),
        power=np.array([float(port.power) for port in plant.ports]),
        parameters=model.names,
        units=tuple(p.unit for p in model.parameters),
        values=model.theta,
        ci95=ci95,
        covariance=model.covariance,
        controller=Law(model).state_space(model.theta),
        dt=1.0 / own.rate(rate) if own.is_digital else 0.0,
        delay_samples=own.delay_samples,
        _uncertainty=uncertainty,
    )


def _ports_first(plant: Lft) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
    """A, B, C, D of G with w and z before the commands and the outputs, and the names of the commands."""
    commands = [k for k, name in enumerate(plant.inputs) if name.startswith("i_ref.")]
    w = [len(plant.inputs) + k for k in range(len(plant.ports))]
    z = [len(plant.outputs) + k for k in range(len(plant.ports))]
    rows, columns = [*z, *range(len(plant.outputs))], [*w, *commands]
    names = tuple(plant.inputs[k] for k in commands)
    return plant.A, plant.B[:, columns], plant.C[rows], plant.D[np.ix_(rows, columns)], names


SCRIPT = Path(__file__).with_name("uncertain_model.m")


def script_beside(path: Path) -> Path:
    """Where the script of a .mat file is written.

    Raises
    ------
    ModelError
        If the suffix is not .mat, or the name would be none of a MATLAB script.
    """
    if path.suffix.lower() != ".mat":
        raise ModelError(f"{path}: the suffix is {path.suffix or 'missing'}; expected .mat")
    if not re.fullmatch(r"[A-Za-z]\w{0,50}", path.stem, re.ASCII):
        raise ModelError(
            f"{path}: its script would be {path.stem}_uss.m, which MATLAB cannot run; expected a name of letters, "
            "digits and _ that begins with a letter"
        )
    return path.with_name(f"{path.stem}_uss.m")
