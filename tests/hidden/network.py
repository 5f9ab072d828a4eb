"""A machine as states, held inputs and nonlinear ports, and its run in time by integrator.c."""

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from scipy.linalg import expm

SOURCE = Path(__file__).with_name("integrator.c")
CAPACITY = 384  # states, inputs and ports of one machine
LAWS = (
    *("delay", "magnet", "limit", "hysteresis", "friction", "polynomial", "contact", "dead_band", "quantiser"),
    *("ramp", "parametric", "softening", "asymmetry", "flux", "product"),
)
PARAMETERS, MEMORY, BLOCK = 8, 8, 16


def compiler() -> str | None:
    """Path of a C compiler, or None; without one there are no hidden records."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


class Network:
    """Builds ``x' = A x + B u + G w`` from signals; a signal is an array (k, CAPACITY) of rows over everything.

    Constant matrices act on signals by ``@``, signals add. A port reads signals that were made before it: there is no
    algebraic loop.
    """

    def __init__(self) -> None:
        self._of: dict[str, list[int]] = {"states": [], "inputs": [], "ports": []}
        self._rates: dict[int, np.ndarray] = {}
        self._start: list[float] = []
        self._ports: list[tuple[int, list[float], np.ndarray, bool]] = []

    def states(self, start: Sequence[float]) -> np.ndarray:
        """Give new states with their initial values; `rate` says how they move."""
        self._start += list(start)
        return self._new("states", len(start))

    def inputs(self, count: int) -> np.ndarray:
        """Give new inputs, held over each piece of time."""
        return self._new("inputs", count)

    def rate(self, states: np.ndarray, slope: np.ndarray) -> None:
        """Let ``d states / dt = slope``."""
        for state, row in zip(np.argmax(states, axis=1), slope, strict=True):
            self._rates[int(state)] = row

    def port(self, law: str, parameters: Sequence[float], *read: np.ndarray, held: bool = False) -> np.ndarray:
        """Signal, shape (1, CAPACITY), of a law of integrator.c that reads one or two signals (a row each).

        `held` says that what it reads is constant over each piece, so that it needs no fine steps.
        """
        rows = np.zeros((2, CAPACITY))
        rows[: len(read)] = np.concatenate([np.atleast_2d(signal) for signal in read])
        numbers = [*map(float, parameters), *[0.0] * (PARAMETERS - len(parameters))]
        self._ports.append((LAWS.index(law), numbers, rows, held))
        return self._new("ports", 1)

    def each(
        self, law: str, parameters: Sequence[Sequence[float]], *read: np.ndarray, held: bool = False
    ) -> np.ndarray:
        """One port per row of the signals, with its own parameters; shape (rows, CAPACITY)."""
        rows = zip(parameters, *read, strict=True)
        return np.concatenate([self.port(law, numbers, *signals, held=held) for numbers, *signals in rows])

    @property
    def needs_fine_steps(self) -> bool:
        """Whether a port reads something that moves within a piece."""
        return any(not held for *_, held in self._ports)

    def _new(self, kind: str, count: int) -> np.ndarray:
        first = sum(len(indices) for indices in self._of.values())
        self._of[kind] += range(first, first + count)
        return np.eye(count, CAPACITY, first)

    def run(
        self,
        outputs: np.ndarray,
        inputs: np.ndarray,
        *,
        piece: float,
        pieces: int,
        steps: int,
        warm_up: int,
        controller: tuple[np.ndarray, ...] | None,
    ) -> np.ndarray | None:
        """Run from the initial values.

        Parameters
        ----------
        outputs : ndarray, shape (k, CAPACITY)
            Signals to record at each sample; the measured displacements first.
        inputs : ndarray, shape (warm_up + N, 2 axes)
            Excitation [A] and sensor noise [m] of each axis.
        piece : float
            Time over which inputs are held [s]; `pieces` of them make a sample, `steps` steps make a piece.
        warm_up : int
            Samples that are not recorded.
        controller : tuple of ndarray, optional
            Discrete A, B, C, D that runs once a piece.

        Returns
        -------
        ndarray, shape (N, k), or None
            None if the rotor has left the machine.
        """
        x, u, w = self._of["states"], self._of["inputs"], self._of["ports"]
        h = piece / steps
        everything = x + u + w
        delay = LAWS.index("delay")
        parameters = np.array([numbers for _, numbers, *_ in self._ports]).reshape(len(w), PARAMETERS)
        law = np.array([kind for kind, *_ in self._ports], dtype=np.int32)
        for j in np.flatnonzero(law == delay):  # whole steps and the rest of one
            behind = parameters[j, 0] / h
            whole = np.floor(behind + 1e-9)
            parameters[j, :2] = whole, behind - whole if behind - whole > 1e-9 else 0.0
        slope = np.array([self._rates[i] for i in x])
        A, B, G = slope[:, x], slope[:, u], slope[:, w]
        jump = np.zeros_like(G)
        for fraction in np.unique(parameters[(law == delay) & (parameters[:, 1] > 0.0), 1]):
            late = (law == delay) & (parameters[:, 1] == fraction)
            jump[:, late] = _held(A, G[:, late], (1.0 - fraction) * h)[1]
        E, held, rise = _held(A, np.hstack([B, G]), h)
        reads = np.concatenate([rows for *_, rows, _ in self._ports]) if w else np.zeros((0, CAPACITY))
        signals = max(len(inputs) - warm_up, 0), len(outputs)
        arrays = {
            "step": _columns(np.hstack([E, held, rise[:, len(u) :]])),
            "jump": _columns(jump),
            "z": _columns(reads[:, everything]),
            "out": _columns(outputs[:, everything]),
            "law": law,
            "parameters": parameters,
        }
        arrays |= dict(zip("ABCD", controller, strict=True)) if controller else {}
        arrays = {
            name: np.ascontiguousarray(a, dtype=a.dtype if name == "law" else float) for name, a in arrays.items()
        }
        machine = _Machine(
            *(len(x), len(u), len(w), inputs.shape[1] // 2, len(outputs), len(controller[0]) if controller else 0),
            *(steps, pieces, len(inputs), warm_up),
            h,
            **{name: array.ctypes.data for name, array in arrays.items()},
        )
        state, recorded = np.array(self._start), np.zeros(signals)
        inputs = np.ascontiguousarray(inputs, dtype=float)
        run = library().run
        run.argtypes = [ctypes.POINTER(_Machine), *[ctypes.c_void_p] * 3]
        done = run(machine, state.ctypes.data, inputs.ctypes.data, recorded.ctypes.data)
        return recorded if done == len(inputs) else None


def _columns(matrix: np.ndarray) -> np.ndarray:
    """Columns one after the other, filled up to whole blocks."""
    return np.pad(matrix.T, ((0, 0), (0, -len(matrix) % BLOCK)))


def _held(A: np.ndarray, B: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices of x <- E x + F u + R du for ``x' = A x + B (u + du t / h)`` over h, exactly."""
    n, m = B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m] = A * h, B * h
    block[n : n + m, n + m :] = np.eye(m)
    power = expm(block)
    return power[:n, :n], power[:n, n : n + m], power[:n, n + m :]


