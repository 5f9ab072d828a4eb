"""A campaign's folder: what lies in it, read and checked before the first identification."""

import re
from dataclasses import dataclass
from pathlib import Path

from ambid.errors import InputError, RecordError, RigError
from ambid.findings import Finding, Kind, Where
from ambid.record import Record, StaticLoading
from ambid.record.readers import SUFFIXES
from ambid.rig import Rig

RIG_FILE = "rig.toml"
STATIC = "static_"
OUTSIDE = Kind("file_outside_folders", "note", "not used, since it lies in no bias current's folder")
EMPTY = Kind("folder_without_records", "note", "not used, since it holds neither {rig_file} nor records")
LAYOUT = f"expected one folder per bias current, each with {RIG_FILE}, records <kind>_<N>.mat, and {STATIC}<N>.csv"


@dataclass(frozen=True)
class Content:
    """What one bias current's folder holds."""

    folder: Path
    rig: Rig
    records: dict[str, list[Record]]
    loadings: list[StaticLoading]


def read_folder(folder: Path, *, exact: bool = False) -> tuple[list[Content], tuple[Finding, ...]]:
    """Contents of all folders by rising bias current, and what was not used; their values are exact if so asked."""
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; {LAYOUT}")
    contents, findings = [], []
    for path in _visible(folder):
        if path.is_file() and path.suffix.lower() in SUFFIXES:
            findings.append(OUTSIDE(Where(file=str(path))))
        elif path.is_dir() and (content := _content(path, exact)) is not None:
            contents.append(content)
        elif path.is_dir():
            findings.append(EMPTY(Where(file=str(path)), rig_file=RIG_FILE))
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
    return contents, tuple(findings)


def _content(folder: Path, exact: bool) -> Content | None:
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
    rig = rig.exact() if exact else rig
    kinds: dict[str, list[Record]] = {}
    for path in records:
        kinds.setdefault(_kind_and_number(path)[0], []).append(Record.load(path, rig))
    return Content(folder, rig, kinds, [StaticLoading.load(path, rig) for path in loadings])


def _visible(folder: Path) -> list[Path]:
    """What a folder holds, run 10 behind run 9."""
    return sorted((path for path in folder.iterdir() if not path.name.startswith(".")), key=_kind_and_number)


def _kind_and_number(path: Path) -> tuple[str, int]:
    """``prbs_small`` and 1 of ``prbs_small_1.mat``."""
    match = re.fullmatch(r"(.+?)_?(\d+)", path.stem)
    return (match[1], int(match[2])) if match else (path.stem, 0)
