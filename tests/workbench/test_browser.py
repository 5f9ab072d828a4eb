"""The page in a real browser: what a person clicks is what the API does."""

import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

import pytest

import ambid
from ambid.excitation import prbs
from hidden.one_axis import ONE_AXIS
from places import SHARED

playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need the package playwright")
pytest.importorskip("plotly", reason="the workbench's charts need plotly")
pytest.importorskip("uvicorn", reason="the workbench's server needs uvicorn")

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
SEAL = SHARED / "cases" / "06-seal"
LONGEST = 90_000
"""Milliseconds that anything on the page may take on a machine that is busy with other tests."""
RESPONSIVE = 10.0
"""Seconds in which a window of a record of 1e6 samples is drawn, on such a machine."""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="the browser tests need chromium")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
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
        assert process.wait(20) == 130


class Person:
    """Who clicks, and what the page shows; anything that the page asks of another host is noted."""

    def __init__(self, browser, address):
        self.context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
        self.page = self.context.new_page()
        self.page.set_default_timeout(LONGEST)
        self.wrong: list[str] = []
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda line: self.wrong.append(line.text) if line.type == "error" else None)
        self.page.on("request", lambda request: self._see(request.url, address))
        self.page.goto(address)
        self.settled()

    def _see(self, url, address):
        if not url.startswith((address.rsplit("/", 2)[0], "blob:", "data:")):
            self.wrong.append(f"asked for {url}")

    def settled(self):
        """Wait until all charts and the map are those of the present step."""
        self.page.wait_for_selector("#training-lines .plot-container")
        self.page.wait_for_selector("#job", state="hidden")
        self.page.wait_for_selector(".stale", state="detached")

    def steps(self, count):
        self.page.wait_for_selector(f"#steps tbody tr:nth-child({count})")
        self.page.wait_for_selector(f"#steps tbody tr:nth-child({count + 1})", state="detached")
        self.settled()

    def misfits(self):
        return [float(re.match(r"[\d.e+]+", self.page.inner_text(at))[0]) for at in ("#misfit", "#validation")]

    def take_away(self, button, path):
        with self.page.expect_download() as download:
            self.page.click(button)
        download.value.save_as(path)
        return path


