"""Who may speak to the server, and what each call answers."""

import time
from threading import Event

import numpy as np
import pytest

starlette = pytest.importorskip("starlette", reason="the workbench's server needs starlette")
pytest.importorskip("plotly", reason="the workbench's charts need plotly")

from starlette.testclient import TestClient  # noqa: E402

import ambid  # noqa: E402
from ambid.workbench.server import ASKED, ASSETS, DONE, SHOWN, application  # noqa: E402
from ambid.workbench.windows import Job, Windows  # noqa: E402

TOKEN, PORT = "the-token", 8123
HOST = f"127.0.0.1:{PORT}"


@pytest.fixture
def client(fitted):
    with TestClient(application(Windows(fitted), TOKEN, PORT), base_url=f"http://{HOST}") as client:
        yield client


@pytest.fixture
def window(client):
    return Caller(client)


class Caller:
    """A window of the page, by its calls."""

    def __init__(self, client):
        self.client = client
        self.at = f"/{TOKEN}/windows/{client.post(f'/{TOKEN}/windows', json={}).json()['window']}"

    def ask(self, call, **given):
        present = {"revision": self.ask("view").json()["revision"]} if call in SHOWN else {}
        return self.client.get(f"{self.at}/{call}", params=present | given)

    def post(self, call, **given):
        return self.client.post(f"{self.at}/{call}", json={"revision": self.ask("view").json()["revision"]} | given)

    def done(self):
        """The view when the job has ended."""
        for _ in range(6000):
            view = self.ask("view").json()
            if not view["job"]["running"]:
                return view
            time.sleep(0.05)
        raise AssertionError("the job does not end")


ALL = [("GET", call) for call in (*SHOWN, *ASKED)] + [("POST", call) for call in DONE]


@pytest.mark.parametrize(("method", "call"), [*ALL, ("GET", "")])
@pytest.mark.parametrize(
    ("headers", "token"),
    [
        ({}, "another-token"),
        ({}, ""),
        ({"host": "evil.example"}, TOKEN),
        ({"host": f"evil.example:{PORT}"}, TOKEN),
        ({"host": "127.0.0.1:1"}, TOKEN),
        ({"origin": "http://evil.example"}, TOKEN),
        ({"origin": "null"}, TOKEN),
        ({"origin": f"https://{HOST}"}, TOKEN),
        ({"sec-fetch-site": "cross-site"}, TOKEN),
        ({"sec-fetch-site": "same-site"}, TOKEN),
    ],
)
def test_others_are_refused_whatever_they_ask(client, window, method, call, headers, token):
    path = window.at.replace(TOKEN, token) + f"/{call}" if call else f"/{token}/"
    answer = client.request(method, path, headers=headers, json={"revision": 0} if method == "POST" else None)
    assert answer.status_code == 403
    assert answer.text.startswith("refused")
    assert "access-control-allow-origin" not in answer.headers
    assert window.ask("view").json()["revision"] == 0


def test_the_page_itself_may_speak(client):
    answer = client.get(f"/{TOKEN}/", headers={"origin": f"http://{HOST}", "sec-fetch-site": "same-origin"})
    assert answer.status_code == 200
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize("name", ["", *ASSETS, "plotly.min.js"])
def test_all_that_the_page_needs_is_served_here(client, name):
    answer = client.get(f"/{TOKEN}/{name}")
    assert answer.status_code == 200
    if name != "plotly.min.js":
        assert "http://" not in answer.text
        assert "https://" not in answer.text


@pytest.mark.parametrize("name", ["..%2f..%2ferrors.py", "../session.py", "session.py"])
def test_no_other_file_is_served(client, name):
    assert client.get(f"/{TOKEN}/{name}").status_code in (403, 404)


def test_a_form_of_another_page_is_no_call(client, window):
    answer = client.post(f"{window.at}/undo", content='{"revision": 0}', headers={"content-type": "text/plain"})
    assert answer.status_code == 400
    assert "application/json" in answer.json()["error"]


