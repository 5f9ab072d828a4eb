"""How long an experiment lasts for a wanted accuracy, and how long without each of its further signals."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from ambid.channels import SIGNALS, by_signal
from ambid.designs.intervals import FEWEST, Prospect, prospect
from ambid.designs.options import Option, Task, compared
from ambid.errors import InputError
from ambid.findings import NOWHERE, Finding, Kind, Where
from ambid.identification.estimate import NORMAL_95
from ambid.identification.tolerances import NOISE
from ambid.model import Model

LONGEST = 3600.0
"""Seconds that an experiment may last: no machine stays the same for longer."""
TOO_SHORT = Kind(
    "accuracy_takes_longer",
    "warning",
    "the wanted accuracy takes {needed_s:.3g} s, and the record has {seconds_s:.3g} s",
    "allow more peak, or more time",
)
NOT_ACCURATE = Kind(
    "accuracy_not_reached",
    "warning",
    "{parameter}: a 95 % interval of +- {predicted:.3g} {unit} is predicted, +- {wanted:.3g} {unit} is wanted",
)
OUT_OF_REACH = Kind(
    "accuracy_out_of_reach",
    "warning",
    "{parameter}: tolerances of the rig file alone make a 95 % interval of +- {by_tolerances:.3g} {unit}, and +- "
    "{wanted:.3g} {unit} is wanted: no record reaches that; {tolerance} makes {share:.0f|%} of it",
    "measure {tolerance} better, and state its tolerance in [tolerance]",
)
SHORTER = Kind(
    "further_signal_shortens",
    "note",
    "with the {instrument} of {places}: {with_s:.3g} s in place of {without_s:.3g} s for the same accuracy",
)
DECISIVE = Kind(
    "further_signal_decides",
    "note",
    "with the {instrument} of {places}: {with_s:.3g} s; no length of record is as accurate without them",
)
NOT_KNOWN = Kind(
    "noise_not_known",
    "note",
    "the noise of {channels} is not known: what the {instrument} would bring is left out",
    "state its rms in {unit}, or give a record that has them",
)


def periods_of(
    task: Task, option: Option, known: Model, wanted: Mapping[str, float], seconds: float | None
) -> tuple[int, tuple[Finding, ...]]:
    """How many are played, and whether more would be needed."""
    period, rate = len(option.wave), task.model.rig.sample_rate
    most = int((LONGEST if seconds is None else seconds) * rate / period)
    if not wanted:
        # periods where neither a length nor an accuracy is asked for
        return max(FEWEST, 8 if seconds is None else most), ()
    needed, beyond = _needed(task, option, known, wanted)
    if needed <= max(most, FEWEST):
        return needed, beyond
    played = max(most, FEWEST)
    return played, (*beyond, TOO_SHORT(needed_s=needed * period / rate, seconds_s=played * period / rate))


def _needed(task: Task, option: Option, known: Model, wanted: Mapping[str, float]) -> tuple[int, tuple[Finding, ...]]:
    """Periods after which all that can be is as accurate as wanted, and what cannot be."""
    wave = np.tile(option.wave, (FEWEST, 1))
    expected = prospect(known, wave, period=len(option.wave), instruments=task.instruments)
    beyond = tuple(_out_of_reach(expected, wanted))
    lost = {finding.values["parameter"] for finding in beyond}
    reached = {name: half for name, half in wanted.items() if name not in lost}
    # part that is played beyond what is needed: transients take more of few periods than of many
    needed = max(FEWEST, *(int(np.ceil(FEWEST * 1.02 * _ratio(expected, *own))) for own in reached.items()), 0)
    return needed, beyond


def _ratio(expected: Prospect, name: str, half: float) -> float:
    """Variance by noise over that which tolerances leave of a wanted half width of an interval."""
    own = expected.budget[name]
    return own[NOISE] / ((half / NORMAL_95) ** 2 - sum(own.values()) + own[NOISE])


def _out_of_reach(expected: Prospect, wanted: Mapping[str, float]) -> Iterator[Finding]:
    """Parameters whose interval is wider than wanted whatever is recorded, and the tolerance that makes most of it."""
    for name, half in wanted.items():
        own = {key: variance for key, variance in expected.budget[name].items() if key != NOISE}
        total = sum(own.values())
        if NORMAL_95 * np.sqrt(total) >= half:
            largest = max(own, key=lambda key: own[key])
            yield OUT_OF_REACH(
                NOWHERE,
                parameter=name,
                by_tolerances=NORMAL_95 * float(np.sqrt(total)),
                wanted=half,
                unit=expected.parameters[name].unit,
                tolerance=largest,
                share=own[largest] / total,
            )


def missed(expected: Prospect, wanted: Mapping[str, float], known: Sequence[Finding]) -> tuple[Finding, ...]:
    """Parameters whose interval is wider than wanted, but those that findings say it of."""
    lost = {finding.values.get("parameter") for finding in known}
    parameters = expected.parameters
    wide = {name: NORMAL_95 * (parameters[name].std_error or 0.0) for name in wanted}
    return tuple(
        NOT_ACCURATE(parameter=name, predicted=wide[name], wanted=half, unit=parameters[name].unit)
        for name, half in wanted.items()
        if wide[name] > half and name not in lost
    )


def without_signals(
    task: Task, signal: str | None, known: Model, wanted: Mapping[str, float], expected: Prospect
) -> dict[str, float]:
    """Seconds that the best experiment without each further signal takes for the same accuracy, by signal.

    The same is the wanted accuracy, of what can be reached with them, or else the criterion; tolerances of the rig file
    are in both, also that of a gain that only a longer record would show. Infinite where no length does, and no less
    than with the signal, as a record may be read without it.

    Parameters
    ----------
    task : Task
    signal : {"prbs", "multisine"} or None
        That is compared.
    known : Model
        With tolerances.
    wanted : mapping of str to float
        Half widths.
    expected : Prospect
        Of the record with all signals.
    """
    found = {}
    for name, channels in by_signal(task.instruments.further).items():
        other = replace(task, instruments=task.instruments.without(*channels))
        try:
            best = compared(other, signal)[0][0]
        except InputError:  # not all parameters are determined
            found[name] = np.inf
        else:
            found[name] = _seconds(other, best, known, wanted, expected)
    return found


def _seconds(task: Task, option: Option, known: Model, wanted: Mapping[str, float], expected: Prospect) -> float:
    """That an option takes to be as accurate as what is expected of another record."""
    rate, period = task.model.rig.sample_rate, len(option.wave)
    if reachable := _reachable(wanted, expected):
        needed, beyond = _needed(task, option, known, reachable)
        return np.inf if beyond else needed * period / rate
    wave = np.tile(option.wave, (max(FEWEST, round(expected.seconds * rate / period)), 1))
    aim = np.log(task.criterion_of(expected))

    def excess(times: float) -> float:
        """Logarithm of the criterion of a record e to that power times as long, over what it is to be."""
        noise = task.instruments.averaged(float(np.exp(times)))
        return float(np.log(task.criterion_of(prospect(known, wave, period=period, instruments=noise))) - aim)

    least, most = (float(np.log(seconds * rate / len(wave))) for seconds in (expected.seconds, LONGEST))
    if not excess(most) < 0.0:
        return np.inf
    times = least if excess(least) < 0.0 else float(brentq(excess, least, most, rtol=1e-3))
    return float(np.exp(times)) * len(wave) / rate


def _reachable(wanted: Mapping[str, float], expected: Prospect) -> dict[str, float]:
    return {name: half for name, half in wanted.items() if not list(_out_of_reach(expected, {name: half}))}


def of_signals(
    task: Task,
    option: Option,
    known: Model,
    wanted: Mapping[str, float],
    expected: Prospect,
    without: Mapping[str, float],
) -> Iterator[Finding]:
    """What each further signal brings, and those of the rig whose noise is not known."""
    rig, further = task.model.rig, task.instruments.further
    seconds = expected.seconds
    if without and (reachable := _reachable(wanted, expected)):
        seconds = _needed(task, option, known, reachable)[0] * len(option.wave) / rig.sample_rate
    for name, channels in by_signal(further).items():
        kind = SHORTER if np.isfinite(without[name]) else DECISIVE
        places = [channel.partition(".")[2] for channel in channels]
        own = SIGNALS[name].instrument
        yield kind(Where(channel=name), instrument=own, places=places, with_s=seconds, without_s=without[name])
    for name, channels in by_signal(own for own in rig.instrumented if own not in further).items():
        signal = SIGNALS[name]
        yield NOT_KNOWN(Where(channel=name), channels=channels, instrument=signal.instrument, unit=signal.unit)
