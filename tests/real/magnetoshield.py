"""Real hardware: what the model of a single-axis levitator lacks, found from a record whose excitation was not logged.

    python tests/real/magnetoshield.py PATH/MagnetoShield_ID_Data.mat

The record is of the AutomationShield project (CC BY-NC-ND 4.0; Sensors 24 (2024) 538). It is read, never copied.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.io
from scipy.signal import cont2discrete

from ambid import (
    Diagnosis,
    LawFit,
    Model,
    Record,
    Rig,
    StaticForce,
    TransferFunctionController,
    diagnose,
    fit_force_law,
    identify,
)
from ambid.identification import DIPOLES
from ambid.loop.loop import open_plant

RIG = Path(__file__).with_name("magnetoshield.toml")
TRAIN, VALIDATE = (slice(6100, 7400), 14.5), (slice(4700, 5900), 15.0)  # steady rows, and their gap in mm
SET_POINTS = (
    (slice(700, 1250), 14.0),
    (slice(1550, 2750), 13.5),
    (slice(3200, 4000), 14.5),
    (slice(4700, 5900), 15.0),
    TRAIN,
)
NOMINAL = (0.28, 2.5)  # K_i [N/A] and K_s [N/m] that all set-points start from
WEIGHT = 0.945e-3 * 9.81  # N
HORIZON = 20
WEAK = 0.2  # of its value: an interval this wide says little


def main(path: str) -> None:
    """Tell the whole story."""
    rows = scipy.io.loadmat(path)["result"]
    published = Rig.load(RIG)
    rig = published.replace(controller=controller_of(rows, TRAIN))
    for name, own in (("published", published), ("the record's own", rig)):
        i_e = excitation(rows, *TRAIN, own)
        y = rows[TRAIN[0], 0] - TRAIN[1]
        alike = np.corrcoef(i_e, y)[0, 1]
        print(f"excitation by {name} controller: {i_e.std():.3f} V rms, correlation with y {alike:.2f}")
    found, train, validate = story(rows, rig)
    print(found, "\n")
    print(f"{HORIZON}-sample prediction     {'14.5 mm':>20s} {'15.0 mm, not used':>20s}")
    for step in found.history:
        errors = [prediction_error(step.model, record) for record in (train, validate)]
        cells = [f"{1e6 * y:6.2f} um {1e6 * i:7.1f} uA" for y, i in errors]
        print(f"{step.change:28s} {cells[0]:>20s} {cells[1]:>20s}")
    print(f"\n{'parameter':36s} {'value':>10s} {'95 % interval':>24s}")
    for name, p in identify(found.model, train).parameters.items():
        low, high = p.ci95
        weak = "  weakly determined" if high - low > WEAK * abs(p.value) else ""
        print(f"{name:36s} {p.value:10.4g} {f'{low:.4g} .. {high:.4g}':>24s} {p.unit}{weak}")
    joint, law, kept = all_set_points(rows, published)
    print("\nfive set-points at once:", joint, str(law), sep="\n")
    print(f"\n{HORIZON}-sample prediction of the rows that were not used, y [um] / i_c [uA]")
    print(f"{'':28s}", *(f"{record.name:>16s}" for record in kept))
    for name, model in [*((step.change, step.model) for step in joint.history), (f"{law.law.name} law", law.model)]:
        errors = [prediction_error(model.at(record), record) for record in kept]
        print(f"{name:28s}", *(f"{f'{1e6 * y:.2f} / {1e6 * i:.1f}':>16s}" for y, i in errors))
    emf = diagnose(found.model, train, validate=[validate], effects=["back_emf"])
    print("\nback-EMF by hand:", *(step.line() for step in emf.history), sep="\n")


def story(rows: np.ndarray, rig: Rig) -> tuple[Diagnosis, Record, Record]:
    """Identify K_i, K_s and R with an ideal coil, then let the record say what is missing."""
    train, validate = (record_of(rows, *part, rig) for part in (TRAIN, VALIDATE))
    ideal = identify(rig, train)
    return diagnose(ideal.model, train, validate=[validate]), train, validate


def all_set_points(rows: np.ndarray, published: Rig) -> tuple[Diagnosis, LawFit, list[Record]]:
    """All steady rows at once, with one controller, then one force law; and the rows that were kept back.

    The first 60 % of every part are diagnosed. At 13.5 mm the current is too small for its sensor, which reads at
    random, and is left out.
    """
    controller = controller_of(rows, *SET_POINTS)
    currents = {gap: [rows[part, 2].mean() for part, own in SET_POINTS if own == gap] for _, gap in SET_POINTS}
    train, kept = [], []
    for part, gap in SET_POINTS:
        bearing = published.bearings[0].model_copy(
            update={
                "air_gap": 1e-3 * gap,
                "bias_current": round(1e-3 * float(np.mean(currents[gap])), 5),
                "force_current": NOMINAL[:1],
                "force_displacement": NOMINAL[1:],
            }
        )
        rig = published.replace(name=f"rows {part.start}", bearings=(bearing,), controller=controller)
        middle = part.start + int(0.6 * (part.stop - part.start))
        first, rest = (record_of(rows, own, gap, rig) for own in (slice(part.start, middle), slice(middle, part.stop)))
        train.append((replace(first, i_c=None) if gap == 13.5 else first).at(rig))
        kept.append(rest.at(rig))
    joint = diagnose(train[-1].point, train)
    points = [record.point.bearings[0] for record in train]
    weight = [StaticForce(p.bias_current, p.air_gap, WEIGHT, 0.01 * WEIGHT) for p in points]
    return joint, fit_force_law(joint, DIPOLES, list(dict.fromkeys(weight))), kept


def record_of(rows: np.ndarray, part: slice, gap: float, rig: Rig) -> Record:
    """Steady rows as a record: y towards the coil [m], i_c [A], the command in V as i_ref; i_e is rebuilt from it."""
    y, u, i = rows[part].T[:3] - rows[part].T[:3].mean(axis=1, keepdims=True)
    return Record.from_arrays(
        y=-1e-3 * y[:, None], i_ref=u[:, None], i_c=1e-3 * i[:, None],
        sample_rate=rig.sample_rate, axes=rig.axes, rig=rig, name=f"{gap} mm",
    )  # fmt: skip


def controller_of(rows: np.ndarray, *parts: tuple[slice, float]) -> TransferFunctionController:
    """The PID that made u of the gap: least squares of u on y now, one and two samples ago, and its sum.

    The white noise that was added to u belongs to no y up to now, so that it does not bias them. Every part has a mean
    of its own.
    """
    tables, commands = [], []
    for k, (part, gap) in enumerate(parts):
        y = rows[part.start - 2 : part.stop, 0] - gap
        mean = np.tile(np.eye(len(parts))[k], (len(y) - 2, 1))
        tables.append(np.column_stack([y[2:], y[1:-1], y[:-2], np.cumsum(y)[2:], mean]))
        commands.append(rows[part, 1])
    fitted = np.linalg.lstsq(np.vstack(tables), np.concatenate(commands), rcond=None)[0]
    now, before, earlier, total = 1e3 * fitted[:4]
    numerator = (now + total, before - now, earlier - before, -earlier)
    return TransferFunctionController(
        implementation="digital", numerator=tuple(map(float, numerator)), denominator=(1.0, -1.0, 0.0, 0.0)
    )


def excitation(rows: np.ndarray, part: slice, gap: float, rig: Rig) -> np.ndarray:
    """What a controller leaves of the command [V]."""
    return np.asarray(record_of(rows, part, gap, rig).i_e)[:, 0]


def prediction_error(model: Model, record: Record, horizon: int = HORIZON) -> tuple[float, float]:
    """Rms error of y [m] and i_c [A] over so many samples from the command, the state at their start being fitted."""
    values = {slot: p.value for p in model.parameters for slot in p.slots}
    plant = open_plant(model.rig, model.effects).closed(values)
    early, late = (values.get(f"sampling_skew.{name}", 0.0) for name in ("displacement_early", "current_late"))
    a, b, c, d = sampled(plant, 1.0 / record.sample_rate, early, late)
    measured = np.hstack([record.y, record.i_c])
    size = measured.std(axis=0)
    powers = [np.linalg.matrix_power(a, k) for k in range(horizon)]
    free = np.stack([c @ power for power in powers])  # horizon x 2 x states
    pulse = np.stack([d, *(c @ power @ b for power in powers[:-1])])[..., 0]
    basis, singular, _ = np.linalg.svd((free / size[:, None]).reshape(2 * horizon, -1), full_matrices=False)
    basis = basis[:, singular > 1e-9 * singular[0]]
    left = []
    for start in range(0, record.samples - horizon + 1, horizon):
        u = record.i_ref[start : start + horizon, 0]
        forced = np.stack([np.convolve(u, pulse[:, k])[:horizon] for k in range(2)], axis=1)
        miss = ((measured[start : start + horizon] - forced) / size).ravel()
        left.append(((miss - basis @ (basis.T @ miss)).reshape(horizon, 2)) * size)
    y, i = np.sqrt(np.mean(np.square(left), axis=(0, 1)))
    return float(y), float(i)


def sampled(plant: tuple[np.ndarray, ...], dt: float, early: float, late: float) -> tuple[np.ndarray, ...]:
    """States when y is read and the command before: this one acts `early` later, and i_c is read `late` after that."""
    (until, by_last), (since, by_this), (reading, by_read) = (
        cont2discrete(plant, t)[:2] if t > 0.0 else (np.eye(len(plant[0])), 0.0 * plant[1])
        for t in (early, dt - early, late)
    )
    n = len(until)
    a = np.block([[since @ until, since @ by_last], [np.zeros((1, n + 1))]])
    b = np.vstack([by_this, [[1.0]]])
    c = np.hstack([plant[2], np.zeros((2, 1))])
    c[1] = plant[2][1] @ reading @ np.hstack([until, by_last])
    d = plant[3] + np.array([[0.0], plant[2][1] @ by_read])
    return a, b, c, d


if __name__ == "__main__":
    main(sys.argv[1])
