"""Experiments on a compiled loop: what drives it, its response from rest, and what an instrument would record."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ambid.arrays import FloatArray
from ambid.channels import further
from ambid.errors import ModelError, RecordError
from ambid.loop.loop import Loop
from ambid.model.structure import Structure
from ambid.record import Record
from ambid.rig.fields import LARGEST_VALUE


def inputs(
    structure: Structure, i_e: FloatArray, r: FloatArray | None = None, record: Record | None = None
) -> FloatArray:
    """What drives the loop, shape (N, inputs): i_e [A], the reference r [m] if it has one, and what effects bring."""
    parts = [i_e, *(effect.waveform(structure.rig, len(i_e), record) for effect in structure.acting)]
    if structure.rig.controller.follows_reference:
        parts.insert(1, np.zeros_like(i_e) if r is None else r)
    parts = [part for part in parts if part.shape[1]]
    return np.hstack(parts) if len(parts) > 1 else i_e


def inputs_of(structure: Structure, record: Record) -> FloatArray:
    """The same during a record; r is counted from where the record begins, or from its mean if it repeats.

    Raises
    ------
    RecordError
        If i_e was neither logged nor rebuilt, and no reference drives the loop.
    """
    r = record.r
    if r is not None:
        r = r - (r[0] if record.period is None else r[: record.periods * record.period].mean(axis=0))
        if record.i_e is None and structure.rig.controller.follows_reference:
            return inputs(structure, np.zeros_like(r), r, record)
    if record.i_e is None:
        raise RecordError(
            f"{record.path or record.name}: i_e was not logged; load the record with its rig, whose controller "
            "rebuilds it"
        )
    return inputs(structure, record.i_e, r, record)


def simulated(
    structure: Structure, loop: Loop, theta: FloatArray, i_e: ArrayLike | None, r: ArrayLike | None
) -> Record:
    """Response from rest to an excitation [A] and a reference [m], shape (N, axes) each, without noise.

    Raises
    ------
    ModelError
        If neither is given, or a reference of a controller that has none.
    UnstableLoopError
        If the closed loop is unstable.
    """
    excitation, reference = _drives(structure, i_e, r)
    outputs = loop.simulate(theta, inputs(structure, excitation, reference))
    return _record("simulated", structure, loop, excitation, reference, outputs)


def virtual_experiment(
    structure: Structure,
    loop: Loop,
    theta: FloatArray,
    i_e: ArrayLike | None,
    r: ArrayLike | None,
    *,
    sensor_noise: float,
    current_noise: float,
    further_noise: Mapping[str, float],
    seed: int | None,
) -> Record:
    """What an instrument would record; `loop` has noise as further inputs, see `Model.virtual_experiment`."""
    measured = [name for name in loop.outputs if further((name,), structure.rig.axes)]
    for name, rms in {"sensor_noise": sensor_noise, "current_noise": current_noise, **further_noise}.items():
        if not (np.isfinite(rms) and rms >= 0.0):
            raise ModelError(f"{name} = {rms:g}: expected an rms of 0 or more, in its SI unit")
    if seed is not None and seed < 0:
        raise ModelError(f"seed = {seed}: expected a whole number of 0 or more")
    excitation, reference = _drives(structure, i_e, r)
    random = np.random.default_rng(seed)
    of_y = sensor_noise * random.standard_normal(excitation.shape)
    of_i_c = current_noise * random.standard_normal(excitation.shape)
    is_read = any(name.startswith("n_i.") for name in loop.inputs)
    noise = [of_i_c, of_y] if is_read else [of_y]
    outputs = loop.simulate(theta, np.hstack([inputs(structure, excitation, reference), *noise]))
    if not is_read:
        outputs[:, [loop.outputs.index(f"i_c.{axis}") for axis in structure.rig.axes]] += of_i_c
    for name in measured:
        rms = further_noise.get(name, further_noise.get(name.partition(".")[0], 0.0))
        outputs[:, loop.outputs.index(name)] += rms * random.standard_normal(len(outputs))
    return _record("virtual experiment", structure, loop, excitation, reference, outputs)


def _drives(structure: Structure, i_e: ArrayLike | None, r: ArrayLike | None) -> tuple[FloatArray, FloatArray | None]:
    """Both as arrays; an excitation that is not given is zero."""
    if r is not None and not structure.rig.controller.follows_reference:
        raise ModelError("r is given, but the controller acts on y alone; write reference = true in [controller]")
    if i_e is None and r is None:
        raise ModelError("neither i_e nor r is given; give what drives the loop")
    reference = None if r is None else np.asarray(r, dtype=np.float64)
    excitation = np.zeros_like(reference) if i_e is None else np.asarray(i_e, dtype=np.float64)
    return excitation, reference


def _record(
    name: str,
    structure: Structure,
    loop: Loop,
    excitation: FloatArray,
    reference: FloatArray | None,
    outputs: FloatArray,
) -> Record:
    rig, columns = structure.rig, dict(zip(loop.outputs, outputs.T, strict=True))
    beyond = {channel: columns[channel] for channel in further(loop.outputs, rig.axes)}
    y, i_c = (np.stack([columns[f"{signal}.{axis}"] for axis in rig.axes], axis=1) for signal in ("y", "i_c"))
    signals = {"i_e": excitation, "r": reference, "y": y, "i_c": i_c, **beyond}
    for signal, values in signals.items():
        if values is not None and not (np.abs(values) <= LARGEST_VALUE).all():
            raise ModelError(
                f"{name}: {signal} reaches {np.abs(values).max():.4g}, allowed is {LARGEST_VALUE:g}: its square would "
                "leave floating point; give a smaller excitation, or less noise"
            )
    record = Record(name, rig.sample_rate, rig.axes, excitation, y, i_c, r=reference, further=beyond)
    return record if structure.reference is rig else record.at(rig)