class _Machine(ctypes.Structure):
    _counts = (
        *("states", "inputs", "ports", "axes", "outputs", "controller_states"),
        *("steps", "pieces", "samples", "warm_up"),
    )
    _arrays = ("step", "jump", "z", "out", "law", "parameters", "A", "B", "C", "D")
    _fields_ = (
        *((name, ctypes.c_int32) for name in _counts),
        ("h", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in _arrays),
    )


@cache
def library() -> ctypes.CDLL:
    """integrator.c, compiled for this machine at first use and kept among the temporary files."""
    command = [compiler() or "cc", "-O3", "-march=native", "-shared", "-fPIC", str(SOURCE), "-lm"]
    digest = hashlib.sha256(SOURCE.read_bytes() + " ".join(command).encode()).hexdigest()[:16]
    target = Path(tempfile.gettempdir()) / f"ambid-hidden-{os.getuid()}-{digest}.so"
    if not target.exists():
        with tempfile.NamedTemporaryFile(dir=target.parent, suffix=".so", delete=False) as unfinished:
            pass
        subprocess.run([*command, "-o", unfinished.name], check=True)
        os.replace(unfinished.name, target)
    found = ctypes.CDLL(str(target))
    found.iron.restype = found.port_law.restype = ctypes.c_double
    found.iron.argtypes = [ctypes.c_int, ctypes.c_double]
    found.port_law.argtypes = [ctypes.c_int, *[ctypes.c_void_p] * 2, ctypes.c_double, ctypes.c_void_p]
    found.run.restype = ctypes.c_int32
    return found


def law(name: str, parameters: Sequence[float], read: Sequence[float], t: float = 0.0, memory=None) -> float:
    """Value of one port of integrator.c, for tests."""
    numbers = np.array([*parameters, *[0.0] * (PARAMETERS - len(parameters))], dtype=float)
    z = np.array([*read, 0.0], dtype=float)
    memory = np.zeros(MEMORY) if memory is None else memory
    return library().port_law(LAWS.index(name), numbers.ctypes.data, z.ctypes.data, t, memory.ctypes.data)
