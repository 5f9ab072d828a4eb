"""Inputs that once ended in a traceback, a crash, a hang, or a swollen process: each breaks one thing in a folder."""

import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import nptdms
import numpy as np
import scipy.io

from fuzz import containers

Breaker = Callable[[], None]
CHECK, STATIC = ("check", "rig.toml"), ("static-load", "bench.toml", "load.csv")
MODEL = ("compare", "rig.toml", "run.csv", "--model", "model.json")

RUNS = ("monte-carlo", "rig.toml", "--runs", "2", "--seconds", "0.1")

COMPARE = ("compare", "rig.toml", "run.csv")


def replaced(name: str, old: str, new: str) -> Breaker:
    """Another text in a file; `old` is a pattern."""

    def make() -> None:
        text, count = re.subn(old, lambda _: new, Path(name).read_text(), count=1)
        assert count
        Path(name).write_text(text)

    return make


def column(name: str, k: int, change: Callable[[float], float]) -> Breaker:
    """Another column of a table."""

    def make() -> None:
        head, *rows = [line.split(",") for line in Path(name).read_text().split()]
        rows = [[*row[:k], repr(change(float(row[k]))), *row[k + 1 :]] for row in rows]
        Path(name).write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")

    return make


def text(name: str, content: str) -> Breaker:
    return lambda: Path(name).write_text(content) and None


def appended(variable: Callable[[], bytes]) -> Breaker:
    """A .mat file with a variable behind the others."""

    def make() -> None:
        held = scipy.io.loadmat("run.mat")
        scipy.io.savemat("run.mat", {key: held[key] for key in ("fs", "t", "i_e", "i_c", "axes")})
        with Path("run.mat").open("ab") as file:
            file.write(variable())

    return make


def many_zeros() -> bytes:
    """A compressed variable that expands beyond what it declares."""
    packed = zlib.compress(containers.array(6, (1, 1), b"")[:60] + bytes(1 << 20))
    return containers.element(15, packed)


def with_hdf5(change: Callable[[h5py.File], object]) -> Breaker:
    def make() -> None:
        with h5py.File("run.h5", "a") as file:
            change(file)

    return make


def instead(name: str, make: Callable[[h5py.File], object]) -> Breaker:
    def change(file: h5py.File) -> None:
        del file[name]
        make(file)

    return with_hdf5(change)


def chain(file: h5py.File) -> None:
    group = file
    for _ in range(500):
        group = group.create_group("g")


def tdms(step: object, cut: int = 0) -> Breaker:
    def make() -> None:
        with nptdms.TdmsWriter("run.tdms") as file:
            names = ("i_e.A_zeta", "y.A_zeta", "i_c.A_zeta")
            file.write_segment(
                [nptdms.ChannelObject("g", n, np.arange(630.0) % 7, {"wf_increment": step}) for n in names]
            )
        data = Path("run.tdms").read_bytes()
        Path("run.tdms").write_bytes(data[: len(data) - cut])

    return make


def covariance(change: Callable[[list[list[float]]], object]) -> Breaker:
    def make() -> None:
        content = json.loads(Path("model.json").read_text())
        change(content["covariance"])
        Path("model.json").write_text(json.dumps(content))

    return make


