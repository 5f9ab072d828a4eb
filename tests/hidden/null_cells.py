"""Records in which nothing is hidden: a balanced, seeded sample over machines, noises, lengths and excitations.

Records come in blocks of `BLOCK`; in each, every level of every factor stands equally often, in an order of its own
(a Latin hypercube), so that any number of blocks is balanced, and the k-th record is the same in all of them.
"""

from dataclasses import asdict, dataclass
from functools import cache
from itertools import product

import numpy as np

from ambid import Model, Record, Rig, prbs
from ambid.errors import UnstableLoopError

from .bench import measured
from .families import BENCHES, Bench
from .long import LONG
from .one_axis import ONE_AXIS

MACHINES: dict[str, Bench] = {"levitator": ONE_AXIS, "bench": BENCHES["bench"], "small": BENCHES["small"], **LONG}
NOISES = ("white", "first order", "resonant", "quantised")
PERIODS = (3, 4, 6, 8, 12, 20, 0)
"""0 is an excitation that never repeats, as long as `WITHOUT` periods would be."""
WITHOUT, SAMPLES = 4, 200
"""No record has fewer samples than that."""
DAMPINGS = (0.001, 0.003, 0.01, 0.05)
SPEEDS = (0.0, 100.0, 400.0)
CONTROLLERS = ("analog", "digital")
BITS = (12, 13, 14, 15, 16)
ORDERS, HOLDS = range(5, 12), range(1, 5)
LEAST, MOST = 100, 50_000
"""Degrees of freedom: channels times samples per period."""
CLASSES = (0, 300, 1000, 3000, 10_000, 10**9)
SHARES = (0.3, 0.4, 0.5, 0.7, 1.0)
"""Edges of the classes of sensor noise over a step of the converter. What rounding does not forget under noise repeats
with the period: of white noise of 0.3 steps 0.8 % of the power of all noise, of 0.35 steps 0.2 %, of 0.4 steps 0.04 %,
times the periods in J/dof of y; noise that goes round the loop makes it less. Over 20 periods of the lowest class, what
is found may be no mere chance."""
SAFE = (0.002, 0.003, 0.01)
"""Damping of a mode that the controller would make unstable with less: the first of these that is stable."""
BLOCK = 140


@dataclass(frozen=True)
class Cell:
    """Levels of one record.

    Attributes
    ----------
    machine, noise, controller : str
    periods : int
    damping : float or None
        Of the bending modes, None where there are none; see `SAFE`.
    speed : float
        [rad/s]
    order, hold : int
        Of the PRBS.
    bits : int or None
        Of the converter that reads the displacements, its range being the air gap to both sides.
    share : float or None
        Rms of the sensor noise over a step of the converter.
    """

    machine: str
    noise: str
    controller: str
    periods: int
    damping: float | None
    speed: float
    order: int
    hold: int
    bits: int | None
    share: float | None

    @property
    def period(self) -> int:
        """Samples per period."""
        return (2**self.order - 1) * self.hold

    @property
    def nominal(self) -> int:
        """Channels times samples per period."""
        return 2 * len(MACHINES[self.machine].rig.axes) * self.period

    def levels(self) -> dict[str, str]:
        """Label of every factor."""
        first = next(k for k, high in enumerate(CLASSES[1:]) if self.nominal <= high)
        found = {
            "machine": f"{self.machine}, {2 * len(MACHINES[self.machine].rig.axes)} channels",
            "noise": self.noise,
            "controller": self.controller,
            "periods": str(self.periods or "none"),
            "damping": "no modes" if self.damping is None else f"{100 * self.damping:g} %",
            "speed": f"{self.speed:g} rad/s",
            "freedom": ("100 .. 300", "300 .. 1000", "1000 .. 3000", "3000 .. 10000", "10000 .. 50000")[first],
            "machine x noise": f"{self.machine}, {self.noise}",
        }
        if self.bits is not None and self.share is not None:
            near = next(k for k, high in enumerate(SHARES[1:]) if self.share <= high)
            found["bits"] = str(self.bits)
            found["noise / step"] = f"{SHARES[near]} .. {SHARES[near + 1]}"
        return found


