"""Whole experiments with a known answer: a rig file, records to train on and to validate with, and the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.record import Record
from ambid.rig import Rig

from .bench import simulate_all
from .families import BENCHES, SPEED, Bench
from .physics import CATALOGUE
from .sizes import Sized, sized

KINDS = {
    "analog": "the bench with its analog PID",
    "digital": "the PID in samples, at twice the rate of the record, with half a sample of delay",
    "other_rotor": "a small spindle recorded at 20 kHz, its bearings tilted against each other",
    "compressor": "a third rotor at 12.5 kHz with a digital PID, other periods and other noises",
    "gravity": "the rotor hangs in the bearings: currents carry an offset",
    "without_i_c": "currents were not recorded",
    "two_amplitudes": "two records to train on, at full and at half amplitude; validated in between",
    "turning": "the rotor turns and has an unbalance, which is part of the truth",
}
MACHINES = {"other_rotor": "small", "compressor": "compressor"}
SPREAD = 0.03  # of the true K_i, K_s, tau_e from one seed to the next


@dataclass(frozen=True)
class Truth:
    """The answer.

    Attributes
    ----------
    effects : tuple of str
        What is hidden, the unbalance of a turning rotor included.
    parameters : dict
        Of each effect.
    K_i, K_s : ndarray, shape (axes,)
    tau_e : float
    in_catalogue : bool
        Whether the catalogue has a name for every effect.
    score : float
        Rise of J on the bench for which the (first) effect was sized; 0 without effects.
    """

    effects: tuple[str, ...]
    parameters: dict[str, dict]
    K_i: np.ndarray
    K_s: np.ndarray
    tau_e: float
    in_catalogue: bool
    score: float

    @property
    def verdict(self) -> str:
        """What an honest diagnosis should come to, if it sees the effect: adequate, explained or none."""
        if not self.effects:
            return "adequate"
        return "explained" if self.in_catalogue else "none_of_the_candidates"


def experiment(
    effect: str | Sequence[str] | None, size: str = "clear", seed: int = 0, *, kind: str = "analog"
) -> tuple[Rig, list[Record], list[Record], Truth]:
    """Make an experiment.

    Parameters
    ----------
    effect : str, sequence of str or None
        What is hidden: names of `physics.py`, several for several at once, None for nothing.
    size : {"barely", "clear", "large"}
        As sized on the bench of this kind, see `sizes.py`.
    seed : int
        Of the noises, of the true K_i, K_s, tau_e and of the state that the excitation starts from.
    kind : str
        One of `KINDS`.

    Returns
    -------
    rig : Rig
        What is known.
    train, validate : list of Record
    truth : Truth

    Raises
    ------
    ValueError
        For an unknown kind, effect or size.
    MachineFailure
        If the machine with this effect is unstable.
    """
    if kind not in KINDS:
        raise ValueError(f"{kind}: no such kind of experiment; there are {', '.join(KINDS)}")
    names = () if effect is None else (effect,) if isinstance(effect, str) else tuple(effect)
    at = MACHINES.get(kind, "bench")
    found = {name: sized(name, size, at) for name in names}
    return experiment_on(BENCHES[at], found, seed, kind=kind)


def experiment_on(
    bench: Bench, found: Mapping[str, Sized], seed: int = 0, *, kind: str = "analog"
) -> tuple[Rig, list[Record], list[Record], Truth]:
    """The same on any machine, with effects that were sized for it."""
    names = tuple(found)
    hidden = {name: dict(one.parameters) for name, one in found.items()}
    amplitude = min((one.amplitude for one in found.values()), default=bench.amplitude)
    rig = bench.known_to(names)
    if kind == "turning":
        rig = rig.replace(speed=SPEED)
        hidden.setdefault("unbalance", dict(sized("unbalance", "large").parameters))
    if kind == "digital":
        pid = rig.controller.model_copy(
            update={"implementation": "digital", "sample_rate": 2.0 * rig.sample_rate, "delay_samples": 0.5}
        )
        rig = rig.replace(controller=pid)

    random = np.random.default_rng([seed, 0])
    n = len(rig.axes)
    K_i = np.array(bench.K_i) * (1.0 + SPREAD * random.uniform(-1.0, 1.0, n))
    K_s = np.array(bench.K_s) * (1.0 + SPREAD * random.uniform(-1.0, 1.0, n))
    tau_e = bench.tau_e * (1.0 + SPREAD * random.uniform(-1.0, 1.0))
    start = int(random.integers(2**31))
    levels = {"train": [1.0], "validate": [1.0]}
    if kind == "two_amplitudes":
        levels = {"train": [1.0, 0.5], "validate": [0.75]}
    jobs = [
        {
            "rig": rig,
            "i_e": bench.excitation(level * amplitude, start + number),
            "hidden": hidden,
            "K_i": K_i,
            "K_s": K_s,
            "tau_e": tau_e,
            "seed": int(np.random.default_rng([seed, 1, number]).integers(2**31)),
            "flexible_modes": None if "rotor_bending_mode" in names else bench.rig.rotor.flexible_modes,
            "gravity": 9.81 if kind == "gravity" else 0.0,
            "with_i_c": kind != "without_i_c",
            "period": bench.period,
            "name": name,
            **bench.noise,
        }
        for number, (name, level) in enumerate((name, level) for name in levels for level in levels[name])
    ]
    records = simulate_all(jobs)
    split = len(levels["train"])
    truth = Truth(
        effects=tuple(hidden),
        parameters=hidden,
        K_i=K_i,
        K_s=K_s,
        tau_e=tau_e,
        in_catalogue=all(name in CATALOGUE for name in hidden),
        score=max((one.score for one in found.values()), default=0.0),
    )
    return rig, records[:split], records[split:], truth
