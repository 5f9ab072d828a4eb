"""The commands that judge a model: what they print, write, ask and refuse."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from io import StringIO
from pathlib import Path

import pytest
from matplotlib.image import imread
from rich.console import Console

import ambid
from ambid.cli import terminal
from ambid.cli.terminal import with_time_left
from ambid.demo import DATA
from ambid.effects import CATALOGUE, find
from ambid.errors import IdentificationError

CELL = {"record", "channel", "band_hz", "misfit", "kind"}


def test_check_of_a_sound_record(here, command):
    result = command("check", *here, "--json", "c.json")
    assert (result.code, result.err) == (0, "")
    content = json.loads(Path("c.json").read_text())
    assert content["is_sound"]
    assert content["findings"] == []
    assert f"{content['loop']['peak_sensitivity']:.2f}" in result.out
    assert [record["name"] for record in content["records"]] == ["run"]
    assert command("check", here[0]).code == 0


def test_check_of_a_record_with_a_wrong_sign(here, command):
    rig, run = here
    record = ambid.Record.load(run)
    ambid.Record("turned", record.sample_rate, record.axes, record.i_e, -record.y, record.i_c).save("turned.csv")
    result = command("check", rig, "turned.csv", "--json", "c.json")
    assert result.code == 2
    content = json.loads(Path("c.json").read_text())
    assert not content["is_sound"]
    (error,) = [found for found in content["findings"] if found["severity"] == "error"]
    assert (error["code"], error["where"]["record"], error["values"]["signals"]) == ("opposite_sign", "turned", ["y"])
    assert error["message"] in result.out
    quiet = command("check", rig, "turned.csv", "--quiet")
    assert (quiet.code, quiet.out) == (2, "")
    assert error["message"] in quiet.err


def test_compare_tells_where_the_misfit_is(here, command):
    result = command("compare", *here, "--json", "c.json")
    where = json.loads(Path("c.json").read_text())["where"]
    assert set(where[0]) == CELL
    (line,) = [line for line in result.out.splitlines() if f" {where[0]['misfit']:.1f} " in line]
    assert all(words in line for words in (where[0]["record"], where[0]["channel"], where[0]["kind"]))
    assert [cell["misfit"] for cell in where] == sorted((cell["misfit"] for cell in where), reverse=True)


def test_compare_says_nothing_of_where_while_the_noise_is_not_known(here, command):
    i_e = ambid.prbs(8, amplitude=0.1, hold=2, axes=1, periods=3)
    ambid.Model(ambid.Rig.load(here[0])).simulate(i_e).save("noiseless.mat")
    result = command("compare", here[0], "noiseless.mat", "--json", "c.json")
    assert result.code == 0, result.err
    assert "linear" not in result.out
    assert json.loads(Path("c.json").read_text())["where"] == []


def test_diagnose_writes_all_that_is_asked_for(diagnosed, monkeypatch):
    folder, result = diagnosed
    monkeypatch.chdir(folder)
    assert (result.code, result.err) == (0, "")
    for text in ("explained: loop_delay", "+ loop_delay", "written: d.png", "written: d.html"):
        assert text in result.out
    assert "loop_delay" in Path("d.html").read_text()
    assert imread("d.png").shape[0] > 300
    content = json.loads(Path("d.json").read_text())
    assert (content["verdict"], content["effects"]) == ("explained", ["loop_delay"])
    assert not content["stopped"]
    assert set(content["where"][0]) == CELL
    assert content["history"][-1]["validation_misfit"] == pytest.approx(1.0, abs=0.15)
    saved = ambid.Model.load("m.json")
    assert dict(zip(saved.names, saved.theta, strict=True))["loop_delay.delay"] == pytest.approx(5e-5, rel=0.1)


@pytest.mark.slow
def test_the_report_is_written_for_the_screen_and_for_paper(here, command, undrawn):
    """Without its pictures, which tests/report draws."""
    result = command("diagnose", *here, "--report", "d.html", "--pdf", "d.pdf")
    if "pip install 'ambid[pdf]'" in result.err:
        pytest.skip(result.err)
    assert result.code == 0, result.err
    assert "written: d.html\nwritten: d.pdf" in result.out
    assert Path("d.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize("between", [(), ("--validate",)], ids=["in a row", "one by one"])
def test_several_records_to_validate_on(here, command, monkeypatch, between):
    """They are not among those that are fitted."""
    given = {}

    def noted(model, records, *, validate, **_):
        given.update(fitted=[r.name for r in records], kept=[r.name for r in validate])
        raise IdentificationError("enough")

    monkeypatch.setattr(ambid, "diagnose", noted)
    rig, run = here
    other = run.with_name("other.csv")
    result = command("diagnose", rig, run, "--validate", other, *between, run, "--quiet")
    assert (result.code, result.err) == (1, "error: enough\n")
    assert given == {"fitted": ["run"], "kept": ["other", "run"]}


def test_diagnose_starts_from_a_model_with_effects(here, command):
    ambid.Model(ambid.Rig.load(here[0])).add("loop_delay").save("m.json")
    result = command("diagnose", *here, "--model", "m.json", "--json", "-", "--quiet")
    assert result.code == 0
    found = json.loads(result.out)
    assert found["history"][0]["effects"] == ["loop_delay"]
    assert 0.8 < found["history"][0]["misfit"] < found["misfit_bound"]


def test_a_person_chooses_the_effects(here, command):
    result = command("diagnose", *here, "--effects", "loop_delay, sensor_lag", "--json", "-", "--quiet")
    assert result.code == 0, result.err
    steps = [step["effects"] for step in json.loads(result.out)["history"]]
    assert steps == [[], ["loop_delay"], ["loop_delay", "sensor_lag"]]


def test_the_tolerance(here, command):
    result = command("diagnose", *here, "--tolerance", "1000", "--json", "-", "--quiet")
    assert json.loads(result.out)["history"][0]["misfit"] < 1000


def read_to_the_end(terminal):
    """What a program wrote on a terminal before it ended, when reading is an error."""
    seen = b""
    with suppress(OSError):
        while chunk := os.read(terminal, 4096):
            seen += chunk
    return seen.decode()


@pytest.fixture(scope="module")
def ranking(late):
    """Of the base model on the late loop."""
    return ambid.rank(ambid.identify(late / "rig.toml", [late / "run.csv"]).comparison)


@pytest.mark.parametrize(("answer", "choice"), [("y", True), ("n", False), ("2", None)])
def test_what_a_person_answers(ranking, monkeypatch, answer, choice):
    """The ranking and the question stand on the console; a number chooses another candidate."""
    seen = StringIO()
    monkeypatch.setattr(terminal, "status", Console(file=seen, width=200))
    monkeypatch.setattr(sys, "stdin", StringIO(f"nonsense\n{answer}\n"))
    first, second = ranking.candidates[:2]
    assert terminal.choose(ranking, first) == (second if choice is None else choice)
    assert f"1 {first.effect.name}, 2 {second.effect.name}" in seen.getvalue()


@pytest.mark.parametrize(
    ("answer", "effects"),
    [
        pytest.param("y", ["loop_delay"], marks=pytest.mark.slow),
        pytest.param("n", [], marks=pytest.mark.slow),
        ("2", None),  # the second of the ranking, whatever was proposed
    ],
)
def test_asking_at_a_terminal(here, answer, effects):
    """Ranking, questions and progress are on the terminal."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    main = "from ambid.cli import main; main()"
    program = [sys.executable, "-c", main, "diagnose", *here, "--ask", "--json", "d.json"]
    os.write(ours, f"{answer}\n".encode() * 3)
    with subprocess.Popen(program, stdin=theirs, stderr=theirs, stdout=subprocess.DEVNULL) as process:
        os.close(theirs)
        seen = read_to_the_end(ours)
    os.close(ours)
    assert process.returncode == 0, seen
    for words in ("effect ", "loop_delay. Add it?", "base model"):
        assert words in seen
    history = json.loads(Path("d.json").read_text())["history"]
    if effects is None:
        effects = [history[0]["candidates"][1]["effect"]]
        history = history[:2]
    assert history[-1]["effects"] == effects