def cell(index: int) -> Cell:
    """Levels of the record of that number."""
    return _block(index // BLOCK)[index % BLOCK]


@cache
def _block(number: int) -> list[Cell]:
    random = np.random.default_rng([number, 7])

    def spread(levels) -> list:
        levels = list(levels)
        random.shuffle(levels)  # those left over differ from block to block
        return [levels[k % len(levels)] for k in random.permutation(BLOCK)]

    def places() -> np.ndarray:
        return (random.permutation(BLOCK) + random.random(BLOCK)) / BLOCK

    columns = (
        *(spread(product(MACHINES, NOISES)), spread(CONTROLLERS), spread(PERIODS), spread(DAMPINGS)),
        *(spread(SPEEDS), spread(BITS), places(), places(), places()),
    )
    return [_cell(*levels) for levels in zip(*columns, strict=True)]


def _cell(of, controller, periods, damping, speed, bits, size, length, share) -> Cell:
    machine, noise = of
    rigid = machine == "levitator"
    channels = 2 * len(MACHINES[machine].rig.axes)
    found = [(order, hold) for order, hold in product(ORDERS, HOLDS)]
    freedom = np.array([channels * (2**order - 1) * hold for order, hold in found], dtype=float)
    samples = freedom / channels * (periods or WITHOUT)
    allowed = np.flatnonzero((freedom >= LEAST) & (freedom <= MOST) & (samples >= SAMPLES))
    low, high = np.log(freedom[allowed].min()), np.log(freedom[allowed].max())
    off = np.abs(np.log(freedom[allowed]) - (low + size * (high - low)))
    near = allowed[off <= off.min() + 0.25]  # several orders and holds give about the same length
    order, hold = found[near[int(length * len(near))]]
    is_read = noise == "quantised"
    return Cell(
        machine=machine,
        noise=noise,
        controller=controller,
        periods=periods,
        damping=None if rigid else damping,
        speed=0.0 if rigid else speed,
        order=order,
        hold=hold,
        bits=bits if is_read else None,
        share=SHARES[0] + share * (SHARES[-1] - SHARES[0]) if is_read else None,
    )


def described(index: int) -> dict:
    """The cell of that number as plain data."""
    own = cell(index)
    return asdict(own) | {"nominal": own.nominal, "levels": own.levels()}


def made(index: int) -> tuple[Rig, Record]:
    """Rig and record of that number."""
    own = cell(index)
    bench, random = MACHINES[own.machine], np.random.default_rng([index, 1])
    rig = _rig(own.machine, own.damping, own.speed, own.controller)
    axes, gap = len(rig.axes), rig.bearings[0].air_gap
    if own.periods:
        i_e = prbs(own.order, amplitude=bench.amplitude, hold=own.hold, axes=axes, periods=own.periods, seed=index)
    else:
        chips = random.integers(0, 2, (WITHOUT * (2**own.order - 1), axes))
        i_e = np.repeat(bench.amplitude * (2.0 * chips - 1.0), own.hold, axis=0)
    more: dict = {}
    if own.noise == "first order":
        more["colour"] = [1.0], [1.0, -0.9]
    if own.noise == "resonant":
        angle = 2.0 * np.pi * random.uniform(0.03, 0.3)
        more["colour"] = [1.0], [1.0, -2.0 * 0.98 * np.cos(angle), 0.98**2]
    if own.bits is not None and own.share is not None:
        more["adc_step"] = 2.0 * gap / 2**own.bits
        more["sensor_noise"] = own.share * more["adc_step"]
    return rig, measured(rig, i_e, {}, seed=index, **bench.truth, **more)


@cache
def _rig(machine: str, damping: float | None, speed: float, controller: str) -> Rig:
    rig = MACHINES[machine].rig
    if damping is not None:
        rig = _damped(rig, dampings(machine, damping))
    return rig.replace(speed=speed, controller=_like(rig, controller))


def _damped(rig: Rig, values: tuple[float, ...]) -> Rig:
    return rig.replace(rotor=rig.rotor.model_copy(update={"modal_damping": values}))


def _like(rig: Rig, controller: str):
    return rig.controller.model_copy(update={"implementation": controller})


@cache
def dampings(machine: str, level: float) -> tuple[float, ...]:
    """Damping of every bending mode: the level, or the next of `SAFE` with which the machine is stable."""
    bench = MACHINES[machine]
    values = [max(level, SAFE[-1])] * bench.rig.rotor.flexible_modes
    for mode in range(len(values)):
        for trial in (level, *(safe for safe in SAFE if safe > level)):
            tried = (*values[:mode], trial, *values[mode + 1 :])
            if _is_stable(bench, tried):
                values = list(tried)
                break
    return tuple(values)


def _is_stable(bench: Bench, values: tuple[float, ...]) -> bool:
    rig = _damped(bench.rig, values)
    true = {"tau_e": bench.tau_e}
    for name, values in (("K_i", bench.K_i), ("K_s", bench.K_s)):
        true |= {f"{name}.{axis}": value for axis, value in zip(rig.axes, values, strict=True)}
    for speed, controller in product(SPEEDS, CONTROLLERS):
        model = Model(rig.replace(speed=speed, controller=_like(rig, controller)))
        try:
            if not (model.is_stable and model.with_values(true).is_stable):
                return False
        except UnstableLoopError:
            return False
    return True