def free_response() -> None:
    """Excitation too small for its square, and a displacement that decays."""
    column("run.csv", 1, lambda i: 1e-300 * i)()
    column("run.csv", 2, lambda y: 1e-3 * y)()
    head, *rows = Path("run.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    decay = [float(c[2]) + 1e-4 * 0.98**k for k, c in enumerate(cells)]
    rows = [",".join([c[0], c[1], repr(y), *c[3:]]) for c, y in zip(cells, decay, strict=True)]
    Path("run.csv").write_text("\n".join([head, *rows]) + "\n")


def nothing() -> None:
    pass


EXTERNAL = (1 << 20,)

CORPUS: dict[str, tuple[Breaker, tuple[str, ...], str]] = {
    "rig, nested deep": (replaced("rig.toml", "name = .*", "name = " + "[" * 5000), CHECK, "rig.toml"),
    "rig, a number of 400 digits": (replaced("rig.toml", "mass = 12.0", "mass = 1" + "0" * 400), CHECK, "rotor.mass"),
    "rig, a lag of nothing": (
        replaced("rig.toml", "time_constant = 1e-4", "time_constant = 5e-324"),
        CHECK,
        "amplifier.time_constant 5e-324 1e-7",
    ),
    "rig, a frequency that is no mode's": (
        replaced("bench.toml", "1382.733", "13827.33"),
        ("check", "bench.toml"),
        "bench.toml rotor.bending_frequencies_hz[1]",
    ),
    "model, nested deep": (text("model.json", "[" * 100_000), MODEL, "model.json"),
    "model, a list for a number": (
        replaced("model.json", r'"value": [\d.]+', '"value": []'), MODEL, "model.json K_i.A_zeta value []"
    ),
    "model, an endless unit": (
        replaced("model.json", r'"unit": "N/A"', '"unit": ' + json.dumps(["x" * 100_000])),
        MODEL,
        "model.json K_i.A_zeta unit",
    ),
    "model, covariance of another size": (covariance(lambda rows: rows.pop()), MODEL, "model.json covariance (3, (4,"),
    "model, covariance not symmetric": (covariance(lambda m: m[0].__setitem__(1, 1.0)), MODEL, "model.json covariance"),
    "model, draws that are no physics": (
        covariance(lambda m: [m[k].__setitem__(k, 1e12) for k in range(4)]),
        ("margins", "rig.toml", "--draws", "40", "--model", "model.json"),
        "rig.toml 40",
    ),
    "model, negative variance": (covariance(lambda m: m[0].__setitem__(0, -1.0)), MODEL, "model.json covariance"),
    "csv, a million columns": (text("run.csv", "a," * 1_000_000 + "\n"), (*CHECK, "run.csv"), "run.csv 1048576"),
    "csv, twenty thousand columns": (text("run.csv", "a," * 20_000 + "\n1"), (*CHECK, "run.csv"), "run.csv 20000"),
    "csv, a line of megabytes": (replaced("run.csv", "0.0001", "x" * 5_000_000), (*CHECK, "run.csv"), "run.csv t, 2:"),
    "csv, names of escapes": (
        replaced("run.csv", r"y\.A_zeta", "\x1b" * 20_000), (*CHECK, "run.csv"), "run.csv y.<axis>"
    ),
    "csv, beyond floating point": (replaced("run.csv", "\n0.0001,", "\n1e400,"), (*CHECK, "run.csv"), "run.csv t inf"),
    "csv, a current of nothing": (column("run.csv", 3, lambda i: i / 1e300), (*CHECK, "run.csv"), "run.csv i_c.A_zeta"),
    "csv, an excitation of nothing": (column("run.csv", 1, lambda i: 1e-300 * i), COMPARE, "run.csv i_e"),
    "csv, an excitation of nothing, and a decay": (free_response, COMPARE, ""),
    "campbell, of a point mass": (nothing, ("campbell", "rig.toml"), "rig.toml"),
    "load, a current of nothing": (column("load.csv", 5, lambda i: 1e-300 * i), STATIC, "load.csv i_c.A_eta 1e-303"),
    "mat, cells in cells": (appended(lambda: containers.nested(30_000)), (*CHECK, "run.mat"), "run.mat 50"),
    "mat, two gigabytes": (appended(containers.bomb), (*CHECK, "run.mat"), "run.mat"),
    "mat, a cell of four thousand million": (
        appended(containers.dimensions), (*CHECK, "run.mat"), "run.mat 4294967296"
    ),
    "mat, more than it declares": (appended(many_zeros), (*CHECK, "run.mat"), "run.mat"),
    "hdf5, links in a circle": (
        with_hdf5(lambda file: file.create_group("g").__setitem__("up", file["/"])), (*CHECK, "run.h5"), ""
    ),
    "hdf5, another file's set": (
        instead("y", lambda file: file.__setitem__("y", h5py.ExternalLink("run73.mat", "/y"))),
        (*CHECK, "run.h5"),
        "run.h5 'y'",
    ),
    "hdf5, values in another file": (
        instead("y", lambda file: file.create_dataset("y", EXTERNAL, "f8", external=[("rig.toml", 0, 8 << 20)])),
        (*CHECK, "run.h5"),
        "run.h5 y",
    ),
    "hdf5, a set of terabytes": (
        instead("y", lambda file: file.create_dataset("y", (1 << 40, 1), "f8", chunks=True)),
        (*CHECK, "run.h5"),
        "run.h5 y (1099511627776,",
    ),
    "hdf5, never filled": (
        instead("y", lambda file: file.create_dataset("y", (1 << 22, 1), "f8", chunks=True)),
        (*CHECK, "run.h5"),
        "run.h5 y (4194304,",
    ),
    "hdf5, unused terabytes": (
        with_hdf5(lambda file: file.create_dataset("unused", (1 << 40,), "f8", chunks=True)), (*CHECK, "run.h5"), ""
    ),
    "hdf5, groups in groups": (with_hdf5(chain), (*CHECK, "run.h5"), "run.h5 32"),
    "tdms, a step in words": (tdms("fast"), (*CHECK, "run.tdms"), "run.tdms 't'"),
    "tdms, a step of nothing": (tdms(0.0), (*CHECK, "run.tdms"), "run.tdms 't'"),
    "tdms, an endless step": (tdms(np.inf), (*CHECK, "run.tdms"), "run.tdms 't'"),
    "tdms, cut": (tdms(1e-4, cut=5000), (*CHECK, "run.tdms"), "run.tdms"),
    "period of one sample": (nothing, (*CHECK, "run.csv", "--period", "1"), "run.csv 1; 3 630"),
    "period of five samples": (nothing, ("diagnose", "rig.toml", "run.csv", "--period", "5"), ""),
    "weights of 1e300": (nothing, ("identify", "rig.toml", "run.csv", "--weight", "y=1e300"), "y 1e+300"),
    "excitation, a seed below zero": (
        nothing, ("excitation", "rig.toml", "--out", "out.csv", "--seed", "-1"), "seed -1"
    ),
    "runs, an amplitude of 1e300": (nothing, (*RUNS, "--amplitude", "1e300"), ""),
    "runs, noise of 1e300": (nothing, (*RUNS, "--diagnose", "--sensor-noise", "1e300"), ""),
    "runs, more workers than memory": (nothing, (*RUNS, "--workers", "100000000000"), "--workers 100000000000 1000"),
    "runs beyond memory": (nothing, (*RUNS, "--runs", "1000000000000"), "runs 1000000000000 10000000"),
    "excitation beyond memory": (
        nothing, ("excitation", "rig.toml", "--out", "out.csv", "--periods", "1000000"), "1000000 4094 10000000"
    ),
    "runs, an amplitude of 1e-300": (nothing, (*RUNS, "--amplitude", "1e-300"), ""),
    "design, a peak of 1e-300": (
        nothing, ("design", "rig.toml", "--accuracy", "K_i=5%", "--peak", "1e-300"), "excitation 1e-300"
    ),
    "rig, a loop beyond floating point": (
        replaced("filter.toml", "300000.0", "3e305"), ("compare", "filter.toml", "run.csv"), "controller.numerator"
    ),
    "design, an accuracy of 1e-300": (
        nothing, ("design", "rig.toml", "--accuracy", "K_i=1e-300"), "accuracy K_i.A_zeta '1e-300'"
    ),
    "design, noise of 1e300": (
        nothing, ("design", "rig.toml", "--accuracy", "K_i=5%", "--sensor-noise", "1e300"), "sensor_noise 1e+300"
    ),
    "check, a fault and not a word": (
        column("run.csv", 1, lambda i: i / 1e3), (*CHECK, "run.csv", "--quiet"), "rig.toml run"
    ),
    "an escape for an option": (nothing, (*CHECK, "--\x1b[31m"), r"--\x1b[31m"),
}  # fmt: skip
"""What is broken, the words of the command, and what its error must name; nothing where the file is taken."""
