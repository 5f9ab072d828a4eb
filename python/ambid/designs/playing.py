"""An excitation as a file to be played: `.csv` and `.mat` in ampere, `.wav` in parts of a stated full scale."""

import struct
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import InputError, RecordError
from ambid.record.writers import require_format, write
from ambid.rig import Rig
from ambid.writing import whole_file

PLAYED = (".csv", ".mat", ".wav")
"""Formats that what drives a machine reads."""
LARGEST = 2**31 - 1
"""Number that full scale has in a `.wav` file, of 32 bits a sample."""


def save_excitation(path: str | Path, rig: Rig, i_e: FloatArray, *, full_scale: float | None = None) -> None:
    """Write an excitation to be played on a machine.

    Parameters
    ----------
    path : str or Path
        ``.csv`` and ``.mat`` hold time and i_e as a record has them; ``.wav`` a channel an axis, 32-bit integers, with
        its scale in a comment of the file.
    rig : Rig
        Names the axes and the sample rate.
    i_e : ndarray, shape (N, axes)
        In the unit of the rig's commands [A], or [V] of voltage-driven coils.
    full_scale : float, optional
        What the largest number in a ``.wav`` file stands for, see `full_scale_of`; by default the peak.

    Raises
    ------
    RecordError
        If the suffix is none of these.
    InputError
        If the excitation is beyond full scale, has other axes than the rig, or the format cannot hold its sample rate.
    OutputError
        If the file cannot be written; what was there stands.
    """
    path = Path(path)
    require_playable(path)
    if i_e.ndim != 2 or i_e.shape[1] != len(rig.axes):
        raise InputError(f"i_e has the shape {i_e.shape}: expected (N, {len(rig.axes)}), a column for each axis of it")
    if path.suffix.lower() != ".wav":
        write(path, rig.sample_rate, rig.axes, {"i_e": i_e})
        return
    scale = full_scale_of(i_e, full_scale)
    if rig.sample_rate != round(rig.sample_rate):
        raise InputError(
            f"{path}: a .wav file holds whole sample rates, and the rig has {rig.sample_rate:g} Hz; write .csv or .mat"
        )
    with whole_file(path) as stream:
        _write_wav(stream, rig, np.round(i_e / scale * LARGEST).astype(np.int32), scale)


def full_scale_of(i_e: FloatArray, full_scale: float | None = None) -> float:
    """What the largest number in a ``.wav`` file stands for.

    Raises
    ------
    InputError
        If the excitation is beyond it.
    """
    peak = float(np.abs(i_e).max())
    if full_scale is None:
        return peak
    if not (np.isfinite(full_scale) and full_scale >= peak):
        raise InputError(f"full scale {full_scale:g}: the excitation has a peak of {peak:.4g}; give that or more")
    return full_scale


def require_playable(path: Path) -> None:
    """Refuse a file of another format.

    Raises
    ------
    RecordError
    """
    suffix = path.suffix.lower()
    if suffix not in PLAYED:
        raise RecordError(f"{path}: {suffix or 'no suffix'} is no format to be played; give {', '.join(PLAYED)}")
    if suffix != ".wav":
        require_format(path)


def _write_wav(stream: BinaryIO, rig: Rig, samples: np.ndarray, scale: float) -> None:
    """The samples, and a comment on what they stand for, in a chunk that players pass over."""
    from scipy.io import wavfile  # slow to import, and seldom needed

    sound = BytesIO()
    wavfile.write(sound, round(rig.sample_rate), samples)
    channels = ", ".join(f"i_e.{axis}" for axis in rig.axes)
    text = f"full scale {LARGEST} = {scale!r} {rig.amplifier.command_unit}; channels {channels}".encode() + b"\0"
    text += b"\0" * (len(text) % 2)
    comment = b"INFOICMT" + struct.pack("<I", len(text)) + text
    whole = bytearray(sound.getvalue() + b"LIST" + struct.pack("<I", len(comment)) + comment)
    whole[4:8] = struct.pack("<I", len(whole) - 8)
    stream.write(whole)
