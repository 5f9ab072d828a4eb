"""Real hardware: a levitator that can be bought, driven by its reference alone, from the ideal coil on.

    python tests/real/polimi.py FOLDER         laws, verdicts, parameters of a step of each controller, errors of others
    python tests/real/polimi.py FOLDER why     why the K_i of both differ: the step's height is a filter's

The step of the PID gives K_i 0.77 with an interval of 2 %, ten steps of the LQI 1.08 +- 0.11, and a magnet whose force
goes with the square of its current has 2 m g / i, 1.1 to 1.4. The cause is the record: what the step holds as height as
read is the output of a Kalman filter, the same numbers as its filtered height, 10 001 distinct ones in 10 001 samples
where the other runs have the 2 500 of a quantum of 1.4 um, and a twentieth of their noise. The other runs of the PID
hold both heights. By the force equation alone, m a = K_i i + K_s s, which knows no controller, no coil and no voltage,
the heights as read give K_i 1.06, the filtered ones of the same runs 0.75, and the step 0.78: the filter passes about
0.7 of the motion from 7 to 26 Hz. So the K_i of the step is that of the magnet and the filter, and with the height as
read all runs agree with the LQI and with the holding currents. Currents that seem to be read a millisecond before
the heights (`sampling_skew`) are what a filter may look like.

From the ideal coil on, coil and induced voltage bring the simulated step of the PID from 27 um and 19 mA to 17 um and
14 mA, and its other steps, at the same filtered height, from 21 to 85 um to 13 to 46; the square law brings no more. A
sine, which passes through gaps of 7.8 to 13.4 mm, is missed by 112 um and 119 mA at the least. The steps of the LQI end
at 29 to 33 um and 9 to 10 mA, of which 16 um and 6 mA are noise.

The records are from github.com/Bocchio01/062020-Lab-Mechatronics (MIT licence): INTECO MLS2EM, upper coil.
"""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import scipy.io
from scipy.ndimage import gaussian_filter1d

from ambid import Model, Record, Rig, StateSpaceController, check, compare, diagnose, identify
from ambid.arrays import FloatArray
from ambid.identification import ParameterEstimate

VOLTS, OFFSET = 11.658, -0.561  # of the driver, per unit of control


HEIGHT, CURRENTS, FILTERED = 2, 4, 8
"""Rows of z as read, of I1 and of the filtered z."""
RATE, FORGETS = 1000.0, 0.8186666666666667
POSITION, SPEED, CURRENT, TOTAL = 287.01398781, 6.2578892, 1.29916672, 447.2135955
"""Gains of the LQI on filtered position and speed, current, and the sum of the filtered error; from its records."""


def pid_rig(folder: Path) -> Rig:
    """That of the PID, which acts on the error to the reference."""
    rig = Rig.load(folder / "rig_pid.toml")
    return rig.replace(controller=rig.controller.model_copy(update={"reference": True}))


def lqi_rig(folder: Path) -> Rig:
    """That of the state feedback with an integral; states: filtered y, that a sample before, the sum of the error."""
    law = StateSpaceController(
        implementation="digital",
        inputs=("y", "i_c", "r"),
        A=((FORGETS, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0 / RATE, 0.0, 1.0)),
        B=((1.0 - FORGETS, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0 / RATE)),
        C=((VOLTS * (POSITION + RATE * SPEED), -VOLTS * RATE * SPEED, VOLTS * TOTAL),),
        D=((0.0, VOLTS * CURRENT, 0.0),),
    )
    return Rig.load(folder / "rig_pid.toml").replace(controller=law)


def record_of(path: Path, rig: Rig, rows: slice, height: int = HEIGHT) -> Record:
    """Rows of a file as a record: y and r towards the coil [m], i_c [A], the command [V] as i_ref."""
    logouts = scipy.io.loadmat(path)["logouts"][:, rows]
    r, z, current, control = logouts[1], logouts[height], logouts[CURRENTS], logouts[6]
    return Record.from_arrays(
        y=-z[:, None], r=-r[:, None], i_c=current[:, None], i_ref=VOLTS * control[:, None] + OFFSET,
        sample_rate=rig.sample_rate, axes=rig.axes, rig=rig, name=path.stem.split("__")[0],
    )  # fmt: skip


