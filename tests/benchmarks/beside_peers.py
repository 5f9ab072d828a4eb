"""The peers' own comparison on their reference problem, with ambid beside them in the same run.

    python tests/benchmarks/beside_peers.py FOLDER --task mc --only product --only c-modal --only numba --fits 200
    python tests/benchmarks/beside_peers.py FOLDER --task sim --task jac --task fit

FOLDER holds their `peers.py` and `rig.py`: a rigid rotor in two bearings, 24 states, nine parameters, 20 000 samples of
the four displacements. What is not named below goes to their program as it is. The product's `fit` is one descent in
the core, from their start, 20 to 28 % off, with J'J for intervals. `--fits` adds what their tasks have no place for, on
the same records in the same run: many identifications at once, on one thread and on two, beside the yardstick's own
Levenberg-Marquardt on one core. No part of the tests.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

# Processes that the peers start import this file anew, and find the folder there. It stands in the place of this
# script's own, whose `coverage.py` numba would take for the package of that name.
sys.path.pop(0)
sys.path.insert(0, os.environ.setdefault("PEERS_FOLDER", str(Path(sys.argv[min(1, len(sys.argv) - 1)]).resolve())))

import numpy as np
import peers

import ambid
import rig as problem
from ambid import _core
from ambid.identification import identify_many
from ambid.identification.many import fit_for_core
from ambid.identification.problem import Descent, Problem
from ambid.rig import Rig

NAMES = ("A_zeta", "A_eta", "B_zeta", "B_eta")


def machine(theta: np.ndarray) -> Rig:
    """The peers' machine with the values of a theta: K_i and K_s of the four axes, tau_e."""
    middle = np.unique(np.concatenate([problem.Z_ACT, problem.Z_SEN]))
    shapes = [np.full(len(middle), problem.MASS**-0.5), middle / problem.INERTIA**0.5]
    bearings = [
        {
            "name": name,
            "position": problem.Z_ACT[k] - middle[0],
            "sensor_position": problem.Z_SEN[k] - middle[0],
            "bias_current": 10.0,
            "air_gap": 1e-3,
            "force_current": theta[k : k + 2].tolist(),
            "force_displacement": theta[4 + k : 6 + k].tolist(),
        }
        for name, k in (("A", 0), ("B", 2))
    ]
    return Rig.model_validate(
        {
            "name": "rig of the peers",
            "sample_rate": problem.FS,
            "rotor": {
                "kind": "modes",
                "frequencies_hz": [0.0, 0.0],
                "damping": [0.0, 0.0],
                "positions": (middle - middle[0]).tolist(),
                "shapes": [shape.tolist() for shape in shapes],
            },
            "bearing": bearings,
            "tolerance": {"exact": True},
            "amplifier": {"time_constant": problem.TAU_A},
            "actuator": {"time_constant": theta[8]},
            "controller": {
                "kind": "pid",
                "implementation": "analog",
                "proportional": problem.PID_P.tolist(),
                "integral": problem.PID_I.tolist(),
                "derivative": problem.PID_D.tolist(),
                "derivative_time_constant": problem.TAU_D,
            },
        }
    )


def in_order(model: ambid.Model) -> list[int]:
    """Where the peers' parameters stand among those of a model."""
    names = [f"{kind}.{axis}" for kind in ("K_i", "K_s") for axis in NAMES]
    return [model.names.index(name) for name in [*names, "tau_e"]]


def record_of(u: np.ndarray, y: np.ndarray) -> ambid.Record:
    return ambid.Record.from_arrays(y=y, i_e=u, sample_rate=problem.FS, axes=NAMES)


def descent(start: ambid.Model, record: ambid.Record) -> _core.Fit:
    """All samples of y in the noise that the peers weigh them with."""
    free, count = list(range(len(start.theta))), len(NAMES)
    noise = np.full(2 * count, problem.NOISE_RMS)
    least_squares = Problem(start, (record,), free, [noise], np.repeat([1.0, 0.0], count), None)
    x = start.theta / least_squares.scale
    found = fit_for_core(Descent(least_squares, x, (np.zeros(len(x)), np.full(len(x), np.inf)), 100))
    assert found is not None
    return found


