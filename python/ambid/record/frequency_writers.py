"""Frequency responses written to the formats that `ambid.record.frequency_readers` reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.io

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.record.raw_response import COVARIANCE
from ambid.writing import whole_file

__all__ = ["require_response_format", "write_response"]

SUFFIXES = (".csv", ".mat")


def require_response_format(path: Path) -> None:
    """Refuse a suffix that is not written."""
    if path.suffix.lower() not in SUFFIXES:
        raise RecordError(
            f"{path}: suffix {path.suffix!r} is not one that frequency responses are written with; use one of "
            f"{', '.join(SUFFIXES)}"
        )


def write_response(
    path: Path,
    frequency_hz: FloatArray,
    response: ComplexArray,
    std: FloatArray,
    outputs: Sequence[str],
    inputs: Sequence[str],
    covariance: ComplexArray | None,
    spread: float,
) -> None:
    """Write the attributes of a `FrequencyResponse`; pairs that were not measured have no row in a table.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    OutputError
        If the file cannot be written; what was there stands.
    """
    require_response_format(path)
    with whole_file(path) as stream:
        if path.suffix.lower() == ".mat":
            content = {"frequency_hz": frequency_hz.reshape(-1, 1), "response": response, "std": std}
            for name, own in (("outputs", outputs), ("inputs", inputs)):
                content[name] = np.array(own, dtype=object).reshape(-1, 1)
            if covariance is not None:
                content |= {"covariance": covariance, "spread": np.array(spread)}
            scipy.io.savemat(stream, content, do_compression=True)
            return
        pairs = [f"{output} / {inlet}" for output in outputs for inlet in inputs]
        of_pairs = [f",{part} {pair}" for pair in pairs for part in COVARIANCE] if covariance is not None else []
        lines = ["frequency_hz,output,input,re,im,std" + "".join(of_pairs) + ",spread" * bool(of_pairs)]
        for k, o, i in np.argwhere(np.isfinite(response)):
            h = response[k, o, i]
            numbers = f"{h.real:.17g},{h.imag:.17g},{std[k, o, i]:.9g}"
            if covariance is not None:  # Hermitian: the other half of it needs no words
                row = len(inputs) * o + i
                numbers += "".join(f",{c.real:.12g},{c.imag:.12g}" for c in covariance[k, row, : row + 1])
                numbers += ",," * (len(pairs) - row - 1) + f",{spread:.9g}"
            lines.append(f"{frequency_hz[k]:.17g},{outputs[o]},{inputs[i]},{numbers}")
        stream.write("\n".join([*lines, ""]).encode())