STEPS = {
    "multisteps_updown__LQI-low_pass.old.mat": (1500, 4500, 7500, 10500),
    "multisteps_stairs__LQI-low_pass.old.mat": (1000, 3000, 5000, 7000, 9000, 11000),
}
"""Rows from which each record of the LQI makes one step."""
UNUSED = (
    ("multisteps_updown", (1500, 4500, 7500, 10500), 4400),
    ("multisteps_stairs", (1000, 3000, 5000, 7000, 9000, 11000), 2900),
    ("sinusoidal_fast", (3000,), 6000),
)
"""Runs of the PID that nothing is learned from: rows from which each makes one step, or three periods of a sine."""
IDEAL = 0.0005
"""Lag of a coil that follows its voltage [s]: half a sample."""
QUANTA = "1.4 / 2.5"
LADDER = ("amplifier_bandwidth", "back_emf", "force_nonlinearity")
"""What is added to the ideal coil, one after the other; the LQI, which acts on the current, is not stable with it."""
SUSPECTS = (
    (),
    ("sensor_lag",),
    ("back_emf",),
    ("amplifier_bandwidth",),
    ("force_nonlinearity",),
    ("sampling_skew",),
    ("sampling_skew", "back_emf"),
)
"""What might bend the K_i of the step of the PID, and does not."""
MASS = 0.06054  # kg
WEIGHT = MASS * 9.81  # N


SMOOTHED = 6.0
"""Standard deviation of the Gaussian that smooths both sides of the force equation alike [samples]; K_i as read is the
same to 1 % from 4 to 12."""
BEFORE, AFTER = 60, 450
"""Samples about a step in which the ball moves."""


def why(folder: Path) -> None:
    """K_i beside what might bend it, over ten steps of the LQI, and what the PID's other runs act on."""
    record = record_of(folder / "step__PID_anti_windup-KF.mat", pid_rig(folder), slice(3000, 10000))
    by_eq_9 = identify(pid_rig(folder), record, weights="eq9").parameters
    print("PID, eq. 9:", line(by_eq_9))
    for effects in SUSPECTS:
        found = diagnose(pid_rig(folder), record, effects=effects)
        louder = max((own.statistic for own in found.fit.adequacy.failed("motion")), default=1.0)
        left = f"J {found.fit.cost:.0f}, {louder:.1f} times the noise in motion"
        print(f"PID, {' + '.join(effects) or 'base'}:", line(found.parameters), left, sep="  ")
    values = []
    for name, firsts in STEPS.items():
        length = 4400 if "updown" in name else 2900
        for first in firsts:
            step = record_of(folder / name, lqi_rig(folder), slice(first, first + length))
            found = identify(lqi_rig(folder), step)
            values.append((found.parameters["K_i.A_zeta"].value, found.parameters["K_i.A_zeta"].std_error))
            ratio = found.parameters["K_s.A_zeta"].value / found.parameters["K_i.A_zeta"].value
            held = f"K_s/K_i {ratio:.0f}, 2 m g/i {2.0 * WEIGHT / step.i_c.mean():.2f}, misfit {found.misfit:.2f}"
            print(
                f"LQI, {-1e3 * step.r[0, 0]:.0f} to {-1e3 * step.r[-1, 0]:.0f} mm:",
                line(found.parameters),
                held,
                sep="  ",
            )
    value, error = np.array(values).T
    mean = np.average(value, weights=error**-2)
    scatter = np.sum(((value - mean) / error) ** 2)
    error_of_mean = 1.96 / np.sqrt(np.sum(error**-2))
    print(f"LQI, all: K_i {mean:.2f} +- {error_of_mean:.2f}, chi-squared {scatter:.0f} of {len(value) - 1}")
    print(f"K_s/K_i of the currents at which the ball leaves its rest: {static_ratio(folder)} A/m")
    for path in sorted(folder.glob("*KF.mat")):
        print(path.stem, filtered(path), grain(path), motion(path), sep=": ")
    by_force(folder)


def motion(path: Path) -> str:
    """How far the ball moves by both heights, and how often the command is at a limit."""
    logouts = scipy.io.loadmat(path)["logouts"][:, 3000:9000]
    u, read, height = logouts[6], logouts[HEIGHT], logouts[FILTERED]
    clipped = 100.0 * np.mean((u == u.max()) | (u == u.min()))
    ends = f"{1e3 * read.min():.1f} to {1e3 * read.max():.1f} mm"
    rms = f"{1e3 * read.std():.1f} mm rms as read, {1e3 * height.std():.1f} filtered"
    return f"{ends}, {rms}; command at a limit in {clipped:.1f} % of the samples"


