"""Commands that write files, on one axis, so small that they are run some hundred times."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

import ambid
from ambid.campaigns.tables import table_files
from ambid.demo import DATA, FILES
from ambid.monte_carlo.procedure import CHUNK
from ambid.robustness.uncertain_model import script_beside
from places import LEVITATOR, TESTS

HANGS = 300.0
"""Seconds after which a command that has not ended is taken to hang, on whatever machine."""
PROGRAM = "from ambid.cli import main; main()"
SIMULATE = ("simulate", "rig.toml", "--seconds", "0.1")
DIAGNOSE = ("diagnose", "rig.toml", "run.csv")
MARGINS = ("margins", "rig.toml", "--model", "model.json", "--draws", "100")
EXCITATION = ("excitation", "rig.toml", "--order", "7")
DESIGN = ("design", "rig.toml", "--accuracy", "K_i=5%", "--seconds", "1")
RUNS = ("--runs", "130", "--seconds", "0.1")
FEW = ("init",)
"""Jobs that are tried in the fast tier too."""
KINDS = ("init", "identify", "report", "campaign", "frequency-response", "export", "design", "monte-carlo")
"""Jobs that write each kind of file, once: all write by one way."""
JOBS = {
    "simulate": (*SIMULATE, "--out", "v.csv", "--force", "--json", "v.json"),
    "compare": ("compare", "rig.toml", "run.csv", "--json", "c.json", "--plot", "c.png"),
    "identify": ("identify", "rig.toml", "run.csv", "--json", "i.json", "--save", "m.json", "--plot", "i.svg"),
    "diagnose": (*DIAGNOSE, "--json", "d.json", "--save", "m.json"),
    "campaign": ("campaign", "bench", "--json", "k.json", "--plot", "k.svg", "--table", "k.tex"),
    "init": ("init", "--out", "new.toml", "--force", "--json", "n.json"),
    "check": ("check", "rig.toml", "run.csv", "--json", "q.json"),
    "static-load": ("static-load", "bench.toml", "load.csv", "--json", "l.json"),
    "rank": ("rank", "rig.toml", "run.csv", "--json", "r.json", "--plot", "r.svg"),
    "report": (*DIAGNOSE, "--json", "d.json", "--plot", "d.png", "--report", "d.html", "--pdf", "d.pdf"),
    "frequency-response": (
        *("frequency-response", "rig.toml", "run.csv", "--out", "frf.csv", "--force"),
        *("--json", "f.json", "--plot", "f.svg"),
    ),
    "margins": (*MARGINS, "--json", "g.json", "--plot", "g.svg"),
    "poles": ("poles", "rig.toml", "--model", "model.json", "--json", "p.json", "--plot", "p.svg"),
    "campbell": ("campbell", "bench.toml", "--json", "b.json", "--plot", "b.svg"),
    "export": (
        *("export", "model.json", "--uss", "u.mat", "--stepper", "u.stepper", "--fmu", "u.fmu", "--force"),
        *("--json", "u.json"),
    ),
    "effects": ("effects", "--json", "e.json"),
    "excitation": (*EXCITATION, "--out", "played.csv", "--force", "--json", "x.json"),
    "design": (*DESIGN, "--out", "designed.wav", "--force", "--json", "y.json"),
    "monte-carlo": ("monte-carlo", "rig.toml", *RUNS, "--out", "runs.parquet", "--json", "runs.json"),
}
"""With outputs in this folder, all of which are written after the job, or none."""
STORY = ("demo", "--out", "story", "--force", "--json", "story.json")
"""Takes seconds, and writes its files one by one."""
IN_THE_JOB = ("simulate", "monte-carlo")
"""Jobs that need what they write before they have a result to print."""
ONE_BY_ONE = ("demo", "monte-carlo")
"""Jobs whose files are there as soon as each is made."""
OPTIONS = ("--out", "--json", "--plot", "--save", "--report", "--pdf", "--table", "--uss", "--stepper", "--fmu")
"""That name a file to be written."""


def prepare(folder: Path) -> Path:
    """A folder with rigs, a record, a loading, a model, a campaign at two bias currents, and a folder for the story."""
    (folder / "story").mkdir()
    (folder / "runs.parquet").mkdir()
    rig = ambid.Rig.load(LEVITATOR)
    i_e = ambid.prbs(7, amplitude=0.1, hold=2, axes=1, periods=6)
    model = ambid.Model(rig).add("loop_delay", {"delay": 1e-4})
    model.virtual_experiment(i_e, seed=3).save(folder / "run.csv")
    model.save(folder / "model.json", np.diag([1.0, 1e6, 1e-9, 1e-12]))
    shutil.copy(LEVITATOR, folder / "rig.toml")
    shutil.copy(DATA / "rig.toml", folder / "bench.toml")
    shutil.copy(DATA / "static_1.csv", folder / "load.csv")
    for current in (4, 5):
        point = folder / "bench" / f"{current}A"
        point.mkdir(parents=True)
        text = LEVITATOR.read_text().replace("bias_current = 4.0", f"bias_current = {current}.0")
        (point / "rig.toml").write_text(text)
        for k in (1, 2):
            shutil.copy(folder / "run.csv", point / f"prbs_{k}.csv")
    return folder


def outputs(arguments):
    """The files that a command is to write."""
    if arguments == STORY:
        return [*(f"story/{name}" for name in FILES), "story.json"]
    named = [(o, Path(value)) for o, value in zip(arguments, arguments[1:], strict=False) if o in OPTIONS]
    return [str(path) for option, value in named for path in _files(arguments, option, value)]


def _files(arguments, option, path):
    """What an option has a command write: some make several files of one name."""
    if option == "--table":
        return table_files(path)
    if option == "--plot" and arguments[0] == "campaign":
        return ambid.plot.campaign_files(path)
    if option == "--uss":
        return [path, script_beside(path)]
    if option == "--out" and arguments[0] == "monte-carlo":
        parts = -(-int(arguments[arguments.index("--runs") + 1]) // CHUNK)
        return [path / "_plan.json", *(path / f"part-{k:06d}.parquet" for k in range(parts))]
    return [path]


def environment(**more):
    """One thread for BLAS, so that processes side by side do not wait for each other."""
    paths = os.pathsep.join([str(TESTS), *sys.path])
    return os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": paths} | more


def heard() -> None:
    """Let a process hear Ctrl-C, which it does not below a job in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(*arguments, program=PROGRAM, **options):
    """The command in a process."""
    options = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "preexec_fn": heard,
        "env": environment(),
    } | options
    return subprocess.Popen([sys.executable, "-c", program, *map(str, arguments)], text=True, **options)


def ended(*arguments, **options):
    """Exit code, stdout and stderr of the command."""
    process = start(*arguments, **options)
    out, err = process.communicate(timeout=HANGS)
    return process.returncode, out, err


def disturbed(folder, arguments, moments, *, drawn=True, data=None):
    """What `driver` reports of a command to which signals came at so many moments each.

    Maybe with an empty report, or a story of other data.
    """
    task = {"arguments": arguments, "outputs": outputs(arguments), "moments": moments, "drawn": drawn}
    ran = subprocess.run(
        [sys.executable, TESTS / "faults" / "driver.py"],
        input=json.dumps(task | {"data": data and str(data)}),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        cwd=folder,
        env=environment(),
        preexec_fn=heard,
    )
    return json.loads(ran.stdout)