@pytest.mark.parametrize(
    "words",
    [
        pytest.param("effects loop_", marks=pytest.mark.slow),
        "diagnose rig.toml a.csv --effects seal_forces,loop_",
    ],
)
def test_names_of_effects_are_completed(words, monkeypatch):
    environment = {
        "_AMBID_COMPLETE": "complete_bash",
        "COMP_WORDS": f"ambid {words}",
        "COMP_CWORD": str(len(words.split())),
    }
    main = "import sys; sys.argv[0] = 'ambid'; from ambid.cli import main; main()"
    ended = subprocess.run(
        [sys.executable, "-c", main], env=os.environ | environment, capture_output=True, text=True, check=False
    )
    assert ended.stdout.split() == [words.split()[-1].replace("loop_", "loop_delay")], ended.stderr


def test_time_left_is_told():
    said = []
    tell = with_time_left(said.append)
    tell("ranking", 0, 4)
    tell("ranking", 1, 4)
    assert said == ["ranking, 1 of 4", "ranking, 2 of 4"]


def test_the_catalogue(here, command):
    result = command("effects", "--json", "e.json")
    assert result.code == 0
    content = json.loads(Path("e.json").read_text())
    assert [entry["name"] for entry in content["effects"]] == [effect.name for effect in CATALOGUE]
    for entry in content["effects"]:
        # an error of a record is there or not; the coil is one whose voltage is commanded
        assert entry["parameters"] or find(entry["name"]).in_record or entry["name"] == "inductance_error"
        for key in ("name", "physics", "equation", "signature", "source"):
            assert entry[key]
            assert entry[key] in result.out
        for parameter in entry["parameters"]:
            assert parameter["meaning"]
            assert parameter["meaning"] in result.out


