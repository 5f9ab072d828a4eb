"""Frequency responses of the closed loop, as a controller's analyser or a modal test measures them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, WithFindings
from ambid.reading import Provenance
from ambid.record.channel_map import ChannelMap, as_map
from ambid.record.content import remarks
from ambid.record.frequency_gates import (
    Lines,
    findings_of_missing,
    informative,
    require_covariance,
    require_frequencies,
    require_names,
    require_si_units,
    require_spread,
    require_values,
)
from ambid.record.frequency_readers import read_response
from ambid.record.scatter import std_of
from ambid.record.writers import write_response
from ambid.results import data_frame, html_table, picture
from ambid.rig import Rig


@dataclass(frozen=True, repr=False, eq=False)
class FrequencyResponse(ByValue, WithFindings):
    """Measured frequency responses of the closed loop, F frequencies, from excitations to y and i_c.

    Excitations are held from sample to sample and outputs are read at the samples, as in a record: the response is
    that of the sampled loop, at the points ``exp(2 pi i f / fs)``. Arrays are kept as read-only copies.

    Attributes
    ----------
    name : str
        What reports call it.
    frequency_hz : ndarray, shape (F,)
        Rising, above 0 and below half the sample rate.
    response : ndarray of complex, shape (F, outputs, inputs)
        In m/A, A/A; NaN where a pair was not measured.
    std : ndarray, shape (F, outputs, inputs)
        Root of the mean square of the complex error, of which the real and the imaginary part have half each; NaN
        where a pair was not measured.
    outputs : tuple of str
        Such as ``y.A_zeta`` [m] and ``i_c.A_zeta`` [A].
    inputs : tuple of str
        Such as ``i_e.A_zeta`` [A].
    covariance : ndarray of complex, shape (F, pairs, pairs), or None
        Of the errors at one frequency, pairs in the order of ``response[k].ravel()``; None where they are independent.
    spread : float
        Of a covariance that is an estimate: variance of errors whitened by it on the direction of a whitened response,
        n / (n - P) of P pairs over n independent averages; 1 where it is known.
    findings : tuple of Finding
        Every warning, and where the std is from; `notes` are their lines.
    path : Path or None
        File that it came from.
    provenance : Provenance or None
        Size and hash of what was read of it.
    point : Rig or None
        Rig of the operating point that it was measured at, where that is another one than the model's; see `at`.
    is_in_time, period
        As `Record` has them: False, and None.

    Raises
    ------
    RecordError
        If an array has another shape.
    """

    name: str
    frequency_hz: FloatArray
    response: ComplexArray
    std: FloatArray
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    covariance: ComplexArray | None = None
    spread: float = 1.0
    findings: tuple[Finding, ...] = ()
    path: Path | None = None
    provenance: Provenance | None = None
    point: Rig | None = None
    read_only: ClassVar[tuple[str, ...]] = ("frequency_hz", "response", "std", "covariance")
    is_in_time: ClassVar[Literal[False]] = False
    period: ClassVar[None] = None
    is_free_response: ClassVar[bool] = False
    has_known_command: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name in ("outputs", "inputs"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        count, pairs = len(np.atleast_1d(self.frequency_hz)), len(self.outputs) * len(self.inputs)
        whole = (count, len(self.outputs), len(self.inputs))
        shapes = {"frequency_hz": (count,), "response": whole, "std": whole, "covariance": (count, pairs, pairs)}
        for name, shape in shapes.items():
            if getattr(self, name) is None:
                continue
            kind = np.complex128 if name in ("response", "covariance") else np.float64
            array = np.asarray(getattr(self, name), dtype=kind, order="C")
            if array.flags.writeable or array.base is not None:  # else nobody can change it
                array = array.copy()
            if array.shape != shape:
                raise RecordError(
                    f"{self.path or self.name}: {name} has the shape {array.shape}; {count} frequencies, "
                    f"{len(self.outputs)} outputs and {len(self.inputs)} inputs make it {shape}"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def load(
        cls, path: str | Path, rig: Rig | None = None, *, mapping: ChannelMap | Mapping[str, str] | None = None
    ) -> FrequencyResponse:
        """Read frequency responses from a .csv, .mat (v5) or .uff, .unv file, and check them.

        Parameters
        ----------
        path : str or Path
            A ``.csv`` file has the columns ``frequency_hz, output, input, re, im``, a row a frequency and pair, and may
            have ``std``, ``coherence`` and ``averages``, or covariances and their ``spread``; a ``.mat`` file has
            ``frequency_hz`` (F), ``response`` (F x outputs x inputs), ``outputs``, ``inputs``, and may have ``std``,
            ``coherence`` and ``averages``, or ``covariance`` and its ``spread``. In place of ``frequency_hz`` there may
            be ``frequency_rad_s`` or ``frequency_rpm``, and in place of complex values ``magnitude`` or
            ``magnitude_db`` with ``phase_deg`` or ``phase_rad``. Of ``.uff`` and ``.unv`` files the sets 58 are read
            that hold frequency responses, in the units that the file states, and coherences for their std.
        rig : Rig, optional
            Its axes and sample rate are held against the file.
        mapping : ChannelMap or mapping of str to str, optional
            Names and factors of a file that has not our names and units, such as ``{"y.A_zeta": "12+X:1e-6", ...}``;
            a node of a .uff file that has no name is called so. A factor replaces the unit that the file states.

        Returns
        -------
        FrequencyResponse
            With `findings` on everything that was detected, and on where the std is from if the file has none.

        Raises
        ------
        RecordError
            If the file cannot be read, or a gate refuses its values.
        InputError
            If the format needs a package that is not installed.
        """
        path = Path(path)
        raw = read_response(path, as_map(mapping), rig)
        return cls.from_arrays(**vars(raw), rig=rig, name=path.stem, path=path)

    @classmethod
    def from_arrays(
        cls,
        frequency_hz: ArrayLike,
        response: ArrayLike,
        *,
        outputs: Sequence[str],
        inputs: Sequence[str],
        std: ArrayLike | None = None,
        coherence: ArrayLike | None = None,
        averages: float | None = None,
        covariance: ArrayLike | None = None,
        spread: float | None = None,
        rig: Rig | None = None,
        name: str = "frequency response",
        findings: Sequence[Finding] = (),
        notes: Sequence[str] = (),
        path: Path | None = None,
        provenance: Provenance | None = None,
    ) -> FrequencyResponse:
        """Make it from arrays in SI units, with the same checks as `load`.

        Parameters
        ----------
        frequency_hz, response, outputs, inputs, covariance, name, findings, path, provenance
            As the attributes.
        std : array_like, shape (F, outputs, inputs), optional
            NaN throughout for pairs whose std is not known: there it is taken from the coherence or, without one, from
            how far the response is from a smooth curve through its neighbours.
        coherence : array_like, shape (F, outputs, inputs), optional
        averages : float, optional
            That the coherence is from; without it the scatter about a smooth curve gives how many.
        spread : float, optional
            As the attribute, of a covariance that is given; 1 without it.
        rig : Rig, optional
        notes : sequence of str
            Deprecated: texts that become findings.

        Raises
        ------
        RecordError
            If a gate refuses the values.
        """
        where = str(path or name)
        h = np.asarray(response, dtype=np.complex128)
        f = np.asarray(frequency_hz, dtype=np.float64)
        shape = (len(np.atleast_1d(f)), len(outputs), len(inputs))
        unknown = np.full(shape, np.nan)
        names = tuple(outputs), tuple(inputs)
        cls(name, f, h, unknown, *names, path=path)  # refuses other shapes
        given = {"std": std, "coherence": coherence}
        tables = {key: unknown if values is None else np.asarray(values, dtype=float) for key, values in given.items()}
        for key, table in tables.items():
            if table.shape != shape:
                raise RecordError(f"{where}: {key} has the shape {table.shape}; the response has {shape}")
        if covariance is not None:
            covariance = np.asarray(covariance, dtype=np.complex128)
            cls(name, f, h, unknown, *names, covariance, path=path)
        pairs = [f"{output} / {inlet}" for output in names[0] for inlet in names[1]]
        lines, passed = informative(Lines(f, h, tables["std"], tables["coherence"], covariance), pairs)
        own = cls(
            name,
            lines.frequency_hz,
            lines.response,
            np.full(lines.response.shape, np.nan),
            *names,
            findings=(*findings, *remarks(notes), *passed),
            path=path,
            provenance=provenance,
        )
        require_names(where, own.outputs, own.inputs, rig)
        require_frequencies(where, own.frequency_hz, rig)
        require_values(where, own.frequency_hz, own.response, own.pairs)
        own = replace(own, findings=(*own.findings, *findings_of_missing(own.frequency_hz, own.measured, own.pairs)))
        if rig is not None:
            require_si_units(where, own.frequency_hz, own.response, own.outputs, own.inputs, rig)
        require_spread(where, spread, covariance is not None)
        if lines.covariance is not None:
            own = replace(own, spread=1.0 if spread is None else spread, covariance=lines.covariance)
            own = replace(own, std=require_covariance(where, own.frequency_hz, own.response, own.covariance, own.pairs))
            return own
        found, more = std_of(where, own.frequency_hz, own.response, lines.std, lines.coherence, averages, own.pairs)
        return replace(own, std=found, findings=(*own.findings, *more))

    def at(self, rig: Rig) -> FrequencyResponse:
        """The response as one of another operating point than the model's, as `Record.at`.

        Raises
        ------
        RecordError
            If the rig lacks an axis.
        """
        self.require_rig(rig)
        name = self.name if self.point is not None else f"{self.name} ({rig.name})"
        return replace(self, name=name, point=rig)

    def require_rig(self, rig: Rig) -> None:
        """Refuse a rig that lacks a channel, with a RecordError, as `Record.require_rig`."""
        require_names(str(self.path or self.name), self.outputs, self.inputs, rig)

    def frequency_response(self) -> FrequencyResponse:
        """Itself, as `Record.frequency_response` is one of a record in time."""
        return self

    def some(self, kept: NDArray[np.bool_] | NDArray[np.intp] | slice) -> FrequencyResponse:
        """The same at some of its frequencies."""
        covariance = None if self.covariance is None else self.covariance[kept]
        f, h, std = self.frequency_hz[kept], self.response[kept], self.std[kept]
        return replace(self, frequency_hz=f, response=h, std=std, covariance=covariance)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Which pairs were measured at which frequency, shape (F, outputs, inputs)."""
        return np.isfinite(self.response)

    @property
    def pairs(self) -> list[str]:
        """Names such as ``y.A_zeta / i_e.A_zeta``, in the order of ``response[k].ravel()``."""
        return [f"{output} / {inlet}" for output in self.outputs for inlet in self.inputs]

    @property
    def abscissa(self) -> tuple[str, str, FloatArray]:
        """What it was measured over, as `Record.abscissa`: `frequency_hz`."""
        return "frequency_hz", "Hz", self.frequency_hz

    @property
    def channels(self) -> list[str]:
        """Names of the outputs, as `Record.channels`."""
        return list(self.outputs)

    def save(self, path: str | Path) -> None:
        """Write a .csv or .mat (v5) file, which `load` reads, with the covariance.

        Raises
        ------
        RecordError
            If the suffix is none of these.
        """
        write_response(
            Path(path),
            self.frequency_hz,
            self.response,
            self.std,
            self.outputs,
            self.inputs,
            self.covariance,
            self.spread,
        )

    plot = picture("plot_frequency_response")

    def to_pandas(self) -> Any:
        """Convert to a pandas.DataFrame: a row a frequency and pair that was measured, as in a ``.csv`` file.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        k, o, i = np.nonzero(self.measured)
        values = self.response[k, o, i]
        return data_frame(
            {
                "frequency_hz": self.frequency_hz[k],
                "output": [self.outputs[one] for one in o],
                "input": [self.inputs[one] for one in i],
                "re": values.real,
                "im": values.imag,
                "std": self.std[k, o, i],
            }
        )

    def _repr_html_(self) -> str:
        places = [(o, i) for o in range(len(self.outputs)) for i in range(len(self.inputs))]
        known = {(o, i): self.measured[:, o, i] for o, i in places}
        rows = [
            [self.outputs[o], self.inputs[i], int(known[o, i].sum()), *self._sizes(o, i)]
            for o, i in places
            if known[o, i].any()
        ]
        head = ["output", "input", "frequencies", "median magnitude", "median std"]
        return html_table(head, rows, [repr(self), *self.notes])

    def _sizes(self, o: int, i: int) -> tuple[float, float]:
        return float(np.nanmedian(np.abs(self.response[:, o, i]))), float(np.nanmedian(self.std[:, o, i]))

    def __repr__(self) -> str:
        return (
            f"FrequencyResponse({self.name!r}: {len(self.frequency_hz)} frequencies from {self.frequency_hz[0]:.4g} to "
            f"{self.frequency_hz[-1]:.4g} Hz; {', '.join(self.outputs)} by {', '.join(self.inputs)}; "
            f"{len(self.findings)} notes)"
        )
