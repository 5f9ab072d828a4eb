"""What a file of frequency responses holds, before any check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding
from ambid.reading import Provenance
from ambid.record.channel_map import ChannelMap
from ambid.record.content import CHANNELS_NOT_USED, unused
from ambid.record.raw import OF_AXES

FURTHER = ("std", "coherence", "averages", "spread")
COVARIANCE = ("cov_re", "cov_im")
"""Of a row's error with that of the pair that the column names beside it, at the same frequency: real and imaginary."""
Places = Mapping[tuple[float, str, str], Mapping[str, float]]
"""Values by frequency [Hz], output and input, each by its name: re, im, std, coherence, ..."""


@dataclass
class RawResponse:
    """What a file holds, before any check; tables of shape (F, outputs, inputs), NaN where it is silent."""

    frequency_hz: FloatArray
    outputs: list[str]
    inputs: list[str]
    response: ComplexArray
    std: FloatArray | None = None
    coherence: FloatArray | None = None
    averages: float | None = None
    covariance: ComplexArray | None = None
    spread: float | None = None
    findings: list[Finding] = field(default_factory=list)
    provenance: Provenance | None = None

    def mapped(self, path: Path, mapping: ChannelMap) -> RawResponse:
        """The same with the names and units of a map; channels that it does not name are left out, with a finding.

        Responses whose channels all have names of ours stay as they are: the map is of another file.

        Raises
        ------
        RecordError
            If a channel of the map is not there.
        """
        own_names = (*self.outputs, *self.inputs)
        is_ours = all(name.startswith(OF_AXES) and mapping.channel_of(name) is None for name in own_names)
        if not mapping.channels or is_ours:
            return self
        kept, names, factors, left_out = {}, {}, {}, []
        for kind, own in (("outputs", self.outputs), ("inputs", self.inputs)):
            found = {name: mapping.channel_of(name) for name in own}
            kept[kind] = [k for k, name in enumerate(own) if found[name] is not None]
            of_row = [channel for name in own if (channel := found[name]) is not None]
            names[kind], factors[kind] = [name for name, _ in of_row], np.array([factor for _, factor in of_row])
            left_out += [name for name in own if found[name] is None]
        there = ("t", "fs", *names["outputs"], *names["inputs"])
        missing = [channel for channel in mapping.channels if channel not in there]
        if missing:
            present = ", ".join(own_names)
            raise RecordError(f"{path}: map {missing[0]}: there is no such channel; the channels are {present}")
        scale = factors["outputs"][:, None] / factors["inputs"]
        chosen = np.ix_(range(len(self.frequency_hz)), kept["outputs"], kept["inputs"])
        flat = [o * len(self.inputs) + i for o in kept["outputs"] for i in kept["inputs"]]
        covariance = None
        if self.covariance is not None:
            covariance = self.covariance[:, flat][:, :, flat] * np.outer(scale, scale)
        return replace(
            self,
            outputs=names["outputs"],
            inputs=names["inputs"],
            response=self.response[chosen] * scale,
            std=None if self.std is None else self.std[chosen] * np.abs(scale),
            coherence=None if self.coherence is None else self.coherence[chosen],
            covariance=covariance,
            findings=[*self.findings, *unused(CHANNELS_NOT_USED, left_out)],
        )


def tabled(places: Places) -> RawResponse:
    """Tables from values by frequency, output and input."""
    f = np.unique([key[0] for key in places])
    outputs = list(dict.fromkeys(output for _, output, _ in places))
    inputs = list(dict.fromkeys(inlet for _, _, inlet in places))
    names = ("re", "im", *FURTHER)
    table = np.full((len(names), len(f), len(outputs), len(inputs)), np.nan)
    where = {value: k for k, value in enumerate(f.tolist())}
    rows, columns = ({name: k for k, name in enumerate(own)} for own in (outputs, inputs))
    for (frequency, output, inlet), values in places.items():
        own = [values.get(name, np.nan) for name in names]
        table[:, where[frequency], rows[output], columns[inlet]] = own
    covariance = np.full((len(f), table[0, 0].size, table[0, 0].size), np.nan, dtype=complex)
    beside = [[f"{part} {output} / {inlet}" for part in COVARIANCE] for output in outputs for inlet in inputs]
    for (frequency, output, inlet), values in places.items():
        cells = [complex(values.get(re, np.nan), values.get(im, np.nan)) for re, im in beside]
        covariance[where[frequency], rows[output] * len(inputs) + columns[inlet]] = cells
    covariance = np.where(np.isnan(covariance), covariance.conj().transpose(0, 2, 1), covariance)
    averages, spread = (float(np.median(own)) if len(own := one[np.isfinite(one)]) else None for one in table[4:])
    return RawResponse(
        f,
        outputs,
        inputs,
        table[0] + 1j * table[1],
        table[2],
        table[3],
        averages,
        None if np.isnan(covariance).all() else covariance,
        spread,
    )
