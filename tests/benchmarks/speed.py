"""Speed of a 24-state, nine-parameter, two-plane loop over 20 000 samples: ambid, a NumPy loop, Numba, python-control.

Run from `tests` with ``python benchmarks/speed.py``; no part of the tests. Times are the least of several runs.
"""

import resource
import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

from ambid import _core
from ambid.excitation import prbs
from ambid.identification import identify
from ambid.model import Model
from ambid.rig import ModalRotor, Rig
from virtual import VirtualBench

SAMPLES = 20_000
ORDER, HOLD = 10, 2
PERIOD = HOLD * (2**ORDER - 1)


def rigid(rig: Rig) -> Rig:
    """The bench without its bending mode: 2 planes of 4 mechanical, 2 + 2 electrical and 4 controller states."""
    modes = rig.rotor
    rotor = ModalRotor(
        frequencies_hz=modes.frequencies_hz[:2],
        damping=modes.damping[:2],
        positions=modes.positions,
        shapes=modes.shapes[:2],
    )
    return rig.replace(rotor=rotor)


def excitation(samples: int) -> np.ndarray:
    return prbs(ORDER, amplitude=0.15, hold=HOLD, axes=4, periods=-(-samples // PERIOD))[:samples]


def least_time(job: Callable[[], object], repeats: int = 5) -> float:
    """Shortest wall time of `repeats` runs [s]."""
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        job()
        times.append(time.perf_counter() - begun)
    return min(times)


def recursion(a, b, c, d, u):
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], a sample at a time."""
    x, y = np.zeros(len(a)), np.empty((len(u), len(c)))
    for k in range(len(u)):
        y[k] = c @ x + d @ u[k]
        x = a @ x + b @ u[k]
    return y


def lft_matrices(model: Model, theta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Continuous A, B, C, D of the closed loop, with the parameters put into Delta by NumPy."""
    lft, fills = model.loop.lft, {slot: i for i, p in enumerate(model.parameters) for slot in p.slots}
    gains = np.array([port.scale * theta[fills[port.slot]] ** port.power for port in lft.ports])
    inputs, outputs = len(lft.inputs), len(lft.outputs)
    b, bw, c, cz = lft.B[:, :inputs], lft.B[:, inputs:], lft.C[:outputs], lft.C[outputs:]
    d, dw, dz, dzw = (
        lft.D[:outputs, :inputs],
        lft.D[:outputs, inputs:],
        lft.D[outputs:, :inputs],
        lft.D[outputs:, inputs:],
    )
    closed = np.linalg.solve(np.eye(len(gains)) - gains[:, None] * dzw, np.diag(gains))
    return lft.A + bw @ closed @ cz, b + bw @ closed @ dz, c + dw @ closed @ cz, d + dw @ closed @ dz


def held(a: np.ndarray, b: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    n, m = b.shape
    block = expm(np.block([[a, b], [np.zeros((m, n + m))]]) * dt)
    return block[:n, :n], block[:n, n:]


def simulate_with(run: Callable, model: Model, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    a, b, c, d = lft_matrices(model, theta)
    return run(*held(a, b, model.loop.sample_time), c, d, u)


def jacobian_with(run: Callable, model: Model, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Forward differences: one more simulation per parameter."""
    base = simulate_with(run, model, theta, u)
    steps = 1e-6 * theta
    return np.stack(
        [
            (simulate_with(run, model, theta + s * e, u) - base) / s
            for s, e in zip(steps, np.eye(len(theta)), strict=True)
        ],
        axis=2,
    )


def identify_with(run: Callable, start: Model, record) -> np.ndarray:
    """The same least squares, with weights of the signals' own rms and SciPy's forward differences."""
    z = np.hstack([record.y, record.i_c])
    weight, theta = 1.0 / z.std(axis=0), start.theta

    def residual(x):
        left = weight * (z - simulate_with(run, start, x * theta, record.i_e))
        return (left - left.mean(axis=0)).ravel()

    return least_squares(residual, np.ones(len(theta)), xtol=1e-8, ftol=1e-10).x * theta


def runners() -> dict[str, Callable]:
    """How the others run the recursion; those that are not installed are left out, and said so."""
    found: dict[str, Callable] = {"numpy loop": recursion}
    try:
        from numba import njit
    except ImportError:
        print("numba is not installed")
    else:
        compiled = njit(recursion)
        found["numba loop"] = lambda *system: compiled(*map(np.ascontiguousarray, system))
    try:
        import control
    except ImportError:
        print("python-control is not installed")
    else:

        def by_control(a, b, c, d, u):
            return control.forced_response(control.ss(a, b, c, d, True), inputs=u.T).outputs.T

        found["python-control"] = by_control
    return found


def compare_speed(model: Model, start: Model) -> None:
    u = excitation(SAMPLES)
    record = start.virtual_experiment(u, seed=1)
    theta, free = model.theta, list(range(len(model.theta)))
    exact = model.loop.simulate(theta, u)
    own = {
        "simulation": least_time(lambda: model.loop.simulate(theta, u)),
        "residual + Jacobian": least_time(lambda: model.loop.sensitivity(theta, u, free)),
        "identification": least_time(lambda: identify(start, record), 2),
    }
    print(f"{'':16s}" + "".join(f"{job:>32s}" for job in own))
    print(f"{'ambid':16s}" + "".join(f"{1e3 * seconds:>29.1f} ms" for seconds in own.values()))
    for name, run in runners().items():
        simulated = simulate_with(run, model, theta, u)  # compiles, and checks
        error = np.max(np.abs(simulated - exact).max(axis=0) / np.abs(exact).max(axis=0))
        assert error < 1e-8, f"{name} differs by {error:.1e}"
        times = [
            least_time(lambda run=run: simulate_with(run, model, theta, u), 2),
            least_time(lambda run=run: jacobian_with(run, model, theta, u), 1),
            least_time(lambda run=run: identify_with(run, start, record), 1),
        ]
        cells = [f"{1e3 * t:>16.1f} ms ({t / o:7.1f} x)" for t, o in zip(times, own.values(), strict=True)]
        print(f"{name:16s}" + "".join(f"{cell:>32s}" for cell in cells))


def show_growth(model: Model) -> None:
    """Time of the normal equations per sample, and the memory that one evaluation takes beside its data."""
    theta, free = model.theta, list(range(len(model.theta)))
    print(
        f"\n{'samples':>10s} {'normal equations':>20s} {'per sample':>14s} {'Python heap':>14s} {'process peak':>16s}"
    )
    for samples in (SAMPLES, 2 * SAMPLES, 4 * SAMPLES, 8 * SAMPLES, 16 * SAMPLES):
        u = excitation(samples)
        z = model.loop.simulate(theta, u)
        data = _core.Data(model.loop.core, u, z, np.ones(z.shape[1]))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        seconds = least_time(lambda data=data: _core.normal_equations(model.loop.core, theta, free, [data]), 3)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        tracemalloc.start()
        _core.normal_equations(model.loop.core, theta, free, [data])
        heap = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        print(
            f"{samples:10d} {1e3 * seconds:17.1f} ms {1e9 * seconds / samples:11.0f} ns {heap / 1024:11.1f} kB "
            f"{'+' + str(grown):>13s} kB"
        )


def main() -> None:
    bench = VirtualBench()
    model, start = Model(rigid(bench.rig())), Model(rigid(bench.rig(off=0.08)))
    print(f"{len(model.poles())} states, {len(model.theta)} parameters, {SAMPLES} samples\n")
    compare_speed(model, start)
    show_growth(model)


if __name__ == "__main__":
    main()
