"""An input of the fuzzer: a folder of files, one of them damaged, and the words of a command."""

from __future__ import annotations

import functools
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ambid
from fuzz import containers, mutations
from fuzz.bases import SUFFIXES
from fuzz.mutations import Rng, pick

RIGS = ("rig.toml", "rig.toml", "filter.toml", "matrices.toml", "bench.toml", "modes.toml")
ODD = (
    *mutations.NUMBERS,
    *mutations.WORDS,
    "y.A_zeta=2",
    "K_i",
    "K_i.*",
    "tau_e=1e-4",
    "a=b:c",
    "[",
    "*",
    "0x10",
    "1_0",
    "٣",
    "-",
)
OPTIONS: dict[str, tuple[str, ...]] = {
    "--period": ("1", "3", "4", "5", "126", "126", "630", "-1", "315", "252", "100"),
    "--map": (
        "y.A_zeta=2",
        "y.A_zeta=y.A_zeta:1e300",
        "t=1:nan",
        "y.=1",
        "y.A_zeta=3:1e-320",
        "fs=2",
        "i_e.A_zeta=2:1e-3",
        "i_e.A_zeta=1:inf",
    ),
    "--sample-rate": ("1e4", "1e4", "10001", "-1", "1e-300", "1e300", "inf"),
}
OF_IDENTIFY: dict[str, tuple[str, ...]] = OPTIONS | {
    "--free": ("K_i", "tau_e", "K_i,K_s", ",", "*"),
    "--fix": ("tau_e", "tau_e=1e-4", "tau_e=1e300", "K_s.A_zeta=1e-300", "K_i.A_zeta=inf"),
    "--share": ("K=K_i.*", "x=K_i.A_zeta", "=", "tau_e=K_i"),
    "--per-axis": ("tau_e", "K_i"),
    "--bound": (
        "tau_e=1e-4:1e-3",
        "tau_e=nan:1",
        "tau_e=-inf:inf",
        "K_i=0:1e308",
        "K_i.A_zeta=180:180",
        "tau_e=0:5e-324",
    ),
    "--weight": ("eq9", "y=1e300", "i_c=0", "y=1e-300", "y=inf", "y=nan", "i_c=1e308"),
    "--starts": ("2", "0", "-1", "5"),
    "--seed": ("-1", "0", "18446744073709551616"),
    "--max-evaluations": ("1", "0", "3", "-1"),
}
OF_SIMULATE: dict[str, tuple[str, ...]] = {
    "--seconds": ("0.05", "0.1", "nan", "inf", "-1", "1e300"),
    "--amplitude": ("1e300", "1e-300", "0", "nan", "-1", "1e8"),
    "--effect": (
        "loop_delay",
        "loop_delay:delay=1",
        "loop_delay:delay=nan",
        "sensor_lag:time_constant=1e300",
        "x:y=z",
        "flux_saturation",
    ),
    "--sensor-noise": ("1e300", "nan", "-1", "inf"),
    "--current-noise": ("1e300", "nan", "-1", "inf"),
    "--seed": ("-1", "18446744073709551616", "1"),
}
OF_COMMANDS = {
    "check": OPTIONS,
    "compare": OPTIONS,
    "identify": OF_IDENTIFY,
    "simulate": OF_SIMULATE,
    "effects": {},
    "static-load": {},
    "diagnose": OPTIONS | {"--tolerance": ("1", "0", "nan", "inf", "1e300"), "--effects": ("loop_delay", "", ",", "x")},
}  # fmt: skip


@dataclass(frozen=True)
class Input:
    """What is run: the kind of damage, the words of the command, and the file that is damaged, if one is."""

    kind: str
    words: list[str]
    damaged: str | None


@functools.cache
def healthy_record(folder: Path) -> ambid.Record:
    return ambid.Record.load(folder / "run.csv")


