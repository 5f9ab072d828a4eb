"""Signals of a record moved in time, by parts of a sample too."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.record.record import Record


def shifted(record: Record, signals: Sequence[str], samples: float) -> Record:
    """The record with some of its signals later by a number of samples; earlier where it is negative.

    What repeats is continued by its own period. Of what does not, the samples at the end that nothing is known of are
    left out, of all signals.

    Parameters
    ----------
    record : Record
    signals : sequence of str
        Smooth ones, such as ``y``.
    samples : float
    """
    period, N = record.period, record.samples
    moved: dict[str, Any] = {}
    for name in signals:
        if (own := getattr(record, name)) is not None:
            moved[name] = _later(own, samples, period)
    found = replace(record, **moved)
    if period is not None:
        return found
    lost = ceil(abs(samples))
    return found.rows(lost, N) if samples > 0.0 else found.rows(0, N - lost)


def _later(signal: FloatArray, samples: float, period: int | None) -> FloatArray:
    """A signal later by a number of samples, by the phase of its Fourier series beyond both ends."""
    N = len(signal)
    if period is None:
        beyond = N - 1
        before, after = 2.0 * signal[0] - signal[:0:-1], 2.0 * signal[-1] - signal[-2::-1]
    else:
        beyond = period
        before, after = signal[:period], signal[N - period :]
    long = np.concatenate([before, signal, after])
    turns = np.fft.rfftfreq(len(long)) * samples
    line = np.fft.rfft(long, axis=0) * np.exp(-2j * np.pi * turns)[:, None]
    return np.fft.irfft(line, len(long), axis=0)[beyond : beyond + N]
