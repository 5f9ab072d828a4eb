"""Experiments on a compiled loop: what drives it, its response from rest, and what an instrument would record."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ambid.arrays import FloatArray
from ambid.errors import ModelError, RecordError
from ambid.loop.loop import Loop
from ambid.model.structure import Structure
from ambid.record import Record

__all__ = ["inputs", "inputs_of", "simulated", "virtual_experiment"]


def inputs(structure: Structure, i_e: FloatArray, record: Record | None = None) -> FloatArray:
    """The excitation i_e [A], shape (N, axes), and beside it what effects drive the loop with, shape (N, inputs)."""
    waves = [effect.waveform(structure.rig, len(i_e), record) for effect in structure.acting]
    return np.hstack([i_e, *waves]) if any(wave.shape[1] for wave in waves) else i_e


def inputs_of(structure: Structure, record: Record) -> FloatArray:
    """The same during a record.

    Raises
    ------
    RecordError
        If i_e was neither logged nor rebuilt.
    """
    if record.i_e is None:
        raise RecordError(
            f"{record.path or record.name}: i_e was not logged; load the record with its rig, whose controller "
            "rebuilds it"
        )
    return inputs(structure, record.i_e, record)


def simulated(structure: Structure, loop: Loop, theta: FloatArray, i_e: ArrayLike) -> Record:
    """Response from rest to an excitation, shape (N, axes) [A], without noise.

    Raises
    ------
    UnstableLoopError
        If the closed loop is unstable.
    """
    excitation = np.asarray(i_e, dtype=np.float64)
    return _record("simulated", structure, excitation, loop.simulate(theta, inputs(structure, excitation)))


def virtual_experiment(
    structure: Structure,
    loop: Loop,
    theta: FloatArray,
    i_e: ArrayLike,
    *,
    sensor_noise: float,
    current_noise: float,
    seed: int | None,
) -> Record:
    """What an instrument would record; `loop` has sensor noise as further inputs, see `Model.virtual_experiment`."""
    for name, rms in {"sensor_noise": sensor_noise, "current_noise": current_noise}.items():
        if not (np.isfinite(rms) and rms >= 0.0):
            raise ModelError(f"{name} = {rms:g}: expected an rms of 0 or more, in m or A")
    if seed is not None and seed < 0:
        raise ModelError(f"seed = {seed}: expected a whole number of 0 or more")
    excitation = np.asarray(i_e, dtype=np.float64)
    random = np.random.default_rng(seed)
    noise = sensor_noise * random.standard_normal(excitation.shape)
    outputs = loop.simulate(theta, np.hstack([inputs(structure, excitation), noise]))
    outputs[:, len(structure.rig.axes) :] += current_noise * random.standard_normal(excitation.shape)
    return _record("virtual experiment", structure, excitation, outputs)


def _record(name: str, structure: Structure, excitation: FloatArray, outputs: FloatArray) -> Record:
    rig, n = structure.rig, len(structure.rig.axes)
    record = Record(name, rig.sample_rate, rig.axes, excitation, outputs[:, :n], outputs[:, n:])
    return record if structure.reference is rig else record.at(rig)