@pytest.mark.parametrize(
    ("call", "given"),
    [
        ("signals", {"record": 7, "channel": "y.M", "pixels": 500}),
        ("signals", {"record": 0, "channel": "y.none", "pixels": 500}),
        ("signals", {"record": 0, "channel": "y.none", "pixels": 1e9}),
        ("signals", {"record": 0, "channel": "y.none", "pixels": 500, "from": 2, "to": 1}),
        ("signals", {"record": 0, "channel": "y.none"}),
        ("lines", {"record": 0.5, "channel": "y.none", "pixels": 500}),
        ("responses", {"record": 0, "channel": "y.none", "pixels": 500}),
        ("predicted", {"record": 1, "channel": "y.A_zeta", "effect": "loop_delay"}),
        ("preview", {"name": "K_x", "value": 1}),
        ("preview", {"name": "tau_e", "value": "nan"}),
        ("preview", {"name": "tau_e", "value": "x"}),
        ("report.html", {}),
    ],
    ids=lambda own: own if isinstance(own, str) else " ".join(f"{key}={value}" for key, value in own.items()),
)
def test_wrong_questions_are_answered_by_what_is_wrong(window, call, given, golden):
    answer = window.ask(call, **given)
    assert answer.status_code == 400
    golden.holds(answer.json()["error"])


def test_a_candidate_that_is_none_is_named(window):
    answer = window.ask("predicted", record=0, channel="y.A_zeta", effect="seal_of_solomon")
    assert answer.status_code == 400
    assert "seal_of_solomon" in answer.json()["error"]


def test_what_it_shows_is_what_the_session_holds(window, fitted):
    view = window.ask("view").json()
    assert view["misfit"] == fitted.comparison.misfit
    assert view["validation_misfit"] == pytest.approx(fitted.validation_misfit)
    assert [own["name"] for own in view["parameters"]] == list(fitted.model.names)
    assert [own["role"] for own in view["records"]] == ["training", "validation"]
    rows = window.ask("candidates").json()["candidates"]
    assert [row["effect"] for row in rows] == [own.effect.name for own in fitted.ranking.candidates]
    maps = window.ask("where").json()["maps"]
    misfit = [[cell["misfit"] for cell in row] for row in maps[0]["cells"]]
    np.testing.assert_allclose(np.array(misfit, float).T, fitted.where.maps[0].misfit)


def test_signals_and_lines_are_those_of_the_comparison(window, fitted):
    channel = fitted.comparison.records[0].channels[0].channel
    one = fitted.comparison.records[0]
    t = one.record.t[:300]
    found = window.ask("signals", record=0, channel=channel, pixels=4000, **{"from": t[0], "to": t[-1] + 1e-9}).json()
    assert found["unit"] == "µm"
    np.testing.assert_allclose(found["x"], t)
    np.testing.assert_allclose(found["residual"], 1e6 * one.residual[:300, 0], rtol=1e-9)
    lines = window.ask("lines", record=0, channel=channel, pixels=4000).json()
    frequency_hz, misfit = fitted.comparison.noise.parts[0].by_channel(fitted.comparison.residual)
    assert max(lines["misfit"]) == misfit[:, 0].max()
    assert lines["frequency_hz"][lines["misfit"].index(max(lines["misfit"]))] == frequency_hz[misfit[:, 0].argmax()]


def test_a_preview_changes_nothing_and_a_move_does(window, fitted):
    name, value = fitted.model.names[0], 1.01 * fitted.model.theta[0]
    promised = window.ask("preview", name=name, value=value).json()
    assert promised["misfit"] > fitted.comparison.misfit
    assert window.ask("view").json()["misfit"] == fitted.comparison.misfit
    moved = window.post("move", name=name, value=value).json()
    assert moved["misfit"] == promised["misfit"]
    assert moved["steps"][-1]["did"].startswith(f"{name} = ")
    assert window.post("undo").json()["misfit"] == fitted.comparison.misfit


QUESTIONS = {
    "where": {},
    "candidates": {},
    "matrix": {},
    "lines": {"record": 0, "channel": "y.A_zeta", "pixels": 500},
    "signals": {"record": 0, "channel": "y.A_zeta", "pixels": 500},
    "responses": {"record": 0, "channel": "y.A_zeta", "pixels": 500},
    "predicted": {"record": 0, "channel": "y.A_zeta", "effect": "loop_delay"},
    "preview": {"name": "tau_e", "value": 1e-4},
}


