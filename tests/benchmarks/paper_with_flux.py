"""Identification at bias currents of 6, 8 and 10 A with Hall sensors: saturation, eddy currents or the amplifier?

    python tests/benchmarks/paper_with_flux.py rows.jsonl
    python tests/benchmarks/paper_with_flux.py rows.jsonl --report --table high_bias.md --picture high_bias.png

One axis of either bearing of a rotor, by the independent simulator, with one of four things hidden: iron that
saturates and has eddy currents, iron that saturates, an amplifier with a second lag, and one of second order. At each
bias current a small and a large PRBS are diagnosed together, of y and i_c, and of both with the flux density b beside
them; with typical tolerances. It goes on where it stopped; no part of the tests.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Record, Rig, diagnose
from ambid.excitation import prbs
from benchmarks.flux import NOISE
from benchmarks.grid import Row, aligned, markdown, options, read_rows, run_all
from hidden.bench import measured
from hidden.families import BENCHES, FAMILIES
from hidden.laws import magnet
from hidden.network import library


class Magnet(NamedTuple):
    """A pair of opposed magnets.

    Attributes
    ----------
    gap : float
        Air gap [m].
    knee : float
        Bias current at which the linear flux density were that of saturation [A].
    K_i, K_s, nominal_K_i, nominal_K_s : dict of float to float
        True ones by bias current, and those of the rig file [N/A, N/m].
    """

    gap: float
    knee: float
    K_i: dict[float, float]
    K_s: dict[float, float]
    nominal_K_i: dict[float, float]
    nominal_K_s: dict[float, float]


MAGNETS = {
    "A": Magnet(
        *(515e-6, 27.0),
        *({6.0: 217.2, 8.0: 279.8, 10.0: 316.0}, {6.0: 2.391e6, 8.0: 4.087e6, 10.0: 5.691e6}),
        *({6.0: 200.0, 8.0: 250.0, 10.0: 280.0}, {6.0: 2.2e6, 8.0: 3.7e6, 10.0: 5.1e6}),
    ),
    "B": Magnet(
        *(502e-6, 19.5),
        *({6.0: 277.8, 8.0: 346.9, 10.0: 357.7}, {6.0: 3.129e6, 8.0: 5.162e6, 10.0: 6.489e6}),
        *({6.0: 250.0, 8.0: 310.0, 10.0: 320.0}, {6.0: 2.8e6, 8.0: 4.6e6, 10.0: 5.8e6}),
    ),
}
"""K_s is that of Table 2 of the paper, K_i follows from it by a reluctance law; by the knees the iron of the simulator
has K_i at all three bias currents to 3 %."""
GAINS = {6.0: (28000.0, 60.0), 8.0: (31000.0, 58.0), 10.0: (34000.0, 58.0)}
"""Of the PID, proportional [A/m] and derivative [A s/m], by bias current."""
MASS = 1.0 / (1.0 / 69.0 + 0.23**2 / 3.4288)
"""Of the rotor (69 kg, 3.4288 kg m^2) as either magnet feels it, 0.23 m from the middle [kg]: there the other one is
all but a node."""
SATURATED = 1.8
"""Flux density of silicon iron in saturation [T]: of that the areas of the poles follow."""
EDDY = (0.2 * 5e-4 / (4.0 * 5e-4)) ** 2 * 2e6 * 4e-7 * np.pi / 3000.0
"""Time constant of laminations, (l d/(4 s0))^2 sigma mu0/mu_r [s]: a path l of 0.2 m through sheets of d = 0.5 mm and
two gaps of s0 = 0.5 mm, with sigma = 2 MS/m and mu_r = 3000, at frequencies where flux keeps to the surfaces of the
sheets; Zhu, Knospe and Maslen, IEEE/ASME Trans. Mechatronics 10 (2005) 59."""
SECOND_LAG = 10e-6
"""Of the amplifier: half a period of a switching stage of 50 kHz [s]."""
RESONANT = {"frequency_hz": 1100.0, "damping": 0.45}
"""Of an amplifier whose loop is tuned to be fast."""
AMPLITUDES = (0.1, 1.2)
"""Of the small and the large PRBS [A]."""
MACHINES = ("saturation and eddy currents", "saturation", "amplifier with a second lag", "amplifier of second order")
CHANNELS = ("y, i_c", "y, i_c, b")
SUSPECTS = ("flux_saturation", "eddy_currents", "amplifier_bandwidth", "loop_delay")
SHOWN = (*SUSPECTS, "nothing", "something_else")
HEAD = ("hidden", "bias [A]", "recorded", "verdict", *(f"P of `{name}`" for name in SUSPECTS), "misfit")
BENCH = BENCHES["bench"]


def hidden_in(machine: str, bearing: str, bias: float) -> dict[str, dict]:
    """What is hidden in a machine, as `simulate` takes it."""
    iron = {"level": bias / MAGNETS[bearing].knee, "curve": "blend"}
    return {
        MACHINES[0]: {"flux_saturation": iron, "eddy_currents": {"tau": EDDY}},
        MACHINES[1]: {"flux_saturation": iron},
        MACHINES[2]: {"amplifier_bandwidth": FAMILIES["amplifier_bandwidth"].at(SECOND_LAG, BENCH)},
        MACHINES[3]: {"amplifier_bandwidth": RESONANT},
    }[machine]


def rig_at(bearing: str, bias: float, is_iron: bool) -> Rig:
    """The rig file at a bias current, with Hall sensors; poles saturate at `SATURATED`, and the bias flux is read."""
    own, iron = MAGNETS[bearing], library().iron
    law = magnet(own.K_i[bias], own.K_s[bias], bias, bias / own.knee, "blend")
    area = 4e-7 * np.pi * law[2] / (SATURATED * law[6]) ** 2
    flux = SATURATED * iron(law[5], law[6]) if is_iron else np.sqrt(1e-7 * np.pi * own.K_i[bias] * bias / area)
    data = BENCH.rig.model_dump(by_alias=True, exclude_none=True) | {"tolerance": {}}
    data["rotor"] = {"kind": "mass", "mass": MASS}
    data["bearing"] = [
        {
            **{"name": bearing, "axes": ["zeta"], "position": 0.0, "sensor_position": 0.0},
            **{"bias_current": bias, "air_gap": own.gap, "pole_area": float(area), "bias_flux": float(flux)},
            **{"force_current": own.nominal_K_i[bias], "force_displacement": own.nominal_K_s[bias]},
        }
    ]
    data["controller"] |= dict(zip(("proportional", "derivative"), GAINS[bias], strict=True))
    return Rig(**data)


def made(machine: str, bearing: str, bias: float, seed: int) -> tuple[Rig, list[Record]]:
    """Records of a small and a large PRBS with everything recorded, and the rig file."""
    hidden, own = hidden_in(machine, bearing, bias), MAGNETS[bearing]
    rig = rig_at(bearing, bias, "flux_saturation" in hidden)
    truth = {"K_i": own.K_i[bias], "K_s": own.K_s[bias], "tau_e": BENCH.tau_e, **BENCH.noise}
    further = {f"b.{axis}": NOISE for axis in rig.axes}
    return rig, [
        measured(
            *(rig, prbs(9, amplitude=amplitude, hold=2, periods=4, seed=2 * seed + number), hidden),
            **truth | {"seed": 2 * seed + number, "further": further},
        )
        for number, amplitude in enumerate(AMPLITUDES)
    ]


def run(machine: str, bearing: str, bias: float, recorded: str, seed: int) -> Row:
    """Diagnose both records by their channels."""
    rig, records = made(machine, bearing, bias, seed)
    if recorded == CHANNELS[0]:
        records = [replace(record, further={}) for record in records]
    found = diagnose(rig, records)
    chances = found.probabilities
    rest = {"nothing": chances.nothing, "something_else": chances.something_else}
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "ambiguous_sets": [list(own) for own in found.ambiguous_sets],
        "probabilities": chances.effects | rest,
        "misfits": [step.misfit for step in found.history],
        "parameters": {name: [own.value, own.std_error] for name, own in found.parameters.items()},
        "seconds": found.seconds,
    }


def cells(rows: list[Row]) -> Iterator[tuple[str, float, str, list[Row]]]:
    """Machine, bias current, what was recorded, and the rows of that."""
    for machine in MACHINES:
        for bias in GAINS:
            for recorded in CHANNELS:
                own = [row for row in rows if [row["key"][k] for k in (0, 2, 3)] == [machine, bias, recorded]]
                if own:
                    yield machine, bias, recorded, own


def mean_of(rows: list[Row], name: str) -> float:
    """Mean probability of an effect."""
    return float(np.mean([row["probabilities"].get(name, 0.0) for row in rows]))


def named(row: Row) -> str:
    """Effects of the verdict, and those that the data cannot tell from them."""
    alike = {name: names for names in row["ambiguous_sets"] for name in names}
    return " + ".join(" or ".join(f"`{own}`" for own in alike.get(name, [name])) for name in sorted(row["effects"]))


def report(rows: list[Row]) -> Iterator[list[str]]:
    """A line for each machine, bias current and choice of channels."""
    for machine, bias, recorded, own in cells(rows):
        verdicts = Counter(f"{row['verdict']} {named(row)}".strip() for row in own)
        said = "; ".join(f"{text}: {count}" if len(own) > 1 else text for text, count in verdicts.most_common())
        before, after = (np.mean([row["misfits"][k] for row in own]) for k in (0, -1))
        chances = [f"{mean_of(own, name):.2f}" for name in SUSPECTS]
        yield [machine, f"{bias:g}", recorded, said, *chances, f"{before:.2f} to {after:.2f}"]


def picture(rows: list[Row], path: Path) -> None:
    """Probabilities of the suspects, a panel for each machine; what is hidden is framed."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    figure = Figure(figsize=(13, 6.4), layout="constrained")
    columns = [(bias, recorded) for recorded in CHANNELS for bias in GAINS]
    for panel, machine in zip(figure.subplots(2, 2, sharey=True).flat, MACHINES, strict=True):
        found = {(bias, recorded): own for of, bias, recorded, own in cells(rows) if of == machine}
        chances = [[mean_of(found[c], name) if c in found else np.nan for c in columns] for name in SHOWN]
        panel.imshow(chances, vmin=0.0, vmax=1.0, cmap="Blues", aspect="auto")
        for k, name in enumerate(SHOWN):
            for m, chance in enumerate(chances[k]):
                shown = f"{chance:.2f}" if np.isfinite(chance) else ""
                panel.text(m, k, shown, ha="center", va="center", color="w" if chance > 0.6 else "k")
            if name in hidden_in(machine, "B", 6.0):
                corner = (-0.48, k - 0.48)
                panel.add_patch(Rectangle(corner, len(columns) - 0.04, 0.96, fill=False, edgecolor="tab:red", lw=2))
        panel.axvline(len(GAINS) - 0.5, color="k", lw=1)
        below = {1: "\n" + CHANNELS[0], len(GAINS) + 1: "\n" + CHANNELS[1]}
        panel.set_xticks(range(len(columns)), [f"{bias:g} A{below.get(m, '')}" for m, (bias, _) in enumerate(columns)])
        panel.set_yticks(range(len(SHOWN)), SHOWN)
        panel.set_title(f"hidden: {machine}")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Make the rows, or report those that are there."""
    parser = options(__doc__, workers=1)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--bearings", nargs="*", default=["B"], choices=MAGNETS)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    if not given.report:
        kinds = product(range(given.seeds), given.bearings, reversed(MACHINES), CHANNELS, reversed(GAINS))
        jobs = [(machine, bearing, bias, recorded, seed) for seed, bearing, machine, recorded, bias in kinds]
        run_all(run, jobs, given.rows, given.workers)
    rows = read_rows(given.rows)
    print(aligned(HEAD, report(rows)))
    if given.table:
        given.table.write_text(markdown(HEAD, report(rows)))
    if given.picture:
        picture(rows, given.picture)


if __name__ == "__main__":
    main()
