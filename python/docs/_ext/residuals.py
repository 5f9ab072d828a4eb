"""What an effect that the model lacks leaves of a fit: drawn on the demo's bench, by a simulation of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import ambid
from ambid.demo import DATA
from ambid.effects import Effect, Seen
from ambid.errors import AmbidError

SPEED = 200.0
"""At which the bench turns [rad/s], so that every effect has its parameters."""
PERIOD, PERIODS, SETTLING = 2046, 4, 4
"""Samples of a period, periods that count, and those before them."""
RMS = 0.8
"""Of the excitation on each axis [A]."""
BAND = (5.0, 4000.0)
"""That is excited, and drawn [Hz]."""
WANTED = 6.0
"""Misfit that the size of an effect is chosen for."""
SIZES = tuple(10.0 ** (0.25 * k) for k in range(17))
"""That are tried, in multiples of the typical small one."""
STRETCH = 0.06
"""Of the signal that is drawn [s]."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shown:
    """An effect at a size that shows.

    Attributes
    ----------
    values : dict of str to float
        Of its parameters.
    residual : ndarray, shape (samples, channels)
        What it leaves of y and i_c when K_i, K_s and tau_e have absorbed what they can.
    misfit : float
        Power of the residual in units of the noise, and 1 for the noise.
    """

    values: dict[str, float]
    residual: Array
    misfit: float


class Bench:
    """The demo's bench in a virtual experiment, with its noise.

    Parameters
    ----------
    resistance : float, optional
        Of coils whose voltage the controller commands [ohm]; by default it commands their current.
    """

    def __init__(self, resistance: float | None = None) -> None:
        rig = ambid.Rig.load(DATA / "rig.toml").replace(speed=SPEED)
        self.rig = rig.replace(amplifier=rig.amplifier.model_copy(update={"resistance": resistance}))
        self.base = ambid.Model(self.rig)
        rate = self.rig.sample_rate
        self.i_e = ambid.multisine(
            PERIOD, rms=RMS, band_hz=BAND, sample_rate=rate, axes=len(self.rig.axes), periods=PERIODS + SETTLING
        )
        self.record = replace(self.base.simulate(self.i_e), period=PERIOD)
        self.seen = self._seen()

    def _seen(self) -> Seen:
        """Near enough: displacements at sensors for those at magnets, currents for commands, excitation for lags."""
        i_f = self.record.i_c
        rate = self.rig.sample_rate * np.diff(i_f, axis=0)
        free = self.record.i_e / self.rig.amplifier.time_constant
        peaks = {"s": self.record.y, "i_ref": i_f, "i_f": i_f, "i_f_rate": rate, "i_a_free": free}
        return Seen(self.rig, {name: float(np.abs(signal).max()) for name, signal in peaks.items()})

    def settled(self, signal: Array) -> Array:
        """The periods that count."""
        return signal[SETTLING * PERIOD :]

    @cached_property
    def noise(self) -> Array:
        """Rms of the noise on each line and channel, shape (lines, channels), from twenty experiments."""
        experiments = (self.base.virtual_experiment(self.i_e, seed=seed).outputs for seed in range(20))
        found = [np.abs(lines(self.settled(noisy - self.record.outputs))) ** 2 for noisy in experiments]
        width = np.ones(9) / 9.0
        return np.sqrt(np.column_stack([np.convolve(column, width, "same") for column in np.mean(found, axis=0).T]))

    @cached_property
    def known(self) -> Array:
        """Orthonormal directions that refitting K_i, K_s and tau_e covers, in whitened lines."""
        _, slopes = self.base.sensitivity(self.record, list(range(len(self.base.names))))
        white = [self.whitened(self.settled(slopes[..., k])) for k in range(slopes.shape[-1])]
        return np.linalg.qr(np.column_stack(white))[0]

    @cached_property
    def slopes(self) -> Array:
        """The same, samples: what each of those directions is in time, shape (samples, channels, directions)."""
        _, slopes = self.base.sensitivity(self.record, list(range(len(self.base.names))))
        return self.settled(slopes)

    def whitened(self, signal: Array) -> Array:
        """All lines of a settled signal over the noise, as real numbers."""
        white = (lines(signal) / self.noise)[1:-1].ravel()
        return np.concatenate([white.real, white.imag])

    def shown(self, effect: Effect) -> Shown:
        """The effect at the first size that leaves a clear misfit; failing that, the largest that was tried."""
        best: Shown | None = None
        for variant in (effect, *effect.variants(self.seen)):
            for size in SIZES:
                tried = self._tried(variant, size)
                if tried is None:
                    break
                if best is None or tried.misfit > best.misfit:
                    best = tried
                if best is not None and best.misfit > WANTED:
                    return best
        if best is None:
            raise RuntimeError(f"{effect.name}: no stable loop with it to draw")
        return best

    def _tried(self, effect: Effect, size: float) -> Shown | None:
        values = effect.start(self.rig, [size] * len(effect.probes(self.rig)))
        try:
            change = self.base.add(effect, values).simulate(self.i_e).outputs - self.record.outputs
        except AmbidError:
            return None  # the loop with it is unstable
        settled = self.settled(change)
        absorbed, *_ = np.linalg.lstsq(self._table, self.whitened(settled), rcond=None)
        left = settled - self.slopes @ absorbed
        excited = 2.0 * PERIOD / 2 * left.shape[1]
        return Shown(values, left, 1.0 + float(np.sum(2.0 * self.whitened(left) ** 2)) / excited)

    @cached_property
    def _table(self) -> Array:
        return np.column_stack([self.whitened(self.slopes[..., k]) for k in range(self.slopes.shape[-1])])


