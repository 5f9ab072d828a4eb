"""How large an effect has to be to be seen: parameters of three sizes, kept in sizes.json.

`python -m hidden.sizes`, run in the folder of the tests, finds them anew; with names of machines, those of these alone.
The score of an effect is the rise of J that it should cause in a record of the bench: the noise-free difference between
the records with and without it, whitened by the spectrum of the loop's noise, less what the base parameters K_i, K_s,
tau_e can absorb of it. It is summed over the excited lines, or over all lines for effects that show elsewhere. It grows
about as the square of the size, which leads the search to sizes too small and too large; from there on it bisects, in
the logarithm of the size.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.fft import rfft

from .bench import MachineFailure, simulate, simulate_all
from .families import BENCHES, FAMILIES, Bench
from .tolerances import machine_off

FILE = Path(__file__).with_name("sizes.json")
TARGETS = {"barely": 30.0, "clear": 1e4, "large": 1e6}
NEIGHBOURS = 2  # lines to each side that share a noise spectrum; a bending mode is hardly wider
NOISE_RECORDS = 60
OFF_MACHINES = 60  # twice as many as there are errors


@dataclass(frozen=True)
class Sized:
    """An effect of a known size.

    Attributes
    ----------
    parameters : dict
        As `bench.simulate` takes them.
    amplitude : float
        Of the excitation [A].
    score : float
        Rise of J that it should cause; less than asked for where no physical size reaches that.
    """

    parameters: dict
    amplitude: float
    score: float


def sized(effect: str, size: str, bench: str = "bench") -> Sized:
    """An effect that is "barely" visible, "clear" or "large", from sizes.json."""
    return Sized(**_stored()[bench][effect][size])


@cache
def _stored() -> dict:
    return json.loads(FILE.read_text())


Hidden = Mapping[str, Mapping[str, object]]
"""Parameters of effects, by name."""


def score(
    bench: Bench, hidden: Hidden, amplitude: float, *, on_all_lines: bool = False, beside: Hidden | None = None
) -> float:
    """Rise of J that hidden effects should cause in a noisy record of the bench, beside others that are known.

    Raises
    ------
    MachineFailure
        If the rotor leaves its air gap.
    """
    others = dict(beside or {})
    effects = (*hidden, *others)
    yardstick = _yardstick(bench, bench.known_to(effects).to_toml(), on_all_lines)
    job = _job(bench, effects, amplitude)
    with_it, without = (_signals(simulate(**job, hidden=h)) for h in (others | dict(hidden), others))
    difference = yardstick.whiten(with_it - without).ravel()
    left = difference - yardstick.base @ (yardstick.base.T @ difference)
    return float(left @ left)


def score_beside_tolerances(
    bench: Bench, hidden: Hidden, amplitude: float, *, on_all_lines: bool = False, beside: Hidden | None = None
) -> float:
    """The same where the rig file is off by ordinary tolerances: what their errors cannot absorb as likely as not.

    The errors are of first order and normal, so that what machines that are off by a draw each differ by has the
    covariance T T', and ``d' (1 + T T')^-1 d`` is left of a difference d.
    """
    others = dict(beside or {})
    rig, i_e = bench.known_to((*hidden, *others)), bench.excitation(amplitude)
    yardstick = _yardstick(bench, rig.to_toml(), on_all_lines)
    with_it, without = (
        _signals(simulate(rig, i_e, h, seed=None, **bench.truth)) for h in (others | dict(hidden), others)
    )

    def change(signals: np.ndarray) -> np.ndarray:
        white = yardstick.whiten(signals - without).ravel()
        return white - yardstick.base @ (yardstick.base.T @ white)

    difference, off = change(with_it), []
    for seed in range(OFF_MACHINES):
        with suppress(MachineFailure):
            off.append(change(_signals(machine_off(rig, seed).record(i_e, None, others, **bench.truth))))
    spread = np.column_stack(off) / np.sqrt(len(off))
    seen = spread.T @ difference
    absorbed = seen @ np.linalg.solve(np.eye(len(off)) + spread.T @ spread, seen)
    return float(difference @ difference - absorbed)


@dataclass(frozen=True)
class _Yardstick:
    bench: Bench
    on_all_lines: bool
    factor: np.ndarray
    base: np.ndarray  # orthonormal columns that span what the base parameters can do

    def whiten(self, signals: np.ndarray) -> np.ndarray:
        """Whitened lines, shape (lines, 2 axes, 2)."""
        return _whitened(self.bench, self.factor, signals, self.on_all_lines)


def _lines(bench: Bench, signals: np.ndarray) -> np.ndarray:
    kept = signals[bench.period :]
    return rfft(kept, axis=0) / np.sqrt(len(kept))


def _whitened(bench: Bench, factor: np.ndarray, signals: np.ndarray, on_all_lines: bool) -> np.ndarray:
    every = 1 if on_all_lines else bench.periods - 1
    lines = _lines(bench, signals)[every:-1:every]
    white = np.sqrt(2.0) * np.linalg.solve(factor[every:-1:every], lines[..., None])[..., 0]
    return np.stack([white.real, white.imag], axis=-1)


@cache
def _yardstick(bench: Bench, rig_text: str, on_all_lines: bool) -> _Yardstick:
    """Noise spectrum and base parameters, by finite differences, of a bench with this rig file."""
    rig = type(bench.rig).from_toml(rig_text)
    truth = bench.truth
    still = np.zeros_like(bench.excitation(1.0))
    noise = [{"rig": rig, "i_e": still, **truth, **bench.noise, "seed": seed} for seed in range(NOISE_RECORDS)]
    power = 0.0
    for record in simulate_all(noise):
        lines = _lines(bench, _signals(record))
        power = power + np.einsum("lc,ld->lcd", lines, lines.conj()) / NOISE_RECORDS
    power[0] = 0.0
    width = 2 * NEIGHBOURS + 1
    summed = np.cumsum(np.pad(power, ((NEIGHBOURS + 1, NEIGHBOURS), (0, 0), (0, 0)), mode="edge"), axis=0)
    factor = np.linalg.cholesky((summed[width:] - summed[:-width]) / width)

    excited = {"rig": rig, "i_e": bench.excitation(bench.amplitude), "seed": None}
    jobs = []
    for name, values in truth.items():
        values = np.atleast_1d(values)
        for change in np.diag(1e-3 * values):
            jobs += [{**excited, **truth, name: values + change}, {**excited, **truth, name: values - change}]
    signals = [_signals(record) for record in simulate_all(jobs)]
    columns = [
        _whitened(bench, factor, more - less, on_all_lines).ravel()
        for more, less in zip(signals[::2], signals[1::2], strict=True)
    ]
    columns = [column / np.linalg.norm(column) for column in columns]
    return _Yardstick(bench, on_all_lines, factor, np.linalg.qr(np.column_stack(columns))[0])


def _job(bench: Bench, effects: tuple[str, ...], amplitude: float) -> dict:
    return {
        "rig": bench.known_to(effects),
        "i_e": bench.excitation(amplitude),
        **bench.truth,
        "seed": None,
    }


def _signals(record) -> np.ndarray:
    return np.hstack([record.y, record.i_c])


def find(effect: str, target: float, bench: Bench, tolerance: float = 0.1) -> Sized:
    """Search the size of an effect whose score is the target within `tolerance`, or the largest that is physical."""
    family = FAMILIES[effect]
    low, high, x = 0.0, np.inf, family.first
    best, off = None, np.inf
    while low == 0.0 or high / low > 1.002:
        x = float(f"{x:.4g}")
        parameters, amplitude = family.at(x, bench), x if family.by_amplitude else bench.amplitude
        try:
            found = score(bench, {effect: parameters}, amplitude, on_all_lines=family.on_all_lines)
        except MachineFailure:
            found = np.inf
        miss = abs(np.log(max(found, 1e-9) / target))
        if miss < off:
            best, off = Sized(parameters, amplitude, float(f"{found:.4g}")), miss
        if miss < tolerance or (found < target and x >= family.most):
            break
        low, high = (x, high) if found < target else (low, x)
        bracketed = low > 0.0 and np.isfinite(high)
        guess = min(x * np.clip(np.sqrt(target / max(found, 1e-9)), 0.1, 10.0), family.most)
        x = np.sqrt(low * high) if bracketed else guess
    assert best is not None, f"{effect}: no size is stable"
    return best


def main(benches: Sequence[str]) -> None:
    """Find the sizes of some machines and write them into sizes.json."""
    stored: dict = json.loads(FILE.read_text())
    for name in benches:
        found: dict = {}
        for effect in FAMILIES:
            sizes = {size: vars(find(effect, target, BENCHES[name])) for size, target in TARGETS.items()}
            found[effect] = sizes
            print(
                name, effect, *(f"{size}: {s['score']:.4g} {s['parameters']}" for size, s in sizes.items()), flush=True
            )
        FILE.write_text(json.dumps(stored | {name: found}, indent=1) + "\n")
        stored[name] = found


if __name__ == "__main__":
    main(sys.argv[1:] or list(BENCHES))