class Product(peers.Peer):
    """Ambid, as it is installed."""

    name, note, jac_kind = "product", f"ambid {ambid.__version__}; fit: one descent in the core", "exact"

    def setup(self) -> None:
        self.start = ambid.Model(machine(problem.THETA0))
        self.order = in_order(self.start)
        self.loop = self.start.loop

    def theta(self, theta: np.ndarray) -> np.ndarray:
        own = np.empty(len(theta))
        own[self.order] = theta
        return own

    def sim(self, theta: np.ndarray) -> np.ndarray:
        return self.loop.simulate(self.theta(theta), self.u)[:, :4]

    def jac(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y, slopes = self.loop.sensitivity(self.theta(theta), self.u, self.order)
        return y[:, :4], slopes[:, :4]

    def fit(self, y_meas: np.ndarray, theta0: np.ndarray) -> tuple[np.ndarray, dict]:
        start = self.start.with_theta(self.theta(theta0))
        (ended,) = _core.fit_all([descent(start, record_of(self.u, y_meas))])
        assert not isinstance(ended, Exception), ended
        np.linalg.inv(ended["hessian"])  # what intervals need
        return ended["theta"][self.order], {"nfev": ended["evaluations"]}


peers.PEERS.insert(0, Product)


def at_once(fits: int, npz: Path) -> None:
    """Many identifications of repeats of the experiment, and the yardstick beside them in turn."""
    peers.TMP, peers.RIG = str(npz.parent), problem.load(npz)
    u, theta0, truth = peers.RIG["u"], peers.RIG["theta0"], problem.THETA_TRUE
    measured = [peers.RIG["y_exact"] + problem.noise(1000 + seed) for seed in range(fits)]
    records = [record_of(u, y) for y in measured]
    yardstick, product = peers.CModal(), Product()
    start, order = product.start, product.order

    def c() -> Sequence[np.ndarray]:
        return [yardstick.fit(y, theta0)[0] for y in measured]

    def descents() -> Sequence[np.ndarray]:
        ended = _core.fit_all([descent(start, own) for own in records])
        assert not any(isinstance(own, Exception) for own in ended)
        return [own["theta"][order] for own in ended if not isinstance(own, Exception)]

    def whole(**options) -> Sequence[np.ndarray]:
        found = identify_many(start, records, **options)
        at = [found.names.index(start.names[k]) for k in order]
        return [own[at] for own in found.values]

    jobs: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "c-modal, own Levenberg-Marquardt": c,
        "ambid, descents with J'J": descents,
        "ambid, identify_many, noise given": lambda: whole(noise={"y": problem.NOISE_RMS}),
    }
    print(f"\n## {fits} repeats at once, {os.environ.get('RAYON_NUM_THREADS', 'all')} threads")
    print("| what | wall, fits/s | processor, fits/s | rms error %, worst |\n|---|--:|--:|--:|")
    for name, job in jobs.items():
        wall, used = time.perf_counter(), time.process_time()
        found = np.array(job())
        wall, used = time.perf_counter() - wall, time.process_time() - used
        rms = 100 * np.sqrt(np.mean((found / truth - 1) ** 2, axis=0)).max()
        print(f"| {name} | {fits / wall:.1f} | {fits / used:.1f} | {rms:.3f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of peers.py and rig.py")
    parser.add_argument("--fits", type=int, default=0, help="repeats of the experiment, identified at once")
    parser.add_argument("--npz", type=Path, default=Path("rig.npz"), help="data of the problem; made if absent")
    given, rest = parser.parse_known_args()
    if not given.npz.exists():
        problem.save(given.npz)
    if rest:
        sys.argv[1:] = [*rest, "--npz", str(given.npz)]
        peers.main()
    if given.fits:
        at_once(given.fits, given.npz)


if __name__ == "__main__":
    main()
