"""A campaign over bias currents: K_i by closed-loop identification and static loading, K_s and tau_e with scatter."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ambid.bias_point import BiasPoint, Campaign, Runs
from ambid.errors import AmbidError, InputError, RecordError, RigError
from ambid.estimate import Estimate
from ambid.identify import identify
from ambid.model import Model
from ambid.record import Record, StaticLoading
from ambid.record.readers import SUFFIXES
from ambid.rig import Rig
from ambid.static_load import static_load

__all__ = ["campaign"]

RIG_FILE = "rig.toml"
STATIC = "static_"
LAYOUT = f"expected one folder per bias current, each with {RIG_FILE}, records <kind>_<N>.mat, and {STATIC}<N>.csv"


def campaign(folder: str | Path, *, progress: Callable[[int, int, str], None] | None = None) -> Campaign:
    """Identify the bench at every bias current, and hold K_i against static loading (Fig. 4, Tables 2 and 3).

    Every record is identified by itself, for the scatter over the runs, and all records of one kind jointly, for the
    values and their 95 % intervals. All files are read and checked before the first identification.

    Parameters
    ----------
    folder : str or Path
        Holds one folder per bias current, each with ``rig.toml``, records named ``<kind>_<N>`` such as
        ``prbs_small_1.mat`` in any format that `Record.load` reads, and static loadings ``static_<N>.csv``. Hidden
        files, and those with other suffixes, are not looked at.
    progress : callable, optional
        Called before each step with the number of steps done, their total, and what is next.

    Returns
    -------
    Campaign

    Raises
    ------
    InputError
        If the folder is not laid out like that, or a file is refused; the message names it.
    UnstableLoopError, IdentificationError
        If an identification or a static loading could not be done; the message names the record or the folder.
    """
    folder = Path(folder)
    contents, notes = _read(folder)
    total = sum(len(runs) + 1 for content in contents for runs in content.records.values())
    done = 0

    def fit(start: Model | Rig, records: list[Record], where: Path) -> Estimate:
        nonlocal done
        if progress is not None:
            progress(done, total, str(where))
        done += 1
        return _identify(start, records, where)

    points = []
    for content in contents:
        runs = []
        for kind, records in content.records.items():
            single = tuple(fit(content.rig, [record], content.folder / record.name) for record in records)
            runs.append(Runs(kind, fit(single[0].model, records, content.folder / kind), single))
        static = static_load(content.rig, content.loadings) if content.loadings else None
        points.append(BiasPoint(content.folder, content.rig, tuple(runs), static))
    return Campaign(folder, tuple(points), notes)


@dataclass(frozen=True)
class _Content:
    """What one bias current's folder holds."""

    folder: Path
    rig: Rig
    records: dict[str, list[Record]]
    loadings: list[StaticLoading]


def _read(folder: Path) -> tuple[list[_Content], tuple[str, ...]]:
    """Contents of all folders by rising bias current, and notes on what was left aside."""
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; {LAYOUT}")
    contents, notes = [], []
    for path in _visible(folder):
        if path.is_file() and path.suffix.lower() in SUFFIXES:
            notes.append(f"{path}: not used, since it lies in no bias current's folder")
        elif path.is_dir() and (content := _content(path)) is not None:
            contents.append(content)
        elif path.is_dir():
            notes.append(f"{path}: not used, since it holds neither {RIG_FILE} nor records")
    if not contents:
        raise InputError(f"{folder}: no folder with {RIG_FILE} and records in it; {LAYOUT}")
    axes = contents[0].rig.axes
    for content in contents[1:]:
        if content.rig.axes != axes:
            raise RigError(
                f"{content.folder / RIG_FILE}: axes {', '.join(content.rig.axes)}, {contents[0].folder / RIG_FILE} has "
                f"{', '.join(axes)}; a campaign is that of one machine"
            )
    contents.sort(key=lambda content: [bearing.bias_current for bearing in content.rig.bearings])
    return contents, tuple(notes)


def _content(folder: Path) -> _Content | None:
    """Load a bias current's folder; None where nothing in it belongs to a campaign."""
    files = [path for path in _visible(folder) if path.is_file() and path.suffix.lower() in SUFFIXES]
    loadings = [path for path in files if path.stem.startswith(STATIC)]
    records = [path for path in files if path not in loadings]
    rig_file = folder / RIG_FILE
    if not rig_file.exists():
        if files:
            raise RigError(f"{rig_file}: there is no such file beside {files[0].name}; {LAYOUT}")
        return None
    if not records:
        raise RecordError(f"{folder}: no records beside {RIG_FILE}; {LAYOUT}")
    rig = Rig.load(rig_file)
    kinds: dict[str, list[Record]] = {}
    for path in records:
        kinds.setdefault(_kind_and_number(path)[0], []).append(Record.load(path, rig))
    return _Content(folder, rig, kinds, [StaticLoading.load(path, rig) for path in loadings])


def _visible(folder: Path) -> list[Path]:
    """What a folder holds, run 10 behind run 9."""
    return sorted((path for path in folder.iterdir() if not path.name.startswith(".")), key=_kind_and_number)


def _kind_and_number(path: Path) -> tuple[str, int]:
    """``prbs_small`` and 1 of ``prbs_small_1.mat``."""
    match = re.fullmatch(r"(.+?)_?(\d+)", path.stem)
    return (match[1], int(match[2])) if match else (path.stem, 0)


def _identify(start: Model | Rig, records: list[Record], where: Path) -> Estimate:
    try:
        estimate = identify(start, records)
    except AmbidError as error:
        raise type(error)(f"{where}: {error}") from error
    if estimate.status == "stopped":
        raise KeyboardInterrupt  # `identify` ends early where the user asks; a campaign is stopped as a whole
    return estimate