@pytest.mark.slow
@pytest.mark.skipif(not SEAL.exists(), reason="the measured cases are not here")
def test_a_person_finds_the_seal_of_case_06(browser, workbench, tmp_path, capsys):
    times = {"begin": time.monotonic()}
    files = (SEAL / "rig.toml", SEAL / "train.mat", "--validate", SEAL / "validate.mat")
    person = Person(browser, workbench(*files))
    page = person.page
    times["open"] = time.monotonic()
    page.click("#fit")
    person.steps(2)
    times["fit"] = time.monotonic()
    base = person.misfits()
    assert min(base) > 200.0

    cells = page.locator(".map").first.locator("button")
    told = {cells.nth(k).get_attribute("aria-label"): k for k in range(cells.count())}
    worst = max(told, key=lambda label: _number(label.rsplit(" ", 1)[1]))
    cells.nth(told[worst]).click()
    channel = worst.split(",")[0]
    assert page.input_value("#channel") == channel
    page.wait_for_function(
        "([id, text]) => document.getElementById(id).textContent.includes(text)", arg=["training-title", channel]
    )
    assert page.inner_text("#band") != "all"
    times["cell"] = time.monotonic()

    page.click("#rank")
    page.wait_for_selector("#candidates tbody tr")
    assert page.locator("#candidates tbody summary").first.inner_text() == "seal_forces"
    times["rank"] = time.monotonic()
    page.click("button[aria-label='add seal_forces']")
    person.steps(3)
    times["add"] = time.monotonic()
    assert max(person.misfits()) < 1.1

    page.click("#undo")
    person.steps(2)
    assert person.misfits() == base
    times["undo"] = time.monotonic()
    page.click("button[aria-label='add seal_forces']")
    person.steps(3)

    slider = page.locator("input[type=range][aria-label='seal_forces.damping']")
    slider.focus()
    page.keyboard.press("ArrowRight")
    person.steps(4)
    times["slider"] = time.monotonic()
    assert person.misfits()[0] > 1.0

    script = person.take_away("#export-python", tmp_path / "done.py")
    runpy.run_path(str(script))
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    last = [float(printed[-1][k]) for k in (-3, -1)]
    assert [float(f"{value:.4g}") for value in last] == pytest.approx(person.misfits(), rel=1e-3)
    assert len(printed) == 4

    model = ambid.Model.load(person.take_away("#export-model", tmp_path / "model.json"))
    assert [effect.name for effect in model.effects] == ["seal_forces"]
    report = person.take_away("#export-report", tmp_path / "report.html").read_text()
    assert "seal forces" in report
    times["report"] = time.monotonic()
    assert person.wrong == []
    seconds = list(times.items())
    with capsys.disabled():
        print("", *(f"{b}: {tb - ta:.1f} s" for (_, ta), (b, tb) in zip(seconds, seconds[1:], strict=False)))


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The mass on one axis with its own delay, as files."""
    from hidden.one_axis import record

    folder = tmp_path_factory.mktemp("small")
    record({"loop_delay": {"seconds": 5e-5}}, seed=1).save(folder / "train.mat")
    return ONE_AXIS.rig.path, folder / "train.mat"


def test_two_windows_do_not_disturb_each_other(browser, workbench, small):
    address = workbench(*small)
    one, other = Person(browser, address), Person(browser, address)
    one.page.click("#fit")
    one.steps(2)
    assert other.page.locator("#steps tbody tr").count() == 1
    one.page.reload()
    one.steps(2)  # a reload goes on where it was
    assert one.wrong == other.wrong == []


def test_the_keyboard_alone_reaches_the_map_and_the_buttons(browser, workbench, small):
    person = Person(browser, workbench(*small))
    page = person.page
    page.locator(".map button[tabindex='0']").first.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    pressed = page.locator(".map button[aria-pressed='true']").first
    assert (pressed.get_attribute("data-row"), pressed.get_attribute("data-column")) == ("1", "1")
    page.focus("#fit")
    page.keyboard.press("Enter")
    person.steps(2)
    named = "all => all.filter((own) => !(own.ariaLabel || own.labels?.length || own.textContent.trim()))"
    assert page.locator("button:visible, input:visible, select:visible").count() > 20
    assert (
        page.locator("input, select, #fit, #rank, #undo, progress").evaluate_all(f"{named}.map((own) => own.id)") == []
    )
    assert person.wrong == []


class _Elsewhere(BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(b"<p>another page</p>")

    def log_message(self, *_):
        pass


def test_a_page_of_another_origin_gets_nothing(browser, workbench, small):
    address = workbench(*small)
    elsewhere = HTTPServer(("127.0.0.1", 0), _Elsewhere)
    Thread(target=elsewhere.serve_forever, daemon=True).start()
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{elsewhere.server_port}/")
    asked = """async ([url, method]) => {
        try { return await (await fetch(url, {method, body: method === "POST" ? "{}" : undefined})).text(); }
        catch (error) { return "nothing"; }
    }"""
    for path, method in (("", "GET"), ("windows", "POST"), ("plotly.min.js", "GET")):
        assert page.evaluate(asked, [address + path, method]) == "nothing"  # though it knows the token
    page.evaluate(
        """(url) => new Promise((done) => {
            const frame = document.createElement("iframe");
            frame.onload = done;
            frame.src = url;
            document.body.append(frame);
        })""",
        address,
    )
    assert page.frames[-1].locator("#rig").count() == 0
    elsewhere.shutdown()


@pytest.mark.slow
def test_a_record_of_a_million_samples_stays_responsive(browser, workbench, tmp_path):
    model = ambid.Model(ONE_AXIS.rig)
    i_e = prbs(11, amplitude=1.0, hold=4, axes=1, periods=125)[:1_000_000]
    model.virtual_experiment(i_e, seed=1).save(tmp_path / "long.mat")
    person = Person(browser, workbench(ONE_AXIS.rig.path, tmp_path / "long.mat"))
    page = person.page
    begun = time.monotonic()
    with page.expect_response(lambda response: "/signals" in response.url) as answered:
        page.click("text=Whole record")
    found = answered.value.json()
    assert time.monotonic() - begun < RESPONSIVE
    assert found["samples"] > 900_000
    assert len(found["x"]) < 10_000
    assert person.wrong == []


def _number(text):
    return float(text.removesuffix("k")) * (1e3 if text.endswith("k") else 1.0) if text[0].isdigit() else 0.0
