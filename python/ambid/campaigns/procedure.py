"""A campaign over bias currents: K_i by closed-loop identification and static loading, K_s and tau_e with scatter."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ambid.campaigns.folder import Content, read_folder
from ambid.campaigns.result import BiasPoint, Campaign, Runs
from ambid.errors import AmbidError, Stopped
from ambid.findings import Kind
from ambid.identification import Estimate, identify, static_load, with_common_tolerances
from ambid.model import Model
from ambid.record import Record
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread

STOPPED = Kind(
    "campaign_stopped", "warning", "stopped after {done} of {total} fits[: not finished are {folders}]", "begin anew"
)


@with_one_blas_thread
def campaign(
    folder: str | Path,
    *,
    deflection: bool = False,
    exact: bool = False,
    progress: Callable[[int, int, str], None] | None = None,
) -> Campaign:
    """Identify the bench at every bias current, and hold K_i against static loading (Fig. 4, Tables 2 and 3).

    Every record is identified by itself, for the scatter over the runs, and all records of one kind jointly, for the
    values and their 95 % intervals. Where the rig files are of one machine, the errors of its values that are known to
    a tolerance are those of all joint fits together, see `with_common_tolerances`. All files are read and checked
    before the first identification.

    Parameters
    ----------
    folder : str or Path
        Holds one folder per bias current, each with ``rig.toml``, records named ``<kind>_<N>`` such as
        ``prbs_small_1.mat`` in any format that `Record.load` reads, and static loadings ``static_<N>.csv``. Hidden
        files, and those with other suffixes, are not looked at.
    deflection : bool
        Whether static loading takes in K_s s of the bent rotor, as `static_load` does.
    exact : bool
        Whether every value of the rig files is taken for exact, whatever their [tolerance].
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
        At Ctrl-C, with the fits that were done, if any; it is a KeyboardInterrupt.
    """
    folder = Path(folder)
    contents, findings = read_folder(folder, exact=exact)
    total = sum(len(runs) + 1 for content in contents for runs in content.records.values())
    done = 0
    points: list[BiasPoint] = []

    def fit(start: Model | Rig, records: list[Record], where: Path) -> Estimate:
        nonlocal done
        if progress is not None:
            progress(done, total, str(where))
        estimate = _identify(start, records, where)
        done += 1
        return estimate

    def add(content: Content) -> None:
        """The point is there from its first fit on, and has each further one as soon as it is done."""
        static = static_load(content.rig, content.loadings, deflection=deflection) if content.loadings else None
        here = BiasPoint(content.folder, content.rig, (), static)
        points.append(here)
        for kind, records in content.records.items():
            for record in records:
                single = fit(content.rig, [record], content.folder / record.name)
                points[-1] = here = replace(here, begun=(*here.begun, single))
            joint = fit(here.begun[0].model, records, content.folder / kind)
            points[-1] = here = replace(here, runs=(*here.runs, Runs(kind, joint, here.begun)), begun=())

    try:
        for content in contents:
            add(content)
        return Campaign(folder, _of_one_machine(points), findings)
    except KeyboardInterrupt:
        whole = tuple(point for point in points if point.runs or point.begun)
    if not whole:
        raise KeyboardInterrupt
    kinds = {point.folder: len(point.runs) for point in whole}
    left = [own.folder.name for own in contents if kinds.get(own.folder, 0) < len(own.records)]
    stopped = STOPPED(done=done, total=total, folders=left or None)
    raise Stopped(Campaign(folder, whole, (*findings, stopped), is_stopped=True))


def _of_one_machine(points: list[BiasPoint]) -> tuple[BiasPoint, ...]:
    """The points with what all of their joint fits make of the values of the rig file."""
    joint = iter(with_common_tolerances([runs.joint for point in points for runs in point.runs]))
    return tuple(
        replace(point, runs=tuple(replace(runs, joint=next(joint)) for runs in point.runs)) for point in points
    )


def _identify(start: Model | Rig, records: list[Record], where: Path) -> Estimate:
    try:
        estimate = identify(start, records)
    except AmbidError as error:
        raise type(error)(f"{where}: {error}") from error
    return estimate