def test_one_effect_on_a_rig(here, command):
    result = command("effects", "loop_delay", "--rig", here[0], "--json", "e.json")
    (entry,) = json.loads(Path("e.json").read_text())["effects"]
    (delay,) = entry["parameters"]
    assert (delay["lower"], delay["upper"], delay["unit"]) == (5e-9, 2e-3, "s")
    assert f"{delay['lower']:g} .. {delay['upper']:g}" in result.out
    refused = command("effects", "unbalance", "--rig", here[0], "--json", "-")
    assert json.loads(refused.out)["effects"][0]["not_on_this_rig"]


@pytest.mark.usefixtures("here")
def test_effects_in_a_virtual_experiment(command):
    rig = DATA / "rig.toml"
    options = ("--seconds", "0.26", "--effect", "loop_delay:delay=1e-5", "--effect", "seal_forces:z=0.43,damping=400")
    result = command("simulate", rig, "--out", "v.csv", *options, "--json", "v.json", "--quiet")
    assert result.code == 0
    content = json.loads(Path("v.json").read_text())
    assert content["effects"] == ["loop_delay", "seal_forces"]
    assert content["parameters"]["seal_forces.damping"] == {"value": 400.0, "unit": "N s/m"}
    ambid.Model(ambid.Rig.load(rig)).add("loop_delay", {"delay": 1e-5}).save("m.json")
    again = ("--model", "m.json", "--effect", "seal_forces:z=0.43,damping=400", "--seconds", "0.26", "--quiet")
    assert command("simulate", rig, "--out", "w.csv", *again).code == 0
    assert Path("v.csv").read_text() == Path("w.csv").read_text()


REFUSED = {
    "map, no equals sign": ("check", "--map", "y.A_zeta"),
    "map, unknown channel": ("compare", "--map", "z.A_zeta=1"),
    "map, no y": ("identify", "--map", "t=1"),
    "map, unknown column": ("diagnose", "--map", "y.A_zeta=ch99"),
    "sample rate, zero": ("check", "--sample-rate", "0"),
    "sample rate, contradicts": ("compare", "--sample-rate", "5000"),
    "effects, unknown": ("diagnose", "--effects", "loop_delya"),
    "effects, twice": ("diagnose", "--effects", "sensor_lag,sensor_lag"),
    "tolerance, below noise": ("diagnose", "--tolerance", "0.5"),
    "tolerance, not a number": ("diagnose", "--tolerance", "nan"),
    "ask, no terminal": ("diagnose", "--ask"),
    "ask, quietly": ("diagnose", "--ask", "--quiet"),
    "ask, with a choice": ("diagnose", "--effects", "loop_delay", "--ask"),
    "validate, no such file": ("diagnose", "--validate", "none.csv"),
    "save, no such folder": ("diagnose", "--save", "nowhere/m.json"),
    "report, not HTML": ("diagnose", "--report", "d.pdf"),
    "pdf, not PDF": ("diagnose", "--pdf", "d.html"),
}
REFUSED_ALONE = {
    "campaign, no such folder": ("campaign", "nowhere"),
    "campaign, empty": ("campaign", "."),
    "campaign, plot": ("campaign", ".", "--plot", "K_i.xyz"),
    "effects, unknown name": ("effects", "loop_delya"),
    "effects, no such rig": ("effects", "--rig", "none.toml"),
    "check, no such rig": ("check", "none.toml"),
}
SIMULATED = {
    "effect, unknown": "loop_delya",
    "effect, out of range": "loop_delay:delay=1",
    "effect, not on this rig": "unbalance",
}


@pytest.mark.parametrize("case", REFUSED)
def test_options_that_are_refused(here, command, case, refused):
    job, *options = REFUSED[case]
    named = {"map, no y": "y.<axis>", "effects, twice": "sensor_lag"}.get(case, options[-1])
    refused(command(job, *here, *options), named)


def test_what_follows_validate_is_not_fitted(here, command):
    result = command("diagnose", here[0], "--validate", here[1])
    assert (result.code, result.out) == (2, "")
    assert "RECORD" in result.err


@pytest.mark.parametrize("case", REFUSED_ALONE)
def test_arguments_that_are_refused(here, command, case, refused):
    refused(command(*REFUSED_ALONE[case]), REFUSED_ALONE[case][-1])


@pytest.mark.parametrize("case", SIMULATED)
def test_effects_that_are_refused(here, command, case, refused):
    effect = SIMULATED[case]
    refused(command("simulate", here[0], "--out", "v.csv", "--effect", effect), effect)


def test_rank_is_the_ranking_of_the_fitted_model(here, command, tmp_path):
    rig, run = here
    result = command("rank", rig, run, "--json", tmp_path / "rank.json", "--plot", tmp_path / "rank.png")
    assert result.code == 0, result.err
    shown = json.loads((tmp_path / "rank.json").read_text())
    machine = ambid.Rig.load(rig)
    record = ambid.Record.load(run, machine)
    expected = ambid.rank(ambid.identify(machine, record).comparison)
    assert [row["effect"] for row in shown["candidates"]] == [c.effect.name for c in expected.candidates]
    assert shown["not_tried"] == expected.not_tried
    assert shown["candidates"][0]["effect"] in result.out
    assert (tmp_path / "rank.png").stat().st_size > 1000