def make(seed: int, number: int, bases: Path, folder: Path) -> Input:
    """Write the files of an input into `folder`, which is made anew; the same for the same seed and number."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    rng = np.random.default_rng([seed, number])
    kind = pick(rng, KINDS)
    return kind(rng, bases, folder)


def _take(bases: Path, folder: Path, *names: str) -> None:
    for name in names:
        shutil.copy(bases / name, folder / name)


def _judge(rng: Rng, record: str) -> list[str]:
    """A command on the levitator and a record; the dear ones seldom."""
    command = pick(rng, ("check",) * 4 + ("compare",) * 4 + ("identify",) * 2 if rng.random() < 0.99 else ("diagnose",))
    words = [command, "rig.toml", record, "--json", "out.json"]
    if rng.random() < 0.2:
        words += ["--map", "y.A_zeta=y.A_zeta:1", "--map", "i_e.A_zeta=i_e.A_zeta", "--map", "t=t"]
    if command == "compare" and rng.random() < 0.05:
        words += ["--plot", "out.svg"]
    return words


def bytes_of_record(rng: Rng, bases: Path, folder: Path) -> Input:
    name = pick(
        rng, ("run.csv", "run.mat", "open.mat", "open.mat", "run73.mat", "run.h5", "run.h5", "run.parquet", "run.tdms")
    )
    _take(bases, folder, "rig.toml", name)
    mutations.in_bytes(rng, folder / name)
    return Input(f"bytes of {name}", _judge(rng, name), name)


def bytes_of_others(rng: Rng, bases: Path, folder: Path) -> Input:
    name = pick(rng, ("rig.toml", "model.json", "load.csv"))
    _take(bases, folder, "rig.toml", "bench.toml", "run.csv", "model.json", "load.csv")
    mutations.in_bytes(rng, folder / name)
    words = {
        "rig.toml": ["check", "rig.toml", "run.csv"],
        "model.json": ["compare", "rig.toml", "run.csv", "--model", "model.json"],
        "load.csv": ["static-load", "bench.toml", "load.csv"],
    }[name]
    return Input(f"bytes of {name}", [*words, "--json", "out.json"], name)


def fields_of_rig(rng: Rng, bases: Path, folder: Path) -> Input:
    name = pick(rng, RIGS)
    _take(bases, folder, name, "run.csv")
    mutations.toml(rng, folder / name)
    words = pick(
        rng,
        (
            ["check", name],
            ["check", name],
            ["effects", "--rig", name],
            ["simulate", name, "--out", "out.csv", "--seconds", "0.05"],
            ["compare", name, "run.csv"],
            ["identify", name, "run.csv", "--max-evaluations", "10"],
        ),
    )
    return Input("fields of a rig", [*words, "--json", "out.json"], name)


def fields_of_model(rng: Rng, bases: Path, folder: Path) -> Input:
    _take(bases, folder, "rig.toml", "run.csv", "model.json")
    mutations.structure(rng, folder / "model.json")
    words = pick(
        rng, (["compare", "rig.toml", "run.csv"], ["simulate", "rig.toml", "--out", "out.mat", "--seconds", "0.05"])
    )
    return Input("fields of a model", [*words, "--model", "model.json", "--json", "out.json"], "model.json")


def fields_of_csv(rng: Rng, bases: Path, folder: Path) -> Input:
    _take(bases, folder, "rig.toml", "run.csv")
    mutations.table(rng, folder / "run.csv")
    return Input("fields of .csv", _judge(rng, "run.csv"), "run.csv")


def fields_of_load(rng: Rng, bases: Path, folder: Path) -> Input:
    _take(bases, folder, "bench.toml", "load.csv")
    mutations.table(rng, folder / "load.csv")
    more = ["--deflection"] if rng.random() < 0.3 else []
    return Input(
        "fields of a loading", ["static-load", "bench.toml", "load.csv", "--json", "out.json", *more], "load.csv"
    )


def fields_of_containers(rng: Rng, bases: Path, folder: Path) -> Input:
    suffix = pick(rng, tuple(containers.WRITERS))
    _take(bases, folder, "rig.toml")
    record, path = healthy_record(bases), folder / f"run{suffix}"
    for _ in range(20):
        try:
            containers.WRITERS[suffix](rng, path, record)
            break
        except Exception:  # what the writer of the format refuses is no input
            path.unlink(missing_ok=True)
    return Input(f"fields of {suffix}", _judge(rng, path.name), path.name)


def options(rng: Rng, bases: Path, folder: Path) -> Input:
    record = f"run{pick(rng, SUFFIXES)}"
    _take(bases, folder, "rig.toml", "model.json", "bench.toml", "load.csv", record)
    command = pick(rng, tuple(OF_COMMANDS)[:-1] * 3 if rng.random() < 0.98 else ("diagnose",))
    words = [command]
    words += {
        "simulate": ["rig.toml", "--out", "out.csv"],
        "static-load": ["bench.toml", "load.csv"],
        "effects": [],
    }.get(command, ["rig.toml", record])
    known = OF_COMMANDS[command] or {"--rig": ("rig.toml", "none")}
    for _ in range(int(rng.integers(1, 4))):
        name = pick(rng, tuple(known))
        if name == "--map" and rng.random() < 0.8:
            words += ["--map", "y.A_zeta=y.A_zeta", "--map", "i_c.A_zeta=i_c.A_zeta", "--map", "t=t"]
        words += [name, pick(rng, known[name]) if rng.random() < 0.8 else pick(rng, ODD)]
    if rng.random() < 0.1:
        words.insert(
            int(rng.integers(len(words) + 1)), pick(rng, (*ODD, "--\x1b[31m", "-x", "--model", "--json", "--"))
        )
    return Input(f"options of {command}", [*words, "--json", "out.json"], None)


def names(rng: Rng, bases: Path, folder: Path) -> Input:
    """Files whose names steer a terminal, or are formulas."""
    stem = pick(rng, ("run_$5_$6", "a\x1b[31mb", "$\\frac{", "é\udcff", "n" * 200, "a\nb", "\u202egpj", "--x", "%s"))
    suffix = pick(rng, SUFFIXES)
    name = f"./{stem}{suffix}"
    _take(bases, folder, "rig.toml")
    shutil.copy(bases / f"run{suffix}", folder / name)
    if rng.random() < 0.3:
        (folder / name).write_bytes(b"damaged")
    words = [pick(rng, ("check", "compare", "identify")), "rig.toml", name, "--json", "out.json"]
    plot = ["--plot", "out.svg"] if words[0] == "compare" and rng.random() < 0.5 else []
    return Input("names of files", words + plot, None)


def campaign(rng: Rng, bases: Path, folder: Path) -> Input:
    shutil.copytree(bases / "bench_run", folder / "bench_run")
    name = pick(rng, ("rig.toml", "prbs_1.mat"))
    path = folder / "bench_run" / "6A" / name
    if name == "rig.toml" and rng.random() < 0.5:
        mutations.toml(rng, path)
    else:
        mutations.in_bytes(rng, path)
    return Input("campaigns", ["campaign", "bench_run", "--json", "out.json"], name)


KINDS = (
    (bytes_of_record,) * 5
    + (bytes_of_others,) * 2
    + (fields_of_rig,) * 5
    + (fields_of_model,) * 3
    + (fields_of_csv,) * 3
    + (fields_of_load, campaign)
    + (fields_of_containers,) * 6
    + (options,) * 4
    + (names,)
)
"""As often as they stand here."""


def description(made: Input) -> str:
    return json.dumps({"kind": made.kind, "words": made.words, "damaged": made.damaged}, indent=1)
