"""Other ways to identify the same loop, beside the product on the same records.

    pip install sippy_unipi
    python tests/benchmarks/comparators.py --seeds 20 --table comparators.md

A mass on one axis under a digital controller, by the independent simulator, with nothing hidden and with a delay of the
loop that no model has. Every way gets the rig file, the record, and the controller's law:

- *Hansen scheme*: the dual Youla parameter R of coprime factors about the rig file's plant, which is identified from
  beta = R alpha as in open loop (Hansen, Franklin, Kosut 1989); K_i, K_s and tau_e are its parameters, as in Lauridsen
  et al., Identifying parameters in AMB systems using LFT formulation and Youla factorization, 2015.
- *grey box*: the closed loop by python-control, fitted to y and i_c by SciPy's `least_squares`.
- *ARX, ARMAX, N4SID* of SIPPY, directly from command to y, of the plant's order; parameters are those whose plant lies
  nearest to the response of the model where the excitation is.

A way rejects a model where its residual is not white (Ljung and Box, 25 lags, 1 %), the product where the misfit is
above its bound. No part of the tests.
"""

import argparse
import contextlib
import io
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.pop(0)  # this folder, whose `coverage.py` numba would take for the package of that name
sys.path.insert(0, str(Path(__file__).parents[1]))

import control
import numpy as np
import scipy.signal
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import chi2

from ambid import Model, Record, diagnose, identify
from benchmarks.grid import markdown
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS

PID = ONE_AXIS.rig.controller.model_copy(update={"implementation": "digital"})
RIG = ONE_AXIS.rig.replace(controller=PID)
DT, MASS, TAU_A = 1.0 / RIG.sample_rate, RIG.rotor.mass, RIG.amplifier.time_constant
START, TRUTH = Model(RIG).theta, np.array([*ONE_AXIS.K_i, *ONE_AXIS.K_s, ONE_AXIS.tau_e])
ORDER, LAGS, LEVEL = 4, 25, 0.01
BAND_HZ = np.geomspace(5.0, 500.0, 60)
HIDDEN = {"nothing": {}, "loop_delay": {"loop_delay": {"seconds": 5e-5}}}
HEAD = (
    *("way", "hidden", "K_i: bias ± spread [%]", "K_s [%]", "tau_e [%]"),
    *("95 % intervals with the truth", "fit of another record [%]", "rejected", "named", "time [s]"),
)
Polynomials = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Found:
    """What a way found: K_i, K_s, tau_e, plant or model, standard errors, residual or judgement, effects."""

    theta: np.ndarray
    plant: Polynomials | Model
    errors: np.ndarray | None = None
    residual: np.ndarray | None = None
    rejects: bool = False
    named: tuple[str, ...] = ()


def plant_of(theta: np.ndarray) -> Polynomials:
    """From command to y, held over a sample."""
    K_i, K_s, tau_e = theta
    lags = np.polymul([TAU_A, 1.0], [tau_e, 1.0])
    b, a, _ = scipy.signal.cont2discrete(([K_i], np.polymul([MASS, 0.0, -K_s], lags)), DT)
    return np.ravel(b), a


def controller() -> Polynomials:
    """The PID by Tustin's rule."""
    s = control.tf("s")
    own = PID.proportional + PID.integral / s + PID.derivative * s / (PID.derivative_time_constant * s + 1.0)
    sampled = control.sample_system(own, DT, "tustin")
    return np.ravel(sampled.num[0][0]), np.ravel(sampled.den[0][0])


LAW = controller()


def characteristic(plant: Polynomials) -> np.ndarray:
    """Of the closed loop."""
    return np.polyadd(np.polymul(LAW[1], plant[1]), np.polymul(LAW[0], plant[0]))


