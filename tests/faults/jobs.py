"""Commands that write files, on one axis, so small that they are run some hundred times."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import ambid
from ambid.demo import FILES
from places import LEVITATOR, TESTS

PROGRAM = "from ambid.cli import main; main()"
SIMULATE = ("simulate", "rig.toml", "--seconds", "0.1")
FEW = ("simulate", "identify")
"""Jobs that are tried in the fast tier too."""
JOBS = {
    "simulate": (*SIMULATE, "--out", "v.csv", "--force", "--json", "v.json"),
    "compare": ("compare", "rig.toml", "run.csv", "--json", "c.json", "--plot", "c.png"),
    "identify": ("identify", "rig.toml", "run.csv", "--json", "i.json", "--save", "m.json"),
    "diagnose": ("diagnose", "rig.toml", "run.csv", "--json", "d.json", "--save", "m.json"),
    "campaign": ("campaign", "bench", "--json", "k.json", "--plot", "k.svg"),
}
"""With outputs in this folder."""
STORY = ("demo", "--out", "story", "--force", "--json", "story.json")
"""Takes seconds, and writes its files one by one."""
OPTIONS = ("--out", "--json", "--plot", "--save", "--report")


def prepare(folder: Path) -> Path:
    """A folder with a rig file, a record, a campaign at two bias currents, and a folder for the story."""
    (folder / "story").mkdir()
    rig = ambid.Rig.load(LEVITATOR)
    i_e = ambid.prbs(7, amplitude=0.1, hold=2, axes=1, periods=6)
    ambid.Model(rig).add("loop_delay", {"delay": 1e-4}).virtual_experiment(i_e, seed=3).save(folder / "run.csv")
    shutil.copy(LEVITATOR, folder / "rig.toml")
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
    return [value for option, value in zip(arguments, arguments[1:], strict=False) if option in OPTIONS]


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
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def disturbed(folder, arguments, moments):
    """What `driver` tells of a command to which signals came at so many moments each."""
    ran = subprocess.run(
        [sys.executable, TESTS / "faults" / "driver.py"],
        input=json.dumps({"arguments": arguments, "outputs": outputs(arguments), "moments": moments}),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        cwd=folder,
        env=environment(),
        preexec_fn=heard,
    )
    return json.loads(ran.stdout)
