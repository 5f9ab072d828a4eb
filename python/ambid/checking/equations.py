"""The two equations of a record, line by line: current from excitation and displacement, displacement from current.

    i_c = A d (h i_e - K (y - r))    the controller's, which needs no rotor
    y   = G i_c                      the machine's, which needs no controller

with the amplifier A, the controller K, its delay d, the hold h of the excitation, and the plant G. Each is held against
the record by itself, so that what is wrong shows on its own side; both stay valid where the nominal loop is unstable.
What lies above the Nyquist frequency is neglected, which costs a per cent or two.
"""

from dataclasses import replace
from itertools import permutations, product

import numpy as np
from scipy.optimize import linear_sum_assignment

from ambid.arrays import ComplexArray, FloatArray
from ambid.checking.lines import Lines, moves, times
from ambid.checking.nominal import NominalLoop
from ambid.rig import Rig


def commanded(loop: NominalLoop, lines: Lines) -> dict[str, ComplexArray]:
    """What every gain of the controller makes of what it reads, before delay, hold and amplifier, (lines, axes) [A]."""
    seen = np.hstack([lines.y, np.zeros_like(lines.y) if lines.i_c is None else lines.i_c, lines.r])
    return {gain: times(response, seen) for gain, response in loop.law(lines.frequency_hz).items()}


def controller_terms(loop: NominalLoop, lines: Lines) -> tuple[ComplexArray, dict[str, ComplexArray]]:
    """A d h i_e, and A d K y of every gain of the controller, each (lines, axes) [A]."""
    of_i_e, of_y = loop.paths(lines.frequency_hz)
    fed_back = {name: of_y[:, None] * own for name, own in commanded(loop, lines).items()}
    return of_i_e[:, None] * lines.i_e, fed_back


def controller_missed(loop: NominalLoop, lines: Lines) -> float:
    """Part of i_c, by rms over all axes, that the controller's equation misses as it stands."""
    excited, fed_back = controller_terms(loop, lines)
    i_c = np.asarray(lines.i_c)
    return float(np.linalg.norm(excited - sum(fed_back.values()) - i_c) / np.linalg.norm(i_c))


def reordered(loop: NominalLoop, lines: Lines) -> tuple[str, list[int], float]:
    """The order of the columns of one signal that fits the controller's equation best.

    Returns
    -------
    signal : str
        i_e, y or i_c.
    order : list of int
        Column to be taken for each axis.
    missed : float
        Part of i_c that is then missed.
    """
    excited, fed_back = controller_terms(loop, lines)
    of_y = loop.paths(lines.frequency_hz)[1][:, None]
    own_gains = [np.einsum("ljj->lj", part[:, :, : loop.axes]) for part in loop.law(lines.frequency_hz).values()]
    own_gain = of_y * np.sum(own_gains, axis=0)
    i_c = np.asarray(lines.i_c)
    left = excited - sum(fed_back.values()) - i_c
    ways = {
        "i_e": (excited, np.ones_like(own_gain), 1.0),
        "y": (lines.y, own_gain, -1.0),
        "i_c": (i_c, np.ones_like(own_gain), -1.0),
    }
    found = []
    for signal, (columns, gain, sign) in ways.items():
        change = sign * gain[:, :, None] * (columns[:, None, :] - columns[:, :, None])
        cost = np.sum(np.abs(left[:, :, None] + change) ** 2, axis=0)
        rows, order = linear_sum_assignment(cost)
        found.append((signal, order.tolist(), float(np.sqrt(cost[rows, order].sum()) / np.linalg.norm(i_c))))
    return min(found, key=lambda entry: entry[2])


def called_for(loop: NominalLoop, lines: Lines) -> tuple[ComplexArray, ComplexArray]:
    """The excitation that the record calls for, and the recorded one, both weighted, (lines, axes).

    With i_c the controller's equation says it, else y and the nominal closed loop do.
    """
    if lines.i_c is not None:
        excited, fed_back = controller_terms(loop, replace(lines, r=np.zeros_like(lines.r)))
        of_reference = sum(fed_back.values()) - sum(controller_terms(loop, lines)[1].values())
        return lines.i_c + sum(fed_back.values()), excited + of_reference
    closed = loop.closed(lines.frequency_hz)[:, : loop.axes, : loop.axes]
    weight = np.linalg.norm(closed, axis=(1, 2))[:, None]
    return weight * np.linalg.solve(closed, lines.y[..., None])[..., 0], weight * loop.driven(lines)