def driven(numerator: np.ndarray, denominator: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """A filter's response from rest, as the records begin."""
    return scipy.signal.lfilter(np.pad(numerator, (len(denominator) - len(numerator), 0)), denominator, signal)


def closed(plant: Polynomials | Model, record: Record) -> np.ndarray:
    """Response of y to i_e."""
    if isinstance(plant, Model):
        return plant.simulate(record.i_e).y[:, 0]
    return driven(np.polymul(plant[0], LAW[1]), characteristic(plant), record.i_e[:, 0])


def command(record: Record) -> np.ndarray:
    """What left the controller, from i_e and y."""
    return record.i_e[:, 0] - driven(*LAW, record.y[:, 0])


def centred(signal: np.ndarray) -> np.ndarray:
    return signal - signal.mean()


def hansen(record: Record) -> Found:
    """N, D of the plant at nominal values, U, V of the law; beta = D y - N u = R (V u + U y) + noise."""
    b_0, a_0 = plant_of(START)
    stable = np.poly([1.0 / p if abs(p) > 1.0 else p for p in np.roots(a_0)]).real
    sigma = np.poly(np.full(len(LAW[1]) - 1, 0.9))
    y, u = record.y[:, 0], command(record)
    alpha = driven(LAW[1], sigma, record.i_e[:, 0])
    beta = driven(a_0, stable, y) - driven(b_0, stable, u)

    def residual(x: np.ndarray) -> np.ndarray:
        b, a = plant_of(x * START)  # R = (D b - N a) sigma / characteristic, factor by factor for its digits
        parts = (driven(np.polymul(own, sigma), characteristic((b, a)), alpha) for own in (b, a))
        R_alpha = np.subtract(*(driven(own, stable, part) for own, part in zip((a_0, b_0), parts, strict=True)))
        return centred(beta - R_alpha) / beta.std()  # the integrator was not at rest

    found = least_squares(residual, np.ones(3), x_scale=0.01, diff_step=1e-4)
    return least_squares_found(found, found.fun)


def least_squares_found(found: OptimizeResult, residual: np.ndarray) -> Found:
    """With the standard errors of a textbook, sigma^2 (J'J)^-1."""
    theta = found.x * START
    errors = START * np.sqrt(found.fun.var() * np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return Found(theta, plant_of(theta), errors, residual)


def grey_box(record: Record) -> Found:
    """As one writes it: blocks, feedback, simulation, least squares."""
    measured_ = np.array([record.y[:, 0], record.i_c[:, 0]])
    law = control.ss(control.tf(*LAW, DT))
    s = control.tf("s")

    def simulated(x: np.ndarray) -> np.ndarray:
        K_i, K_s, tau_e = x * START
        amplifier = control.ss(1.0 / (TAU_A * s + 1.0))
        rotor = control.ss(K_i / (tau_e * s + 1.0) / (MASS * s**2 - K_s))
        both = control.append(rotor, control.ss([], [], [], [[1.0]])) * control.ss([], [], [], [[1.0], [1.0]])
        sampled = control.sample_system(both * amplifier, DT, "zoh")
        loop = control.feedback(sampled, law * control.ss([], [], [], [[1.0, 0.0]], DT))
        return control.forced_response(loop, inputs=record.i_e[:, 0]).outputs

    def residual(x: np.ndarray) -> np.ndarray:
        error = measured_ - simulated(x)
        return ((error - error.mean(axis=1, keepdims=True)) / measured_.std(axis=1, keepdims=True)).ravel()

    found = least_squares(residual, np.ones(3), x_scale=0.01)
    return least_squares_found(found, found.fun[: record.samples])


def black_box(method: str, **options: object) -> Callable[[Record], Found]:
    """A way of SIPPY, from the command to y in micrometres."""

    def identified(record: Record) -> Found:
        from sippy_unipi import system_identification

        y, u = 1e6 * centred(record.y[:, 0]), centred(command(record))
        with contextlib.redirect_stdout(io.StringIO()):
            own = system_identification(y, u, method, tsample=DT, **options)
        if method == "N4SID":
            b, a = scipy.signal.ss2tf(own.A, own.B, own.C, own.D)
        else:
            b, a = own.G.num[0][0], own.G.den[0][0]
        plant = 1e-6 * np.ravel(b), np.ravel(a)
        return Found(nearest(plant), plant, residual=centred(record.y[:, 0] - closed(plant, record)))

    return identified


def nearest(plant: Polynomials) -> np.ndarray:
    """Parameters whose plant has the nearest response in the band, in logarithms."""
    z = np.exp(2j * np.pi * BAND_HZ * DT)

    def error(x: np.ndarray) -> np.ndarray:
        b, a = plant_of(x * START)
        log = np.log(np.polyval(plant[0], z) / np.polyval(plant[1], z) / (np.polyval(b, z) / np.polyval(a, z)))
        return np.r_[log.real, log.imag]

    return least_squares(error, np.ones(3), x_scale=0.01, bounds=(0.01, 100.0)).x * START


def product(record: Record) -> Found:
    estimate = identify(RIG, record)
    errors = np.array([own.std_error for own in estimate.parameters.values()])
    return Found(estimate.model.theta, estimate.model, errors, rejects=not estimate.is_adequate)


def diagnosed(record: Record) -> Found:
    found = diagnose(RIG, record)
    own = [found.parameters[name] for name in Model(RIG).names]
    theta, errors = (np.array([getattr(p, key) for p in own]) for key in ("value", "std_error"))
    return Found(theta, found.model, errors, rejects=found.verdict != "adequate", named=found.effects)


def is_coloured(residual: np.ndarray) -> bool:
    """Whether the test of Ljung and Box rejects a white residual."""
    n, own = len(residual), centred(residual)
    correlation = np.array([own[k:] @ own[:-k] for k in range(1, LAGS + 1)]) / (own @ own)
    return bool(n * (n + 2) * np.sum(correlation**2 / (n - np.arange(1, LAGS + 1))) > chi2.isf(LEVEL, LAGS))


WAYS: dict[str, Callable[[Record], Found]] = {
    "ambid identify": product,
    "ambid diagnose": diagnosed,
    "Hansen scheme": hansen,
    "grey box": grey_box,
    "ARX": black_box("ARX", ARX_orders=[ORDER, ORDER, 1]),
    "ARMAX": black_box("ARMAX", ARMAX_orders=[ORDER, ORDER, ORDER, 1]),
    "N4SID": black_box("N4SID", SS_fixed_order=ORDER),
}


def fit_percent(plant: Polynomials | Model, record: Record) -> float:
    """Of y, not finite where the model's loop is unstable."""
    if not isinstance(plant, Model) and np.abs(np.roots(characteristic(plant))).max() >= 1.0:
        return np.nan
    y = centred(record.y[:, 0])
    return float(100.0 * (1.0 - np.linalg.norm(y - centred(closed(plant, record))) / np.linalg.norm(y)))


def row(way: str, hidden: str, seeds: int) -> list[str]:
    """One way on all records of a machine."""
    errors, inside, fits, rejected, named, seconds = [], [], [], 0, 0, []
    for seed in range(seeds):
        train, other = (
            measured(RIG, ONE_AXIS.excitation(amplitude, own), HIDDEN[hidden], seed=own, **ONE_AXIS.truth)
            for amplitude, own in ((1.0, seed), (0.5, 1000 + seed))
        )
        begun = time.process_time()
        found = WAYS[way](train)
        seconds.append(time.process_time() - begun)
        errors.append(100.0 * (found.theta / TRUTH - 1.0))
        if found.errors is not None:
            inside.append(np.abs(found.theta - TRUTH) < 1.96 * found.errors)
        fits.append(fit_percent(found.plant, other))
        rejected += found.rejects if found.residual is None else is_coloured(found.residual)
        named += hidden in found.named if HIDDEN[hidden] else bool(found.named)
    bias, spread = np.median(errors, axis=0), np.std(errors, axis=0, ddof=1)
    stable = int(np.isfinite(fits).sum())
    fit = f"{np.nanmedian(fits):.2f}" if stable else "-"
    fit += f" ({seeds - stable} unstable)" if stable < seeds else ""
    held = f"{100.0 * np.mean(inside):.0f} %" if inside else "-"
    shown = f"{named} of {seeds}" if way == "ambid diagnose" else "-"
    cells = [f"{b:+.3f} ± {s:.3f}" for b, s in zip(bias, spread, strict=True)]
    return [way, hidden, *cells, held, fit, f"{rejected} of {seeds}", shown, f"{np.median(seconds):.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for hidden in HIDDEN:
        for way in given.ways:
            rows.append(row(way, hidden, given.seeds))
            print(rows[-1], flush=True)
    if given.table:
        given.table.write_text(markdown(HEAD, rows), encoding="utf-8")


if __name__ == "__main__":
    main()
