"""What the tests of the workbench share: a hidden delay of a mass on one axis, and the chain that finds it."""

import os
import shutil
import signal
import subprocess
import sys

import pytest

import ambid
from ambid.workbench import Bench, Session
from hidden.one_axis import ONE_AXIS, record
from workbench.person import Person

HIDDEN = {"loop_delay": {"seconds": 5e-5}}
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="package")
def begun():
    train, kept = record(HIDDEN, seed=1), record(HIDDEN, seed=2, share=0.5)
    return Session.begin(Bench(ambid.Model(ONE_AXIS.rig), (train,), (kept,)))


@pytest.fixture(scope="package")
def fitted(begun):
    return begun.fit().ranked()


@pytest.fixture(scope="package")
def added(fitted):
    return fitted.add("loop_delay")


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need the package playwright")
    pytest.importorskip("plotly", reason="the workbench's charts need plotly")
    pytest.importorskip("uvicorn", reason="the workbench's server needs uvicorn")
    if BROWSER is None:
        pytest.skip("the browser tests need chromium")
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def workbench():
    """Start the command with these arguments, and return its address."""
    running = []

    def start(*arguments):
        code = "from ambid.cli import main; main()"
        command = [sys.executable, "-c", code, "workbench", *map(str, arguments), "--no-browser"]
        path = os.pathsep.join(entry for entry in sys.path if entry)
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
        )
        running.append(process)
        assert process.stdout is not None
        return process.stdout.readline().strip()

    yield start
    for process in running:
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The mass on one axis with its own delay, as files."""
    folder = tmp_path_factory.mktemp("small")
    record(HIDDEN, seed=1).save(folder / "train.mat")
    return ONE_AXIS.rig.path, folder / "train.mat"


@pytest.fixture(scope="module")
def address(workbench, small):
    """Where it is served, with a session for every window."""
    return workbench(*small)


@pytest.fixture(scope="module")
def served(workbench, small):
    """Where the same is served with a record to validate on."""
    rig, train = small
    record(HIDDEN, seed=2, share=0.5).save(train.with_name("kept.mat"))
    return workbench(rig, train, "--validate", train.with_name("kept.mat"))


@pytest.fixture(scope="module")
def at_work(browser, served):
    """A person whose model is fitted and its candidates ranked."""
    person = Person(browser, served)
    person.page.click("#fit")
    person.steps(2)
    person.page.click("#rank")
    person.page.wait_for_selector("#candidates tbody tr")
    return person


@pytest.fixture
def ranked(at_work):
    """The same person, without what another test did after the ranking, on a page that is opened anew."""
    while at_work.page.locator("#steps tbody tr").count() > 2:
        at_work.page.click("#undo")
        at_work.steps(2)
    at_work.wrong.clear()
    at_work.page.reload()
    at_work.page.wait_for_selector("#candidates tbody tr")
    at_work.settled()
    return at_work
