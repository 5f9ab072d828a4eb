"""What was measured in closed loop: records, which pass their gates when they are loaded."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.arrays import ByValue
from ambid.channels import in_order, unit_of
from ambid.errors import RecordError
from ambid.findings import Finding, WithFindings
from ambid.reading import Provenance
from ambid.record.channel_map import ChannelMap
from ambid.record.checks import require_known
from ambid.record.content import remarks
from ambid.record.driven import driven
from ambid.record.frequency_response import FrequencyResponse
from ambid.record.loading import arguments_from, as_array, columns_of, gated, require_driven, require_further
from ambid.record.local_response import response_of_signals
from ambid.record.raw import OF_LOOP
from ambid.record.rebuild import ExcitationSource
from ambid.record.writers import write
from ambid.results import data_frame, html_table, picture
from ambid.rig import Rig


@dataclass(frozen=True, repr=False, eq=False)
class Record(ByValue, WithFindings):
    """One closed-loop experiment, N samples on n axes.

    `Record.load` and `Record.from_arrays` check the values; the constructor checks shapes only, and is meant for
    simulated records. Arrays are kept as C-contiguous, read-only float64 copies.

    Attributes
    ----------
    name : str
        What reports call it.
    sample_rate : float
        Of every channel [Hz].
    axes : tuple of str
        Names of the columns, such as ``A_zeta``.
    i_e : ndarray, shape (N, n), or None
        Excitation [A]; ``i_e[k]`` is held from t[k] to t[k+1].
    y : ndarray, shape (N, n)
        Displacement at the sensors [m], read at t[k]; (N, 0) where it was not recorded, but further channels were.
    i_c : ndarray, shape (N, n), or None
        Control current [A], read at t[k].
    i_ref : ndarray, shape (N, n), or None
        Command that reaches the amplifier, excitation included [A].
    r : ndarray, shape (N, n), or None
        Reference of the controller [m]; a digital one that samples at t[k] acts on ``y[k] - r[k]``.
    period : int or None
        Samples per period of the excitation.
    findings : tuple of Finding
        Every warning and repair; `notes` are their lines.
    further : dict of str to ndarray, shape (N,)
        Further channels, by name, such as ``b.A_zeta`` [T]: of the signals in `ambid.channels.SIGNALS`, at axes and at
        sensors of the rig; read at t[k].
    excitation_source : str
        Where i_e is from: ``logged``; ``applied_command``, logged, but taken as the recorded command applied it;
        ``rebuilt_from_command`` or ``rebuilt_from_current`` by the rig's controller; ``assumed_zero``; ``unknown``.
    path : Path or None
        File that it came from.
    provenance : Provenance or None
        Size and hash of what was read of it.
    point : Rig or None
        Rig of the operating point that it was recorded at, where that is another one than the model's; see `at`.
    is_in_time : bool
        True: it was measured over time, and not over frequency.

    Raises
    ------
    RecordError
        If an array has not the shape (N, n).
    """

    name: str
    sample_rate: float
    axes: tuple[str, ...]
    i_e: NDArray[np.float64] | None
    y: NDArray[np.float64]
    i_c: NDArray[np.float64] | None = None
    i_ref: NDArray[np.float64] | None = None
    r: NDArray[np.float64] | None = None
    period: int | None = None
    findings: tuple[Finding, ...] = ()
    path: Path | None = None
    provenance: Provenance | None = None
    point: Rig | None = None
    excitation_source: ExcitationSource = "logged"
    further: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    read_only: ClassVar[tuple[str, ...]] = tuple(OF_LOOP)
    is_in_time: ClassVar[Literal[True]] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", tuple(self.axes))
        given = {name: own for name in OF_LOOP if (own := getattr(self, name)) is not None}
        shape = (len(given.get("y", next(iter(given.values()), ()))), len(self.axes))
        for signal, own in {"y": np.empty((shape[0], 0)), **given}.items():
            array = np.array(own, dtype=np.float64, order="C")
            if array.shape != shape and (signal != "y" or array.shape[1:] != (0,)):
                raise RecordError(
                    f"{self.path or self.name}: {signal} has the shape {array.shape}, y and the axes "
                    f"({', '.join(self.axes)}) make it {shape}; give N x axes, all of one length"
                )
            array.flags.writeable = False
            object.__setattr__(self, signal, array)
        columns = {name: np.array(column, dtype=np.float64) for name, column in self.further.items()}
        for name, column in columns.items():
            require_further(str(self.path or self.name), name, column, self.samples, self.axes)
            column.flags.writeable = False
        object.__setattr__(self, "further", {name: columns[name] for name in in_order(columns, self.axes)})

    @classmethod
    def load(
        cls,
        path: str | Path,
        rig: Rig | None = None,
        *,
        period: int | None = None,
        mapping: ChannelMap | Mapping[str, str] | None = None,
        sample_rate: float | None = None,
        allow: Collection[str] = (),
    ) -> Record:
        """Read a record from a .csv, .mat (v5, v7.3), .h5, .hdf5, .parquet or .tdms file, and check it.

        Parameters
        ----------
        path : str or Path
            File in one of the formats above.
        rig : Rig, optional
            Its axes are matched by name, its sample rate and air gaps are held against the record, and its controller
            rebuilds i_e where that was not logged.
        period : int, optional
            Samples per period; by default it is found from i_e.
        mapping : ChannelMap or mapping of str to str, optional
            Columns and factors of a file that has not our names and units, such as ``{"y.A_zeta": "ch3:1e-6", ...}``.
        sample_rate : float, optional
            Of a file that states none [Hz].
        allow : collection of str
            ``travel``: take displacements far beyond the air gap as they are; ``current``: currents far above 100 A and
            the bias. They are noted.

        Returns
        -------
        Record
            With `findings` on everything that was detected or repaired.

        Raises
        ------
        RecordError
            If the file cannot be read, or a gate refuses its values.
        InputError
            If the format needs a package that is not installed, or the mapping names no channel of ours.
        """
        own = arguments_from(Path(path), rig, mapping, sample_rate=sample_rate, period=period)
        return cls.from_arrays(**own, rig=rig, period=period, allow=allow)

    @classmethod
    def from_arrays(
        cls,
        *,
        y: ArrayLike | None = None,
        sample_rate: float,
        axes: Sequence[str],
        i_e: ArrayLike | None = None,
        i_c: ArrayLike | None = None,
        i_ref: ArrayLike | None = None,
        r: ArrayLike | None = None,
        further: Mapping[str, ArrayLike] | None = None,
        rig: Rig | None = None,
        period: int | None = None,
        name: str = "record",
        findings: Sequence[Finding] = (),
        notes: Sequence[str] = (),
        path: Path | None = None,
        provenance: Provenance | None = None,
        allow: Collection[str] = (),
    ) -> Record:
        """Make a record from arrays (N, n) in SI units, with the same checks as `load`.

        Parameters are the attributes of `Record`; `rig` and `allow` are used as in `load`. Deprecated: `notes`, texts
        that become findings.

        Raises
        ------
        RecordError
            If a gate refuses the values.
        """
        require_known(allow)
        where = str(path or name)
        loop = {"i_e": i_e, "y": y, "i_c": i_c, "i_ref": i_ref, "r": r}
        own: dict[str, Any] = {name: None if x is None else as_array(where, name, x) for name, x in loop.items()}
        own["further"] = {channel: as_array(where, channel, x) for channel, x in (further or {}).items()}
        known: dict[str, Any] = {"name": name, "period": period, "path": path, "provenance": provenance}
        found = (*findings, *remarks(notes))
        given = cls(sample_rate=float(sample_rate), axes=tuple(axes), findings=found, **own, **known)
        order, rate, passed, of_gates = gated(where, rig, given.axes, given.sample_rate, given._signals, period, allow)
        signals, source, period, of_drive = driven(where, rig, order, rate, passed, period)
        found = (*found, *of_gates, *of_drive)
        return replace(
            given._of(signals), sample_rate=rate, axes=order, period=period, findings=found, excitation_source=source
        )

    def at(self, rig: Rig) -> Record:
        """The record as one of another operating point than the model's: other speed, bias current or controller.

        Its name gets that of the rig behind it.

        Parameters
        ----------
        rig : Rig
            The same machine as it was when this was recorded.

        Raises
        ------
        RecordError
            If the rig has other axes.
        """
        self.require_rig(rig)
        name = self.name if self.point is not None else f"{self.name} ({rig.name})"
        return replace(self, name=name, point=rig)

    def require_rig(self, rig: Rig) -> None:
        """Refuse a rig with other axes, with a RecordError."""
        if rig.axes != self.axes:
            raise RecordError(
                f"{self.path or self.name}: axes {', '.join(self.axes)}, {rig.path or rig.name} has "
                f"{', '.join(rig.axes)}; load the record with its rig"
            )

    def rows(self, first: int, end: int) -> Record:
        """The same record from sample `first` up to `end`, counted from 0."""
        return self._of({name: array[first:end] for name, array in self._signals.items()})

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.y)

    @property
    def seconds(self) -> float:
        """Length of the record [s]."""
        return self.samples / self.sample_rate

    @property
    def periods(self) -> int:
        """Number of whole periods; 0 where no period is known."""
        return self.samples // self.period if self.period else 0

    @property
    def t(self) -> NDArray[np.float64]:
        """Sampling instants [s], from 0, shape (N,)."""
        return np.arange(self.samples) / self.sample_rate

    @property
    def abscissa(self) -> tuple[str, str, NDArray[np.float64]]:
        """What it was measured over: the name in tables, the unit, and the values, `t`."""
        return "t", "s", self.t

    @property
    def channels(self) -> list[str]:
        """Names of the recorded outputs, such as ``y.A_zeta``: y, i_c where it was recorded, further ones."""
        own = self._signals
        return [*(f"{name}.{axis}" for name in ("y", "i_c") if name in own for axis in self.axes), *self.further]

    @property
    def amplitude(self) -> float:
        """Rms of what drives it: of i_e [A], or, where that is still, of the reference r [m]; NaN of neither."""
        return next((float(own.std()) for own in self._driving.values()), np.nan)

    @property
    def is_rebuilt(self) -> bool:
        """Whether i_e was not logged: it is rebuilt, taken as zero, or not known."""
        return self.excitation_source not in ("logged", "applied_command")

    @property
    def is_free_response(self) -> bool:
        """Whether nothing drives it: all that it shows is how it comes to rest."""
        return not self._driving

    @property
    def has_known_command(self) -> bool:
        """Whether i_e comes from the recorded command: it then holds whatever the controller's gains miss."""
        return self.i_ref is not None and self.excitation_source != "logged"

    @property
    def outputs(self) -> NDArray[np.float64]:
        """The recorded outputs of the loop, shape (N, channels), as in `channels`; a copy, large of a long record."""
        return np.hstack(self.parts)

    @property
    def parts(self) -> tuple[NDArray[np.float64], ...]:
        """The same part by part: y, and i_c where it was recorded, shape (N, n) each; each further one, (N, 1)."""
        return tuple(own for name, own in self._signals.items() if name not in ("i_e", "r", "i_ref"))

    def with_outputs(self, outputs: NDArray[np.float64]) -> Record:
        """The same experiment with other outputs, shape (N, channels), as in `channels`."""
        n = self.y.shape[1]
        beyond = n + (0 if self.i_c is None else len(self.axes))
        i_c = None if self.i_c is None else outputs[:, n:beyond]
        further = dict(zip(self.further, outputs.T[beyond:], strict=True))
        return replace(self, y=outputs[:, :n], i_c=i_c, further=further)

    def frequency_response(self) -> FrequencyResponse:
        """The response from what moves of i_e and r to y and i_c, with its uncertainty, by local polynomials.

        Over a band of neighbouring excited lines, 18 for one axis and 30 for four that are excited together by
        different sequences, the response is a polynomial of degree three, and so is the transient; where that does
        better than chance, over a common one with two poles; the lowest band, with its mirror image, takes degree seven
        and six poles. Four frequencies a band come out. What is no such response is an error, as where more than two
        narrow modes are within a band.
        It raises the std, which is taken from what is left, but has the same sign over a band and is no noise. A longer
        period makes bands narrower, and so does one axis after the other.

        Raises
        ------
        RecordError
            If i_e is not known, nothing drives the record, or there are too few lines.
        """
        return self._frequency_response

    @cached_property
    def _frequency_response(self) -> FrequencyResponse:
        """Found once: a record without a period takes a second for 50 000 samples."""
        where, driving = str(self.path or self.name), self._driving
        require_driven(where, self.i_e is not None, driving)
        made = response_of_signals(
            where, driving, self.axes, self.outputs, self.channels, sample_rate=self.sample_rate, period=self.period
        )
        about = {name: getattr(self, name) for name in ("name", "path", "provenance", "point")}
        return replace(made, **about, findings=(*self.findings, *made.findings))

    def save(self, path: str | Path) -> None:
        """Write the signals to a .csv, .mat (v5), .h5, .hdf5, .parquet or .tdms file; loading finds the rest.

        Raises
        ------
        RecordError
            If the suffix is none of these.
        InputError
            If the format needs a package that is not installed.
        """
        write(Path(path), self.sample_rate, self.axes, self._signals)

    plot = picture("plot_record")

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Every recorded channel by its name, such as ``y.A_zeta``, SI units."""
        return dict(columns_of(self.axes, self._signals))

    def to_pandas(self) -> Any:
        """Convert to a pandas.DataFrame: a column a channel, such as ``y.A_zeta``, SI units, and `t` [s] before them.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        return data_frame({"t": self.t, **self.columns()})

    def _repr_html_(self) -> str:
        rows = [
            [name, unit_of(name), *(float(f(x)) for f in (np.mean, np.std, np.min, np.max))]
            for name, x in self.columns().items()
        ]
        return html_table(["channel", "unit", "mean", "deviation", "least", "most"], rows, [repr(self), *self.notes])

    def __repr__(self) -> str:
        signals = " ".join(dict.fromkeys(name.partition(".")[0] for name in self._signals))
        period = f"{self.periods} periods of {self.period}" if self.period else "no period"
        return (
            f"Record({self.name!r}: {self.samples} samples at {self.sample_rate:g} Hz, {self.seconds:.4g} s, {period}; "
            f"{signals} on {', '.join(self.axes)}; {len(self.findings)} notes)"
        )

    @property
    def _signals(self) -> dict[str, NDArray[np.float64]]:
        """What was recorded, by name: signals of shape (N, n), and further channels of shape (N, 1)."""
        own = {name: own for name in OF_LOOP if (own := getattr(self, name)) is not None and own.shape[1]}
        return own | {name: column[:, None] for name, column in self.further.items()}

    @property
    def _driving(self) -> dict[str, NDArray[np.float64]]:
        """What drives it: those of i_e and r of which any axis changes."""
        return {name: own for name, own in self._signals.items() if name in ("i_e", "r") and np.any(own != own[:1])}

    def _of(self, signals: Mapping[str, NDArray[np.float64]]) -> Record:
        """The same with these as `_signals`."""
        own: dict[str, Any] = {signal: signals.get(signal) for signal in OF_LOOP}
        return replace(self, **own, further={name: signals[name][:, 0] for name in self.further})
