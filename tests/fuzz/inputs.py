"""An input of the fuzzer: a folder of files, one of them damaged, and the words of a command."""

import functools
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ambid
from fuzz import containers, mutations
from fuzz.bases import RESPONSES, SUFFIXES
from fuzz.commands import COMMANDS, ODD, SHORT, Options
from fuzz.mutations import Rng, pick

RIGS = ("rig.toml", "rig.toml", "filter.toml", "matrices.toml", "bench.toml", "modes.toml")


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
    usual = ("check",) * 4 + ("compare",) * 3 + ("identify",) * 2 + ("frequency-response",) * 2
    command = pick(rng, usual if rng.random() < 0.98 else ("diagnose", "rank", "workbench"))
    if command == "workbench":
        return [command, "--no-browser", "rig.toml", record]
    words = [command, "rig.toml", record, "--json", "out.json"]
    if rng.random() < 0.2:
        words += ["--map", "y.A_zeta=y.A_zeta:1", "--map", "i_e.A_zeta=i_e.A_zeta", "--map", "t=t"]
    if command in ("compare", "frequency-response") and rng.random() < 0.05:
        words += ["--plot", "out.svg"]
    return words


def _of_model(rng: Rng) -> list[str]:
    """A command on a saved model of the levitator."""
    on_rig = (
        ["compare", "rig.toml", "run.csv"],
        ["simulate", "rig.toml", "--out", "out.mat", *SHORT],
        ["margins", "rig.toml", "--draws", "40"],
        ["poles", "rig.toml"],
        ["campbell", "rig.toml", "--measured", "model.json"],
        ["excitation", "rig.toml", "--out", "out.wav"],
        ["monte-carlo", "rig.toml", "--runs", "1", *SHORT],
    )
    targets = (["--uss", "out.mat"], ["--stepper", "out.step"], ["--fmu", "out.fmu"])
    if rng.random() < 0.25:
        return ["export", "model.json", *pick(rng, targets)]
    return [*pick(rng, on_rig), "--model", "model.json"]


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
        "model.json": _of_model(rng),
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
            ["frequency-response", name, "run.csv"],
            ["margins", name, "--draws", "40"],
            ["poles", name],
            ["campbell", name],
            ["excitation", name, "--out", "out.mat"],
            ["design", name, "--effect", "loop_delay", "--seconds", "1"],
            ["monte-carlo", name, "--runs", "1", *SHORT],
        ),
    )
    return Input("fields of a rig", [*words, "--json", "out.json"], name)


def fields_of_model(rng: Rng, bases: Path, folder: Path) -> Input:
    _take(bases, folder, "rig.toml", "run.csv", "model.json")
    mutations.structure(rng, folder / "model.json")
    return Input("fields of a model", [*_of_model(rng), "--json", "out.json"], "model.json")


def fields_of_csv(rng: Rng, bases: Path, folder: Path) -> Input:
    _take(bases, folder, "rig.toml", "run.csv")
    mutations.table(rng, folder / "run.csv")
    return Input("fields of .csv", _judge(rng, "run.csv"), "run.csv")


def responses(rng: Rng, bases: Path, folder: Path) -> Input:
    """A damaged frequency response."""
    name = pick(rng, RESPONSES)
    _take(bases, folder, "rig.toml", name)
    if name.endswith(".csv") and rng.random() < 0.6:
        mutations.table(rng, folder / name)
    else:
        mutations.in_bytes(rng, folder / name)
    command = pick(rng, ("compare", "identify", "frequency-response", "check"))
    return Input(f"responses in {Path(name).suffix}", [command, "rig.toml", name, "--json", "out.json"], name)


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
    shutil.copytree(bases, folder, dirs_exist_ok=True)
    name = pick(rng, [name for name, own in COMMANDS.items() for _ in range(own.often)])
    command = COMMANDS[name]
    record = f"run{pick(rng, SUFFIXES)}"
    words = [name, *(record if word == "RECORD" else word for word in command.words)]
    for _ in range(int(rng.integers(1, 4))):
        words += _option(rng, command.options)
    if rng.random() < 0.1:
        words.insert(
            int(rng.integers(len(words) + 1)), pick(rng, (*ODD, "--\x1b[31m", "-x", "--model", "--json", "--"))
        )
    return Input(f"options of {name}", [*words, *command.last], None)


def _option(rng: Rng, known: Options) -> list[str]:
    """An option with a value, mostly one of those that are known."""
    name = pick(rng, tuple(known))
    if not known[name]:
        return [name]
    value = pick(rng, known[name]) if rng.random() < 0.8 else pick(rng, ODD)
    mapped = ["y.A_zeta=y.A_zeta", "i_c.A_zeta=i_c.A_zeta", "t=t"] if name == "--map" and rng.random() < 0.8 else []
    return [word for text in mapped for word in ("--map", text)] + ([name, value] if name else [value])


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
    + (responses,) * 2
    + (fields_of_containers,) * 6
    + (options,) * 8
    + (names,)
)
"""As often as they stand here."""


def description(made: Input) -> str:
    return json.dumps({"kind": made.kind, "words": made.words, "damaged": made.damaged}, indent=1)