def correlation(a: ComplexArray, b: ComplexArray) -> float:
    """Correlation of two sets of spectra of the same shape, in phase, over all lines and axes together."""
    return float(np.real(np.vdot(a, b)) / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-300))


def chance(a: ComplexArray, b: ComplexArray) -> float:
    """Standard deviation of the correlation of two sets of spectra that have nothing to do with each other."""
    overlap = np.sqrt(0.5 * np.sum(np.abs(a) ** 2 * np.abs(b) ** 2))
    return float(overlap / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-300))


def best_order(wanted: ComplexArray, given: ComplexArray) -> list[int]:
    """The order of the columns of `given` that is most like `wanted`."""
    return linear_sum_assignment(-np.real(wanted.conj().T @ given))[1].tolist()


def best_shift(wanted: ComplexArray, given: ComplexArray, lines: Lines) -> tuple[int, float]:
    """By how many samples, round the window, the given excitation is early, and the correlation once it is delayed."""
    cross = np.zeros(lines.window // 2 + 1, dtype=complex)
    cross[lines.index] = np.sum(wanted * given.conj(), axis=1)
    overlap = np.fft.irfft(cross, n=lines.window) * lines.window / 2.0
    shift = int(np.argmax(overlap))
    size = np.linalg.norm(wanted) * np.linalg.norm(given)
    return (shift if shift <= lines.window // 2 else shift - lines.window), float(overlap[shift] / size)


def gain_of(measured: ComplexArray, expected: ComplexArray) -> FloatArray:
    """Rms of the measured columns over that of the expected ones, for each axis that moves."""
    moving = moves(measured)
    return np.linalg.norm(measured[:, moving], axis=0) / np.linalg.norm(expected[:, moving], axis=0)


def expected_displacement(loop: NominalLoop, lines: Lines) -> ComplexArray:
    """y that the nominal machine makes of i_c, or, where that was not recorded, the nominal closed loop of i_e."""
    if lines.i_c is not None:
        return times(loop.machine(lines.frequency_hz), lines.i_c)
    return loop.answered(lines).y


def exchanged_axes(loop: NominalLoop, lines: Lines) -> tuple[list[int], float]:
    """The naming of axes, the same in all signals, that the nominal machine fits best; among equals the rig's own.

    Bearings may be exchanged with those of as many axes, and zeta with eta in each.

    Returns
    -------
    order : list of int
        Column to be taken for each axis.
    ratio : float
        What is then missed of y, up to a common factor, over what is missed in the record as it stands.
    """
    f = lines.frequency_hz
    response = loop.closed(f)[:, : loop.axes, : loop.axes] if lines.i_c is None else loop.machine(f)
    cause = loop.driven(lines) if lines.i_c is None else lines.i_c
    alike = {o: correlation(lines.y[:, o], times(response, cause[:, o])) for o in _namings(loop.rig)}
    missed = {order: np.sqrt(1.0 - value**2) for order, value in alike.items()}
    best = next(order for order, value in missed.items() if value <= 1.05 * min(missed.values()))
    return list(best), float(missed[best] / missed[tuple(range(loop.axes))])


def _namings(rig: Rig) -> list[tuple[int, ...]]:
    """Orders of the axes that keep those of a bearing together, the rig's first."""
    first = np.cumsum([0, *(len(bearing.axes) for bearing in rig.bearings)])
    groups = [tuple(range(a, b)) for a, b in zip(first[:-1], first[1:], strict=True)]
    found = []
    for bearings in permutations(groups) if len(groups) <= 4 else [groups]:
        if [len(group) for group in bearings] == [len(group) for group in groups]:
            for turns in product((False, True), repeat=len(groups)):
                pairs = zip(bearings, turns, strict=True)
                found.append(tuple(j for group, turned in pairs for j in (group[::-1] if turned else group)))
    return found
