"""What several rooms of tests share: the demo's data, virtual experiments, and the command run in this process."""

import os
import signal
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: threads of several workers only wait for each other
os.environ.setdefault("RAYON_NUM_THREADS", "1")  # as those of the core do

import pytest
from hypothesis import settings

import ambid
import ambid.cli
from ambid.demo import DATA
from ambid.excitation import prbs
from golden import FILE, Golden
from places import BENCH, LEVITATOR
from undrawn import undraw
from virtual import NAMES, VirtualBench

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # what a job in the background inherits
    signal.signal(signal.SIGINT, signal.default_int_handler)

pytest_plugins = ["budget", "validated"]
settings.register_profile("any machine", deadline=None, derandomize=True, database=None)
settings.load_profile("any machine")
DEMO_RIG, DEMO_RECORD = DATA / "rig.toml", DATA / "prbs.mat"


@dataclass(frozen=True)
class Finished:
    """How a command ended, and what it wrote."""

    code: int
    out: str
    err: str


def pytest_addoption(parser):
    parser.addoption("--golden", choices=("hold", "write"), default="hold", help="renew the golden texts; with -n 0")


def pytest_collection_modifyitems(config, items):
    if config.getoption("golden") == "write":  # only tests that have golden texts
        items[:] = [item for item in items if "golden" in item.fixturenames]


@pytest.fixture
def golden(request, tmp_path, tmp_path_factory):
    """The golden texts of this test."""
    place = f"{request.path.stem}::{request.node.name}"
    writes = request.config.getoption("golden") == "write"
    folders = str(tmp_path), str(tmp_path_factory.getbasetemp())
    return Golden(request.path.parent / FILE, place, *folders, writes, [0])


@pytest.fixture
def command(monkeypatch, capsys):
    """Run `ambid` with these arguments in this process, which gets its handlers of signals back."""

    def run(*arguments) -> Finished:
        capsys.readouterr()
        code = _ended(monkeypatch, arguments)
        return Finished(code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def command_in():
    """The same in a folder, for results that several tests read."""

    def run(folder, *arguments) -> Finished:
        out, err = StringIO(), StringIO()
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            patch.chdir(folder)
            return Finished(_ended(patch, arguments), out.getvalue(), err.getvalue())

    return run


def _ended(patch, arguments) -> int:
    """Exit code of the command."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    patch.setattr(sys, "argv", ["ambid", *map(str, arguments)])
    patch.setattr(sys, "unraisablehook", sys.unraisablehook)  # `main` has its own
    try:
        ambid.cli.main()
    except SystemExit as exit_:
        return exit_.code or 0
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return 0


@pytest.fixture(scope="session")
def rig():
    """The two-bearing bench of the independent simulator."""
    return ambid.Rig.load(BENCH)


@pytest.fixture(scope="session")
def demo_rig():
    return ambid.Rig.load(DEMO_RIG)


@pytest.fixture(scope="session")
def demo_record(demo_rig):
    return ambid.Record.load(DEMO_RECORD, demo_rig)


@pytest.fixture(scope="session")
def demo_truth():
    """Of the bench that gave `prbs.mat`."""
    k_i, k_s = (217.1999, 224.8019, 277.8034, 284.7485), (2391356.59, 2475054.07, 3129063.21, 3207289.79)
    return dict(zip(NAMES, (*k_i, *k_s, 0.00025), strict=True))


@pytest.fixture(scope="session")
def demo_estimate(demo_rig, demo_record):
    return ambid.identify(demo_rig, demo_record)


@pytest.fixture(scope="session")
def explained(tmp_path_factory):
    """The diagnosis of a mass on one axis with a hidden delay, and a record to validate on; from files."""
    rig = ambid.Rig.load(LEVITATOR)
    hidden = ambid.Model(rig).add("loop_delay", {"delay": 5e-5})
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=1, periods=4)
    folder = tmp_path_factory.mktemp("records")
    for name, factor, seed in (("train", 1.0, 1), ("other", 0.5, 2)):
        hidden.virtual_experiment(factor * i_e, seed=seed).save(folder / f"{name}.mat")
    found = ambid.diagnose(rig, folder / "train.mat", validate=[folder / "other.mat"])
    assert found.verdict == "explained"
    assert found.effects == ("loop_delay",)
    return found


@pytest.fixture
def undrawn(monkeypatch):
    """Reports without the work of drawing their pictures, and with few draws for their margins."""
    undraw(monkeypatch)


@pytest.fixture(scope="session")
def bench():
    return VirtualBench()


@pytest.fixture(scope="session")
def i_e():
    """Six periods of 510 samples on four axes."""
    return prbs(8, amplitude=0.15, hold=2, axes=4, periods=6)


@pytest.fixture(scope="session")
def run(bench, i_e):
    """One noisy virtual record."""
    return bench.records(i_e, [1], period=510)[0]
