"""The page in a real browser: what a person clicks is what the API does."""

import re
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

import pytest

import ambid
from ambid.excitation import prbs
from hidden.one_axis import ONE_AXIS
from places import SHARED
from workbench.person import Person, number

SEAL = SHARED / "cases" / "06-seal"
PERIODS = 3
"""Of its records, which makes the waiting shorter."""


@pytest.mark.slow
@pytest.mark.skipif(not SEAL.exists(), reason="the measured cases are not here")
def test_a_person_finds_the_seal_of_case_06(browser, workbench, tmp_path, capsys):
    times = {"begin": time.monotonic()}
    for name in ("train.mat", "validate.mat"):
        record = ambid.Record.load(SEAL / name)
        record.rows(0, PERIODS * record.period).save(tmp_path / name)
    files = (SEAL / "rig.toml", tmp_path / "train.mat", "--validate", tmp_path / "validate.mat")
    person = Person(browser, workbench(*files))
    page = person.page
    times["open"] = time.monotonic()
    page.click("#fit")
    person.steps(2)
    times["fit"] = time.monotonic()
    assert min(person.misfits()) > 100.0

    cells = page.locator(".map").first.locator("button")
    shown = {cells.nth(k).get_attribute("aria-label"): k for k in range(cells.count())}
    worst = max(shown, key=lambda label: number(label.rsplit(" ", 1)[1]))
    cells.nth(shown[worst]).click()
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

    answers = person.slide("seal_forces.damping")
    assert answers
    person.steps(4)
    times["slider"] = time.monotonic()
    assert person.misfits()[0] > 1.0

    assert "seal_forces" in person.take_away("#export-python", tmp_path / "done.py").read_text()
    model = ambid.Model.load(person.take_away("#export-model", tmp_path / "model.json"))
    assert [effect.name for effect in model.effects] == ["seal_forces"]
    page.click("#undo")
    person.steps(3)
    assert max(person.misfits()) < 1.1
    assert person.wrong == []
    seconds = list(times.items())
    with capsys.disabled():
        print("", *(f"{b}: {tb - ta:.1f} s" for (_, ta), (b, tb) in zip(seconds, seconds[1:], strict=False)))
        print(" slider answers in", *(f"{duration:.0f} ms" for duration in answers))


def test_two_windows_do_not_disturb_each_other(browser, address):
    one, other = Person(browser, address), Person(browser, address)
    one.page.click("#fit")
    one.steps(2)
    assert other.page.locator("#steps tbody tr").count() == 1
    one.page.reload()
    one.steps(2)  # a reload goes on where it was
    assert one.wrong == other.wrong == []


@pytest.mark.slow
def test_the_keyboard_alone_reaches_the_map_and_the_buttons(browser, address):
    person = Person(browser, address)
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
    counted = sum(map(int, re.findall(r"\d+", page.inner_text("#found"))))
    assert page.locator("#findings li").count() == counted > 0
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


def test_a_page_of_another_origin_gets_nothing(browser, address):
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
    assert found["samples"] > 900_000
    assert len(found["x"]) < 10_000
    answers = person.slide("tau_e")
    assert answers
    person.steps(2)
    assert person.wrong == []
    with capsys.disabled():
        print(f" whole record: {whole:.1f} s; slider answers in", *(f"{duration:.0f} ms" for duration in answers))
