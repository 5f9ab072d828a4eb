"""Records that a machine with hidden physics would give: `simulate` one, `simulate_all` many at once."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from ambid.record import Record
from ambid.rig import Rig

from .machine import build
from .physics import settle


class MachineFailure(RuntimeError):
    """The rotor has left its air gap: the machine is unstable, or hit too hard."""


def simulate(
    rig: Rig,
    i_e: ArrayLike,
    hidden: Mapping[str, Mapping[str, object]] | None = None,
    *,
    K_i: ArrayLike,
    K_s: ArrayLike,
    tau_e: ArrayLike,
    seed: int | None,
    sensor_noise: float = 50e-9,
    current_noise: float = 5e-3,
    colour: tuple[Sequence[float], Sequence[float]] | None = None,
    adc_step: float = 0.0,
    recorder_noise: float = 0.0,
    recorder_colour: tuple[Sequence[float], Sequence[float]] | None = None,
    recorder_step: float = 0.0,
    flexible_modes: int | None = None,
    gravity: float = 0.0,
    load: tuple[float, float, float] = (0.0, 0.0, 0.0),
    warm_up: float | None = None,
    with_i_c: bool = True,
    period: int | None = None,
    longest_step: float = 10e-6,
    further: Mapping[str, float] | None = None,
    name: str = "record",
) -> Record:
    """Record of a levitated machine whose physics has more in it than its rig file says.

    Sensor noise is held over each sample and goes round the loop; recorder and current noise are on the record only.
    The machine runs for `warm_up` before t = 0, without excitation. What is linear is integrated exactly.

    Parameters
    ----------
    rig : Rig
        What is known of the machine.
    i_e : array_like, shape (N, axes)
        Excitation [A], held over each sample.
    hidden : mapping of effect to its parameters
        Names and units in `physics.py`.
    K_i, K_s, tau_e : float or array_like, shape (axes,)
        True small-signal values [N/A, N/m, s].
    seed : int or None
        Of both noises; None is a record without noise.
    sensor_noise, current_noise : float
        Rms of white noise [m, A].
    colour : tuple of two sequences of float, optional
        Numerator and denominator, in samples, of a filter that shapes the sensor noise; its rms stays.
    adc_step : float
        Step of what reads the displacements [m], for the record and for a digital controller; 0 is none.
    recorder_noise : float
        Rms of noise in the recorder's displacements [m], which the controller does not hear.
    recorder_colour : tuple of two sequences of float, optional
        As `colour`, of the noise of the recorder: that of the displacements and that of the currents.
    recorder_step : float
        Step of the recorder's converter of the displacements [m]; the controller reads without it. 0 is none.
    flexible_modes : int, optional
        True number of bending modes per plane; by default the rig's. `rotor_bending_mode` adds to it.
    gravity : float
        Along -y [m/s^2].
    load : tuple of float
        Constant force on the rotor: z of the place [m], F_x and F_y [N]; F_x alone along the axis of a plain mass.
    warm_up : float, optional
        [s]; by default 0.3, and 2.5 with gravity or a load.
    with_i_c : bool
        Whether i_c was recorded.
    period : int, optional
        Samples per period, noted in the record.
    longest_step : float
        Of the integration of what is nonlinear or delayed [s].
    further : mapping of str to float, optional
        Further channels, such as ``b.A_zeta``, with the rms of white noise on each record of them. Of a flux density
        the true pole area is `Bearing.pole_area`.

    Raises
    ------
    ValueError
        For an unknown effect or parameter.
    MachineFailure
        If the rotor leaves its air gap.
    """
    settled = settle(hidden or {})
    i_e = np.asarray(i_e, dtype=float)
    n, rate = len(rig.axes), rig.sample_rate
    warm = round((warm_up if warm_up is not None else 2.5 if gravity or any(load[1:]) else 0.3) * rate)
    machine = build(
        rig,
        settled,
        **{key: np.broadcast_to(value, n) for key, value in (("K_i", K_i), ("K_s", K_s), ("tau_e", tau_e))},
        flexible_modes=flexible_modes,
        gravity=gravity,
        load=load,
        before=warm / rate,
        seconds=len(i_e) / rate,
        adc_step=adc_step if rig.controller.is_digital else 0.0,
        further=tuple(further or ()),
    )
    random = np.random.default_rng(seed)
    early, late = max(-machine.late, 0), max(machine.late, 0)
    rows = warm + len(i_e) + late
    inputs = np.zeros((rows, 2 * n))
    inputs[warm : warm + len(i_e), :n] = i_e
    white = random.standard_normal((rows, n))
    inputs[:, n:] = 0.0 if seed is None else sensor_noise * (white if colour is None else coloured(white, *colour))
    controller = rig.controller
    pieces = round(controller.rate(rate) / rate) if controller.is_digital else 1
    piece = 1.0 / rate / pieces
    recorded = machine.network.run(
        machine.outputs,
        inputs,
        piece=piece,
        pieces=pieces,
        steps=max(4, int(np.ceil(piece / longest_step - 1e-9))) if machine.network.needs_fine_steps else 1,
        warm_up=warm - early,
        controller=controller.state_space(n, rate) if controller.is_digital else None,
    )
    gaps = np.array([bearing.air_gap for bearing in rig.bearings for _ in bearing.axes])
    if recorded is None or np.any(np.abs(recorded[:, :n]).max(axis=0) > 2.0 * gaps):
        raise MachineFailure(f"{rig.name}: the rotor has left its air gap with {dict(hidden or {})}")
    y, i_c = (recorded[first : first + len(i_e)] for first in (early, late))
    beyond = dict(zip(further or {}, y[:, 2 * n :].T, strict=True))
    y, i_c = y[:, :n], i_c[:, n : 2 * n]
    if adc_step:
        y = adc_step * np.rint(y / adc_step)
    if seed is not None:
        white = random.standard_normal(i_c.shape)
        i_c = i_c + current_noise * (white if recorder_colour is None else coloured(white, *recorder_colour))
    if seed is not None and recorder_noise:
        white = random.standard_normal(y.shape)
        y = y + recorder_noise * (white if recorder_colour is None else coloured(white, *recorder_colour))
    if seed is not None:
        beyond = {name: own + further[name] * random.standard_normal(len(own)) for name, own in beyond.items()}
    if recorder_step:
        y = recorder_step * np.rint(y / recorder_step)
    return Record(name, rate, rig.axes, i_e, y, i_c if with_i_c else None, period=period, further=beyond)


def coloured(white: np.ndarray, numerator: Sequence[float], denominator: Sequence[float]) -> np.ndarray:
    """White noise through a filter, its rms kept; the first rows are still on their way there."""
    impulse = lfilter(numerator, denominator, np.eye(1, 20_000)[0])
    return lfilter(numerator, denominator, white, axis=0) / np.linalg.norm(impulse)


def measured(rig: Rig, i_e: ArrayLike, hidden: Mapping[str, Mapping[str, object]] | None, **more: object) -> Record:
    """A record as a file of it would be loaded: its period is found, its channels are checked."""
    found = simulate(rig, i_e, hidden, **more)
    signals = {name: getattr(found, name) for name in ("y", "i_e", "i_c", "further")}
    return Record.from_arrays(**signals, sample_rate=rig.sample_rate, axes=rig.axes, rig=rig)


def simulate_all(jobs: Sequence[Mapping[str, object]]) -> list[Record]:
    """Run `simulate` with each of the keyword sets, on all cores; results in order, the same on any number of cores."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda job: simulate(**job), jobs))