def grain(path: Path) -> str:
    """How many distinct heights a record has, and their noise above a quarter of the sample rate at rest."""
    logouts = scipy.io.loadmat(path)["logouts"]
    shown = []
    for what, height in (("as read", logouts[HEIGHT]), ("filtered", logouts[FILTERED])):
        at_rest = height[1500:1990]
        lines = np.fft.rfft((at_rest - at_rest.mean()) * np.hanning(len(at_rest)))
        noise = np.sqrt(np.mean(np.abs(lines[len(lines) // 2 :]) ** 2) / np.sum(np.hanning(len(at_rest)) ** 2))
        shown.append(f"{what} {len(np.unique(height))} distinct heights of {len(height)}, noise {1e6 * noise:.2g} um")
    return "; ".join(shown)


def by_force(folder: Path) -> None:
    """K_i and K_s of m a = K_i i + K_s s + const, by runs of the PID and by which height.

    The signals of another step, whose noise is its own, are the instruments: noise of height and current bends nothing.
    """
    updown, stairs = (
        scipy.io.loadmat(folder / f"multisteps_{name}__PID_anti_windup-KF.mat")["logouts"]
        for name in ("updown", "stairs")
    )
    for name, run in (("updown", updown), ("stairs", stairs)):
        steps = [first for first in np.flatnonzero(np.diff(run[1])) if first + AFTER < 14000]
        for what, height in (("as read", HEIGHT), ("filtered", FILTERED)):
            around = [around_step(run, first, height) for first in steps]
            found = [instrumental(own, other) for own, other in zip(around, around[1:] + around[:1], strict=True)]
            print(f"PID, {name}, heights {what}:", spread(found))
    step = scipy.io.loadmat(folder / "step__PID_anti_windup-KF.mat")["logouts"]
    other = around_step(updown, int(np.flatnonzero(np.diff(updown[1]))[0]), FILTERED)
    found = [instrumental(around_step(step, int(np.flatnonzero(np.diff(step[1]))[0]), HEIGHT), other)]
    print("PID, step, its only height:", spread(found))


def around_step(run: FloatArray, first: int, height: int) -> tuple[FloatArray, FloatArray]:
    """Acceleration [m/s^2], and current [A], height [m] and one beside each other, smoothed alike."""
    rows = slice(first - BEFORE, first + AFTER)
    z, current = run[height, rows], run[CURRENTS, rows]
    inner = slice(int(4 * SMOOTHED) + 1, -int(4 * SMOOTHED) - 1)
    acceleration = RATE**2 * np.convolve(z, (1.0, -2.0, 1.0), "same")
    a, i, s = (gaussian_filter1d(own, SMOOTHED)[inner] for own in (acceleration, current, z))
    return a, np.column_stack([i, s, np.ones(len(i))])


def instrumental(own: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> tuple[float, float]:
    """K_i [N/A] and K_s [N/m]: z grows away from the magnet, whose force on the ball is -K_i i."""
    (a, regressors), (_, instruments) = own, other
    found = np.linalg.solve(instruments.T @ regressors, instruments.T @ a)
    return -MASS * found[0], MASS * found[1]


def spread(found: list[tuple[float, float]]) -> str:
    """Means of K_i and K_s, with the 95 % interval of their scatter."""
    shown = []
    for name, values in zip(("K_i", "K_s"), np.array(found).T, strict=True):
        half = f" +- {1.96 * values.std(ddof=1) / np.sqrt(len(values)):.2g}" if len(values) > 1 else ""
        shown.append(f"{name} {values.mean():.3g}{half}")
    return ", ".join(shown)


def line(parameters: Mapping[str, ParameterEstimate]) -> str:
    """Values with their 95 % intervals."""
    return ", ".join(f"{name} {p.value:.3g} +- {1.96 * p.std_error:.2g}" for name, p in parameters.items())


def static_ratio(folder: Path, lowest: float = 0.008, highest: float = 0.014) -> str:
    """Slope of the current that lifts the ball by the height from which it does, with its 95 % interval."""
    found = []
    for path in sorted((folder / "force").glob("*.mat")):
        _, z, _, current, *_ = scipy.io.loadmat(path)["measurements"]
        rest = np.median(z[:50])
        if lowest < rest < highest:
            found.append((rest, current[np.argmax(np.abs(z - rest) > 1e-4)]))
    (slope, _), spread = np.polyfit(*np.array(found).T, 1, cov=True)
    return f"{slope:.0f} +- {1.96 * np.sqrt(spread[0, 0]):.0f}"


def filtered(path: Path) -> str:
    """What of the increments of its command a PID of the height leaves, of the filtered one, and of the filter's speed.

    A linear filter of height and current would leave nothing of the speed that the next height is predicted with.
    """
    _, r, z, _, current, _, u, _, height, speed = scipy.io.loadmat(path)["logouts"][:10, 1500:9900]
    jumps = np.convolve((np.diff(r, prepend=r[0]) != 0) | (u == u.max()) | (u == u.min()), np.ones(9), "same") > 0
    k = np.flatnonzero(~jumps)[3:]

    def left(of: FloatArray, *by: FloatArray) -> float:
        table = np.column_stack([own / np.abs(own).max() for own in (*by, np.ones(len(of)))])
        return float(np.std(of - table @ np.linalg.lstsq(table, of, rcond=None)[0]) / np.std(of))

    of_raw, of_filtered = (left(u[k] - u[k - 1], *((own - r)[k - lag] for lag in range(3))) for own in (z, height))
    if (height == z).all():
        return (
            f"acts on the height in the record, to {of_raw:.0e}, which is the filtered one: that as read is not there"
        )
    of_speed = left(speed[k] - speed[k - 1], height[k - 1], speed[k - 1], z[k - 1], current[k - 1])
    return (
        f"acts on the filtered height to {of_filtered:.0e} (as read {of_raw:.0e}), whose filter is not linear: "
        f"a linear one leaves {100 * of_speed:.0f} % of its speed, and so no [controller] states it"
    )


def main(folder: Path) -> None:
    """Laws, verdicts and parameters of the step of the PID and of the first step of the LQI, 10 to 12 mm both."""
    for rig, name, rows, unused in runs(folder):
        record = record_of(folder / name, rig, rows)
        print(record, *record.notes, sep="\n  ")
        for law in check(rig, [record]).laws.get(record.name, ()):
            print(law.line())
        found = diagnose(rig, record)
        print(found)
        for parameter, value in found.parameters.items():
            print(f"{parameter:36s} {value.value:10.4g} +- {1.96 * value.std_error:.2g} {value.unit}")
        is_stable_with_it = "i_c" not in rig.controller.inputs
        ladder(with_ideal_coil(rig) if is_stable_with_it else rig, record, unused)


def runs(folder: Path) -> Iterator[tuple[Rig, str, slice, list[Record]]]:
    """Of each controller its rig, a step to learn from, and other steps, which are not used.

    The PID acts on the filtered height, which is all that its step has: so its other runs are taken with that.
    """
    pid, lqi = pid_rig(folder), lqi_rig(folder)
    of_pid = [
        record_of(folder / f"{name}__PID_anti_windup-KF.mat", pid, slice(first, first + length), FILTERED)
        for name, firsts, length in UNUSED
        for first in firsts
    ]
    yield pid, "step__PID_anti_windup-KF.mat", slice(3000, 10000), of_pid
    of_lqi = [
        record_of(folder / name, lqi, slice(first, first + (4400 if "updown" in name else 2900)))
        for name, first in ((name, first) for name, firsts in STEPS.items() for first in firsts[:3])
    ]
    first, *others = of_lqi
    yield lqi, "multisteps_updown__LQI-low_pass.old.mat", slice(1500, 5900), others


def ladder(start: Rig, record: Record, unused: list[Record]) -> None:
    """The error of the simulated runs after each effect, in those that were not used too."""
    columns = [record, *unused]
    titles = [
        f"{-1e3 * own.r[0, 0]:.0f} to {-1e3 * own.r[-1, 0]:.0f} mm" if len(np.unique(own.r)) == 2 else "sine"
        for own in columns
    ]
    print(f"{f'um / mA, quanta {QUANTA}; the first is used':52s}", *(f"{own:>14s}" for own in titles))
    effects: list[str] = []
    is_ideal = start.amplifier.time_constant == IDEAL
    for added in ("", *LADDER[0 if is_ideal else 1 :]):
        effects += [added] if added else []
        model = (diagnose(start, record, effects=effects) if effects else identify(start, record)).model
        errors = [simulation_error(model, own) for own in columns]
        title = f"+ {added}" if added else "ideal coil" if is_ideal else "coil of the rig file"
        print(f"{title:52s}", *(f"{f'{1e6 * y:.0f} / {1e3 * i:.1f}':>14s}" for y, i in errors))


def with_ideal_coil(rig: Rig) -> Rig:
    """A rig whose current follows the voltage at once."""
    return rig.replace(amplifier=rig.amplifier.model_copy(update={"time_constant": IDEAL}))


def simulation_error(model: Model, record: Record) -> tuple[float, float]:
    """Rms of y [m] and i_c [A] that a simulated run misses, means removed.

    The loop is simulated from its reference, and from how the run began.
    """
    missed = compare(model, record).records[0].residual
    y, i = (missed - missed.mean(axis=0)).std(axis=0)
    return float(y), float(i)


if __name__ == "__main__":
    (why if "why" in sys.argv[2:] else main)(Path(sys.argv[1]))
