"""Records made without a machine, as arrays and as files, and ways to break them."""

import numpy as np
from scipy.signal import lfilter

from ambid.excitation import prbs
from ambid.rig import Rig
from places import BENCH

RIG = Rig.load(BENCH)
AXES = RIG.axes
PERIOD = 127 * 2
times = np.arange(5 * PERIOD) / 1e4
MATRICES = {"fs": 1e4, "t": times, "axes": np.array(AXES, dtype=object)}
"""Variables of a .mat beside its signals."""


def measured(periods=5, noise=2e-8, seed=0, cut=0):
    """Keywords of a healthy record: PRBS through a lag, an offset, noise."""
    rng = np.random.default_rng(seed)
    i_e = prbs(7, amplitude=0.2, hold=2, axes=4, periods=periods, seed=seed)
    i_e = i_e[: len(i_e) - cut]
    i_c = 0.3 + lfilter([0, 0.4], [1, -0.6], i_e, axis=0) + rng.normal(0, 1e-3, i_e.shape)
    y = 2e-6 + 5e-6 * lfilter([0, 0.1], [1, -0.9], i_e, axis=0) + rng.normal(0, noise, i_e.shape)
    return {"i_e": i_e, "y": y, "i_c": i_c, "sample_rate": 1e4, "axes": AXES}


def write_csv(path, signals, axes=AXES, t=None, extra=None):
    """A .csv as the contract shows it."""
    samples = len(next(iter(signals.values())))
    columns = {"t": np.arange(samples) / 1e4 if t is None else t} | (extra or {})
    for name, array in signals.items():
        columns |= {f"{name}.{axis}": array[:, j] for j, axis in enumerate(axes)}
    np.savetxt(path, np.stack(list(columns.values()), 1), "%.17g", ",", header=",".join(columns), comments="")
    return path


def signals_of(keywords):
    return {name: keywords[name] for name in ("i_e", "y", "i_c") if keywords.get(name) is not None}


def change(signal, where, value):
    def broken(keywords):
        keywords[signal] = keywords[signal].copy()
        keywords[signal][where] = value
        return keywords

    return broken


def scaled(signal, factor):
    return lambda keywords: keywords | {signal: keywords[signal] * factor}


def clipped(signal, level):
    def broken(keywords):
        x = keywords[signal] - keywords[signal].mean(axis=0)
        x[:, 2] = np.clip(x[:, 2], -level, level * np.ptp(x[:, 2]) / 2)
        return keywords | {signal: x}

    return broken
