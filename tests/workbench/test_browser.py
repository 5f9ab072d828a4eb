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
SLIDER = 100.0
"""Milliseconds in which a slider of a linear bench answers."""
RESPONSIVE = 10.0
"""Seconds in which a window of a record of 1e6 samples is drawn, on such a machine."""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="the browser tests need chromium")


@pytest.fixture(scope="module")
def browser():
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


class Person:
    """Who clicks, and what the page shows; anything that the page asks of another host is noted."""

    def __init__(self, browser, address):
        self.context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
        self.page = self.context.new_page()
        self.page.set_default_timeout(LONGEST)
        self.wrong: list[str] = []
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda line: self.wrong.append(line.text) if line.type == "error" else None)
        self.page.on("response", lambda own: self.wrong.append(f"{own.status} {own.url}") if not own.ok else None)
        self.page.on("request", lambda request: self._see(request.url, address))
        self.page.goto(address)
        self.settled()

    def _see(self, url, address):
        if not url.startswith((address.rsplit("/", 2)[0], "blob:", "data:")):
            self.wrong.append(f"asked for {url}")

    def settled(self):
        """Wait until all charts and the map are those of the present step."""
        for chart in ("overlay", "responses", "lines"):
            self.page.wait_for_selector(f"#training-{chart} .plot-container")
        self.page.wait_for_selector("#job", state="hidden")
        self.page.wait_for_selector(".stale", state="detached")

    def steps(self, count):
        self.page.wait_for_selector(f"#steps tbody tr:nth-child({count})")
        self.page.wait_for_selector(f"#steps tbody tr:nth-child({count + 1})", state="detached")
        self.settled()

    def slide(self, parameter):
        """Move a slider by keys and let it go; milliseconds of its answers."""
        self.page.focus(f"input[type=range][aria-label='{parameter}']")
        for _ in range(6):
            self.page.keyboard.press("ArrowRight")
            self.page.wait_for_timeout(150)  # it is not let go yet
        return self.page.evaluate(
            """performance.getEntriesByType("resource").filter((own) => own.name.includes("/preview"))
                .map((own) => own.duration)"""
        )

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
    page.locator("tr[data-effect=sensor_position_error] summary").focus()
    told = "name => document.getElementById('foreseen-told').textContent.startsWith(name)"
    page.wait_for_function(told, arg="sensor_position_error")
    times["point at a candidate"] = time.monotonic()
    page.locator(".matrix button[data-channel='y.A_zeta'][data-input='i_e.A_eta']").first.click()
    assert page.locator(".matrix button[aria-pressed='true']").first.inner_text().startswith("−")
    person.settled()
    assert page.inner_text("#training-responses-title").endswith("y.A_zeta by i_e.A_eta")
    times["cell of the matrix"] = time.monotonic()
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

    answers = person.slide("seal_forces.damping")
    assert min(answers) < SLIDER
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
        print(" slider answers in", *(f"{duration:.0f} ms" for duration in answers))


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The mass on one axis with its own delay, as files."""
    from hidden.one_axis import record

    folder = tmp_path_factory.mktemp("small")
    record({"loop_delay": {"seconds": 5e-5}}, seed=1).save(folder / "train.mat")
    return ONE_AXIS.rig.path, folder / "train.mat"


@pytest.fixture(scope="module")
def served(workbench, small):
    """Where the same is served with a record to validate on."""
    from hidden.one_axis import record

    rig, train = small
    record({"loop_delay": {"seconds": 5e-5}}, seed=2, share=0.5).save(train.with_name("kept.mat"))
    return workbench(rig, train, "--validate", train.with_name("kept.mat"))


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


CHARTS = ("training-responses", "validation-responses", "training-lines", "validation-lines")
"""Over frequency."""


@pytest.fixture
def ranked(browser, served):
    """A person whose model is fitted and its candidates ranked."""
    person = Person(browser, served)
    person.page.click("#fit")
    person.steps(2)
    person.page.click("#rank")
    person.page.wait_for_selector("#candidates tbody tr")
    person.settled()
    return person


def test_a_cell_of_the_matrix_chooses_channel_excitation_and_band_everywhere(ranked):
    page = ranked.page
    cell = page.locator(".matrix button[data-channel='i_c.A_zeta'][data-input='i_e.A_zeta']").nth(1)
    low, high = (float(cell.get_attribute(f"data-{end}")) for end in ("low", "high"))
    cell.click()
    ranked.settled()
    assert (page.input_value("#channel"), page.input_value("#input")) == ("i_c.A_zeta", "i_e.A_zeta")
    assert cell.get_attribute("aria-pressed") == "true"
    assert page.locator(".map button[data-channel='i_c.A_zeta'][aria-pressed='true']").count() > 0
    for chart in CHARTS:
        assert "i_c.A_zeta" in page.inner_text(f"#{chart}-title")
        assert page.evaluate(BAND, chart) == [low, high]
    page.locator(".map button[data-channel='y.A_zeta']").nth(3).click()
    ranked.settled()
    assert page.input_value("#input") == "i_e.A_zeta"  # a cell of the map has none of its own
    assert page.evaluate(BAND, CHARTS[0]) != [low, high]
    assert page.inner_text("#training-responses-title").endswith("y.A_zeta by i_e.A_zeta")
    assert ranked.wrong == []


BAND = """(id) => document.getElementById(id).layout.shapes.filter((own) => own.type === "rect")
    .map((own) => [own.x0, own.x1])[0]"""


def test_one_cursor_stands_at_the_same_frequency_in_all_charts(ranked):
    page = ranked.page
    page.focus("#cursor")
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    told = page.get_attribute("#cursor", "aria-valuetext")
    assert told == page.inner_text("#read-out")
    assert [line.partition(",")[0] for line in told.splitlines()] == ["training", "validation"]
    at = page.evaluate(CURSORS, CHARTS)
    assert page.locator(".cursor:visible").count() == len(CHARTS)
    assert max(at) == pytest.approx(min(at), rel=1e-3)
    assert at[0] == pytest.approx(_number(re.search(r"([\d.]+) Hz", told)[1]), rel=1e-3)
    page.locator("#validation-lines .nsewdrag").hover()
    page.wait_for_function("told => document.getElementById('read-out').textContent !== told", arg=told)
    moved = page.evaluate(CURSORS, CHARTS)
    assert max(moved) == pytest.approx(min(moved), rel=1e-3)
    assert moved[0] != pytest.approx(at[0], rel=1e-2)
    assert ranked.wrong == []


CURSORS = """(ids) => ids.map((id) => {
    const chart = document.getElementById(id), axis = chart._fullLayout.xaxis;
    return axis.p2d(parseFloat(chart.querySelector(".cursor").style.left) - axis._offset);
})"""


def test_a_cursor_in_time_tells_the_values_of_its_record(ranked):
    page = ranked.page
    page.focus("#training-cursor")
    for _ in range(7):
        page.keyboard.press("ArrowRight")
    told = page.get_attribute("#training-cursor", "aria-valuetext")
    assert told == page.inner_text("#training-read-out")
    x, *shown = page.evaluate("""() => {
        const drawn = document.getElementById("training-overlay").data;
        const at = (name) => drawn.find((own) => own.name === name);
        return [at("measured").x, at("measured").y, at("simulated").y, at("residual").y].map((all) => all[7]);
    }""")
    numbers = [float(own) for own in re.findall(r"-?[\d.]+(?:e[-+]\d+)?(?= )", told)]
    assert numbers == pytest.approx([x, *shown], rel=5e-3)
    assert page.evaluate(CURSORS, ["training-overlay"])[0] == pytest.approx(x, rel=1e-3)
    assert not page.locator("#validation-overlay .cursor").is_visible()
    page.locator("#validation-overlay .nsewdrag").first.hover()
    page.wait_for_function("document.getElementById('validation-read-out').textContent !== ''")
    assert ranked.wrong == []


def test_pointing_at_a_candidate_shows_what_it_would_leave(ranked):
    page = ranked.page
    rows = page.locator("tr[data-effect]")
    first, second = (rows.nth(k).get_attribute("data-effect") for k in range(2))
    title = "name => document.getElementById('foreseen-title').textContent.includes(name)"
    page.wait_for_function(title, arg=first)  # the best stands there before anybody points
    rows.nth(1).hover()
    page.wait_for_function(title, arg=second)
    rows.nth(0).locator("summary").focus()
    page.wait_for_function(title, arg=first)
    assert page.inner_text("#foreseen-told").startswith(f"{first}: misfit")
    now, then = page.evaluate("document.getElementById('foreseen-chart').data.map((own) => [...own.y])")
    assert len(now) == len(then)
    assert sum(then) < sum(now)
    assert page.locator("#steps tbody tr").count() == 2  # nothing was done
    assert ranked.wrong == []


def test_before_and_after_an_effect_differ_without_colour(ranked):
    page = ranked.page
    page.click("button[aria-label='add loop_delay']")
    ranked.steps(3)
    drawn = page.evaluate(
        """() => document.getElementById("training-responses").data.filter((own) => own.showlegend !== false)
            .map((own) => [own.name, `${own.mode} ${own.line?.dash} ${own.marker?.symbol} ${own.fill}`])"""
    )
    names, looks = zip(*drawn, strict=True)
    assert {"measured", "now (+ loop_delay)", "before (fit)"} <= set(names)
    assert len(set(looks)) == len(looks)
    for cell in page.locator(".map button").all():
        assert cell.inner_text()  # its number says what its darkness says
    assert ranked.wrong == []


def test_a_question_that_a_step_overtakes_is_dropped(ranked):
    page = ranked.page
    held = []
    page.route("**/predicted?*", lambda route: held.append(route), times=1)
    page.locator("tr[data-effect]").nth(1).hover()
    page.wait_for_selector("#foreseen.stale")
    page.click("button[aria-label='add loop_delay']")
    page.wait_for_selector("#steps tbody tr:nth-child(3)")
    with page.expect_response("**/predicted?*") as late:
        held[0].continue_()
    assert late.value.status == 204
    ranked.steps(3)
    assert ranked.wrong == []


def test_tab_reaches_every_part_of_the_page(ranked):
    page = ranked.page
    page.evaluate("document.activeElement.blur()")
    reached, parts = set(), "own => own?.closest('[id]:not(button):not(select)')?.id ?? ''"
    for _ in range(150):
        page.keyboard.press("Tab")
        reached.add(page.evaluate(f"({parts})(document.activeElement)"))
    expected = {"maps", "matrices", "candidates", "cursor", "parameters", "overlays"}
    assert expected <= reached, reached
    nameless = page.locator("button:visible, input:visible, select:visible, summary:visible").evaluate_all(
        "all => all.filter((own) => !(own.ariaLabel || own.labels?.length || own.textContent.trim())).length"
    )
    assert nameless == 0
    assert ranked.wrong == []


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
def test_a_record_of_a_million_samples_stays_responsive(browser, workbench, tmp_path, capsys):
    model = ambid.Model(ONE_AXIS.rig)
    i_e = prbs(11, amplitude=1.0, hold=4, axes=1, periods=125)[:1_000_000]
    model.virtual_experiment(i_e, seed=1).save(tmp_path / "long.mat")
    person = Person(browser, workbench(ONE_AXIS.rig.path, tmp_path / "long.mat"))
    page = person.page
    begun = time.monotonic()
    with page.expect_response(lambda response: "/signals" in response.url) as answered:
        page.click("text=Whole record")
    found = answered.value.json()
    whole = time.monotonic() - begun
    assert whole < RESPONSIVE
    assert found["samples"] > 900_000
    assert len(found["x"]) < 10_000
    answers = person.slide("tau_e")
    assert min(answers) < SLIDER
    person.steps(2)
    assert person.wrong == []
    with capsys.disabled():
        print(f" whole record: {whole:.1f} s; slider answers in", *(f"{duration:.0f} ms" for duration in answers))


def _number(text):
    return float(text.removesuffix("k")) * (1e3 if text.endswith("k") else 1.0) if text[0].isdigit() else 0.0
