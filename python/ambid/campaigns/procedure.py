"""A campaign over bias currents: K_i by closed-loop identification and static loading, K_s and tau_e with scatter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ambid.campaigns.folder import Content, read_folder
from ambid.campaigns.result import BiasPoint, Campaign, Runs
from ambid.errors import AmbidError, Stopped
from ambid.identification import Estimate, identify, static_load
from ambid.model import Model
from ambid.record import Record
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread

__all__ = ["campaign"]


@with_one_blas_thread
def campaign(
    folder: str | Path, *, deflection: bool = False, progress: Callable[[int, int, str], None] | None = None
) -> Campaign:
    """Identify the bench at every bias current, and hold K_i against static loading (Fig. 4, Tables 2 and 3).

    Every record is identified by itself, for the scatter over the runs, and all records of one kind jointly, for the
    values and their 95 % intervals. All files are read and checked before the first identification.

    Parameters
    ----------
    folder : str or Path
        Holds one folder per bias current, each with ``rig.toml``, records named ``<kind>_<N>`` such as
        ``prbs_small_1.mat`` in any format that `Record.load` reads, and static loadings ``static_<N>.csv``. Hidden
        files, and those with other suffixes, are not looked at.
    deflection : bool
        Whether static loading takes in K_s s of the bent rotor, as `static_load` does.
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
    Stopped
        At Ctrl-C, with the bias currents that were done, if any; it is a KeyboardInterrupt.
    """
    folder = Path(folder)
    contents, notes = read_folder(folder)
    total = sum(len(runs) + 1 for content in contents for runs in content.records.values())
    done = 0

    def fit(start: Model | Rig, records: list[Record], where: Path) -> Estimate:
        nonlocal done
        if progress is not None:
            progress(done, total, str(where))
        done += 1
        return _identify(start, records, where)

    def point(content: Content) -> BiasPoint:
        runs = []
        for kind, records in content.records.items():
            single = tuple(fit(content.rig, [record], content.folder / record.name) for record in records)
            runs.append(Runs(kind, fit(single[0].model, records, content.folder / kind), single))
        static = static_load(content.rig, content.loadings, deflection=deflection) if content.loadings else None
        return BiasPoint(content.folder, content.rig, tuple(runs), static)

    points: list[BiasPoint] = []
    try:
        for content in contents:
            points.append(point(content))
    except KeyboardInterrupt:
        if not points:
            raise
        left = ", ".join(content.folder.name for content in contents[len(points) :])
        stopped = f"stopped by Ctrl-C: not done are {left}"
        raise Stopped(Campaign(folder, tuple(points), (*notes, stopped))) from None
    return Campaign(folder, tuple(points), notes)


def _identify(start: Model | Rig, records: list[Record], where: Path) -> Estimate:
    try:
        estimate = identify(start, records)
    except AmbidError as error:
        raise type(error)(f"{where}: {error}") from error
    return estimate
