"""Where the poles of a loop are: of the plant alone, of the closed loop, and how sure the latter are."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.findings import Finding, WithFindings
from ambid.loop.loop import open_plant
from ambid.model import Model
from ambid.results import Tabular, picture, plain
from ambid.robustness.procedure import of_small_motion
from ambid.robustness.uncertainty import Uncertainty

ROUNDING = 1e-8
"""Part of a pole, the root of what numbers are rounded to, up to which its real part may be rounding."""


@dataclass(frozen=True, repr=False, eq=False)
class PoleMap(ByValue, Tabular, WithFindings):
    """Result of `pole_map`. Of each conjugate pair the pole with the positive imaginary part stands for both.

    Attributes
    ----------
    model : Model
    closed : ndarray of complex, shape (poles,)
        Of the closed loop [1/s], slowest first; of a digital one ``ln(mu) fs``, without those of commands under way.
    covariance : ndarray, shape (poles, 2, 2)
        Of real and imaginary part, to first order in the parameters; NaN where the model has none.
    open : ndarray of complex, shape (open poles,)
        Of the plant with its actuators, the controller off.
    findings : tuple of Finding
    """

    model: Model
    closed: ComplexArray
    covariance: FloatArray
    open: ComplexArray
    findings: tuple[Finding, ...] = ()

    plot = picture("plot_poles")

    @property
    def frequency_hz(self) -> FloatArray:
        """Of every closed-loop pole, damped; 0 of a real one."""
        return self.closed.imag / (2.0 * np.pi)

    @property
    def damping(self) -> FloatArray:
        """Ratio of every closed-loop pole."""
        return damping_ratio(self.closed)

    @property
    def std_error(self) -> FloatArray:
        """Of frequency [Hz] and damping ratio of every closed-loop pole, shape (poles, 2)."""
        size = np.abs(self.closed)
        slopes = np.zeros((len(self.closed), 2, 2))
        slopes[:, 0, 1] = 1.0 / (2.0 * np.pi)
        slopes[:, 1, 0] = -(self.closed.imag**2) / size**3
        slopes[:, 1, 1] = self.closed.real * self.closed.imag / size**3
        spread = np.einsum("pij,pjk,pik->pi", slopes, self.covariance, slopes)
        return np.sqrt(np.maximum(spread, 0.0))

    def table(self) -> dict[str, list[Any]]:
        """A row each closed-loop pole."""
        return {
            "real": self.closed.real.tolist(),
            "imaginary": self.closed.imag.tolist(),
            "frequency_hz": self.frequency_hz.tolist(),
            "damping": self.damping.tolist(),
            "frequency_std_hz": self.std_error[:, 0].tolist(),
            "damping_std": self.std_error[:, 1].tolist(),
        }

    def summary(self) -> list[str]:
        """Whether the loop is stable, with and without its controller, and the findings."""
        grows = int(np.sum(growing(self.open)))
        state = "stable" if growing(-self.closed).all() else "neutral: a pole neither grows nor decays"
        state = "unstable" if growing(self.closed).any() else state
        lines = [
            f"the closed loop is {state}; with the controller off {grows} pole{' grows' if grows == 1 else 's grow'}"
        ]
        return [*lines, *self.finding_lines()]

    def to_json(self) -> dict[str, Any]:
        """Plain data; poles are [re, im]."""
        return plain(
            {
                "rig": self.model.rig.name,
                "closed": [
                    {
                        "pole": pole,
                        "frequency_hz": frequency,
                        "damping": damping,
                        "covariance": None if np.isnan(spread).any() else spread.tolist(),
                    }
                    for pole, frequency, damping, spread in zip(
                        self.closed.tolist(),
                        self.frequency_hz.tolist(),
                        self.damping.tolist(),
                        self.covariance,
                        strict=True,
                    )
                ],
                "open": self.open.tolist(),
                **self.findings_as_dict(),
            }
        )

    def __str__(self) -> str:
        head = f"{'pole [1/s]':>28s} {'Hz':>10s} {'+-':>8s} {'damping':>9s} {'+-':>8s}"
        lines = [head, "-" * len(head)]
        for pole, frequency, damping, (of_frequency, of_damping) in zip(
            self.closed, self.frequency_hz, self.damping, self.std_error, strict=True
        ):
            text = f"{pole.real:.5g}"
            if pole.imag:  # below the digits printed, a pair is a double real pole
                text += f" +- {pole.imag:.5g}j" if pole.imag > 1e-5 * abs(pole) else " (double)"
            spread = f" {of_frequency:8.2g} {damping:9.4f} {of_damping:8.2g}"
            lines.append(f"{text:>28s} {frequency:10.4f}{spread}".replace("nan", "  -"))
        return "\n".join([*lines, "", *self.summary()])


def pole_map(model: Model) -> PoleMap:
    """Find the poles of the plant and of the closed loop, the latter with their uncertainty.

    Parameters
    ----------
    model : Model
        Such as `Estimate.model`; nonlinear effects are excluded, which is a finding.

    Returns
    -------
    PoleMap
    """
    linear, findings = of_small_motion(model)
    uncertainty = Uncertainty.of(linear)
    free = [] if uncertainty is None else list(uncertainty.free)
    modes = linear.loop.modes(linear.theta, free)
    kept = (modes.poles.imag >= 0.0) & np.isfinite(modes.poles)
    poles, slopes = modes.poles[kept], modes.slopes[kept]
    covariance = np.full((len(poles), 2, 2), np.nan)
    if uncertainty is not None:
        parts = np.stack([slopes.real, slopes.imag], axis=1) @ uncertainty.root
        covariance = parts @ parts.transpose(0, 2, 1)
    return PoleMap(model, poles, covariance, _of_plant(linear), tuple(findings))


def growing(poles: ComplexArray) -> NDArray[np.bool_]:
    """Which of the poles of one system have a positive real part beyond rounding."""
    size = np.abs(poles)
    # the same of the largest pole, of those near zero
    rounding = np.where(poles.imag == 0.0, 0.0, ROUNDING * size) + 1e-13 * size.max(initial=0.0)
    return np.asarray(poles.real > rounding)


def damping_ratio(poles: ComplexArray) -> FloatArray:
    """Of every pole; 1 of a real one that decays."""
    return -poles.real / np.maximum(np.abs(poles), np.finfo(float).tiny)


def _of_plant(model: Model) -> ComplexArray:
    """Poles from the commands to the outputs, upper half."""
    plant = open_plant(model.rig, model.acting, (), model.structure.reference)
    values = {slot: p.value for p in model.parameters for slot in p.slots}
    found = np.linalg.eigvals(plant.closed(values)[0]).astype(complex)
    return found[found.imag >= 0.0]