def lines(signal: Array) -> NDArray[np.complex128]:
    """Fourier transform over the root of the samples."""
    return np.fft.rfft(signal, axis=0) / np.sqrt(len(signal))


def draw(bench: Bench, shown: Shown, path: Path) -> None:
    """Residual over noise by frequency, and a stretch of it in time."""
    figure = Figure(figsize=(7.4, 2.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    n = len(bench.rig.axes)
    over = np.abs(lines(shown.residual)) / bench.noise
    frequency = np.arange(len(over)) * bench.rig.sample_rate / len(shown.residual)
    excited = np.arange(len(over)) % PERIODS == 0
    parts: Sequence[tuple[slice, str, str]] = ((slice(0, n), "k", "y"), (slice(n, None), "tab:red", "i_c"))
    for channels, colour, label in parts:
        level = np.sqrt(np.mean(over[:, channels] ** 2, axis=1))
        drawn = _in_bands(frequency[excited], level[excited])
        left.loglog(*drawn, color=colour, linewidth=1.2, label=label, linestyle="-" if label == "y" else (0, (4, 1)))
        at, between = frequency[~excited], level[~excited]
        if between.max() > 1.0:
            rows = "between excited lines" if label == "y" else None
            left.loglog(at[between > 1.0], between[between > 1.0], ".", color=colour, markersize=2.5, label=rows)
    left.axhline(1.0, color="0.6", linewidth=0.8)
    left.set(xlim=BAND, xlabel="frequency [Hz]", ylabel="left, over its noise")
    left.set_ylim(bottom=max(0.02, left.get_ylim()[0]))
    left.legend(frameon=False, fontsize=8)
    worst = int(np.argmax(shown.residual[:, :n].std(axis=0)))
    samples = int(STRETCH * bench.rig.sample_rate)
    time = 1e3 * np.arange(samples) / bench.rig.sample_rate
    right.plot(time, 1e6 * shown.residual[:samples, worst], "k", linewidth=0.8)
    right.set(xlabel="time [ms]", ylabel=f"y.{bench.rig.axes[worst]} left [µm]", xlim=(0.0, 1e3 * STRETCH))
    for ax in (left, right):
        ax.tick_params(labelsize=8)
        ax.xaxis.label.set_size(8)
        ax.yaxis.label.set_size(8)
    figure.savefig(path)


def _in_bands(frequency: Array, level: Array, per_octave: int = 12) -> tuple[Array, Array]:
    """Largest level within bands of equal ratio, so that a single line is not lost."""
    edges = np.geomspace(*BAND, int(per_octave * np.log2(BAND[1] / BAND[0])))
    band = np.digitize(frequency, edges)
    held = [k for k in range(1, len(edges)) if np.any(band == k)]
    return np.array([frequency[band == k].mean() for k in held]), np.array([level[band == k].max() for k in held])