@pytest.mark.parametrize("call", SHOWN)
def test_a_step_that_was_left_behind_is_not_answered_for_another(window, fitted, call):
    assert window.ask(call, **QUESTIONS[call]).status_code == 200
    window.post("move", name=fitted.model.names[0], value=1.01 * fitted.model.theta[0])
    answer = window.ask(call, revision=0, **QUESTIONS[call])
    assert (answer.status_code, answer.content) == (204, b"")


def test_an_unstable_loop_is_told_and_not_taken(window, fitted):
    answer = window.ask("preview", name=fitted.model.names[1], value=1e8)
    assert answer.status_code == 422
    assert "unstable" in answer.json()["error"]


def test_adding_fitting_and_removing_are_jobs(window, fitted, added):
    assert "loop_delay" in window.post("add", name="loop_delay").json()["job"]["what"]
    view = window.done()
    assert view["misfit"] == added.comparison.misfit
    assert view["adequate"]
    assert [own["name"] for own in view["effects"]] == ["loop_delay"]
    window.post("rank")
    assert window.done()["revision"] == 2
    assert "loop_delay" not in [row["effect"] for row in window.ask("candidates").json()["candidates"]]
    window.post("remove", name="loop_delay")
    assert window.done()["misfit"] == pytest.approx(fitted.comparison.misfit, rel=1e-4)


def test_a_job_that_fails_says_why_and_changes_nothing(window):
    window.post("add", name="no_effect")
    view = window.done()
    assert "no_effect" in view["job"]["error"]
    assert view["revision"] == 0


def test_a_cancelled_job_changes_nothing(window, fitted, monkeypatch, golden):
    def endless(session, tell):
        while True:
            tell("fitting", 1, 0)
            time.sleep(0.01)

    monkeypatch.setattr("ambid.workbench.session.Session.fit", endless)
    window.post("fit")
    assert window.ask("view").json()["job"]["running"]
    refused = window.post("undo")
    assert refused.status_code == 409
    golden.holds(refused.json()["error"])
    window.post("cancel")
    view = window.done()
    assert view["job"]["cancelled"]
    golden.holds(view["job"]["error"])
    assert view["misfit"] == fitted.comparison.misfit


def test_a_fit_can_be_cancelled_at_its_next_evaluation(fitted):
    found, shown, begun = [], [], Event()

    def call(tell):
        def heard(*now):
            shown.append(now)
            begun.wait(10)
            tell(*now)

        return fitted.fit(heard)

    job = Job("fit", call, found.append)
    job.cancel()
    begun.set()
    while job.is_running:
        time.sleep(0.005)
    assert len(shown) == 1
    assert found == []
    assert job.as_dict()["cancelled"]
    assert job.as_dict()["error"]


def test_two_windows_are_two_sessions(client, fitted):
    one, other = Caller(client), Caller(client)
    one.post("move", name=fitted.model.names[0], value=1.01 * fitted.model.theta[0])
    assert one.ask("view").json()["revision"] == 1
    assert other.ask("view").json()["misfit"] == fitted.comparison.misfit


def test_a_duplicated_window_that_is_behind_is_told(window, fitted, golden):
    move = {"name": fitted.model.names[0], "value": 1.01 * fitted.model.theta[0]}
    window.post("move", **move)
    answer = window.post("move", revision=0, **move)
    assert answer.status_code == 409
    golden.holds(answer.json()["error"])


def test_a_model_file_and_a_report_can_be_taken_away(window, fitted, tmp_path, monkeypatch):
    monkeypatch.setattr("ambid.workbench.windows.as_report", lambda session, tell: b"<h1>the report of this session")
    answer = window.ask("model.json")
    assert "attachment" in answer.headers["content-disposition"]
    (tmp_path / "model.json").write_bytes(answer.content)
    np.testing.assert_array_equal(ambid.Model.load(tmp_path / "model.json").theta, fitted.model.theta)
    window.post("report")
    assert window.done()["job"]["error"] == ""
    assert "<h1" in window.ask("report.html").text
