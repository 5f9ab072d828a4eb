"""The command: what it prints, writes and returns, and the README's own examples."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.testing import assert_allclose
from scipy.stats import t

import ambid
from ambid.cli.identifying import MEND
from ambid.demo import DATA
from ambid.identification.estimate import STATUS
from parsed import read_by_the_command_line
from places import LEVITATOR, ROOT
from virtual import AXES, NAMES

LOADS = sorted(DATA.glob("static_*.csv"))
COMMANDS = (
    "check",
    "identify",
    "static-load",
    "campaign",
    "compare",
    "diagnose",
    "effects",
    "simulate",
    "monte-carlo",
    "frequency-response",
    "margins",
    "poles",
    "campbell",
    "export",
    "init",
    "rank",
    "workbench",
    "excitation",
    "design",
    "demo",
)
TAU_E = 2.9e-4
CHANNELS = {f"{signal}.{axis}" for signal in ("y", "i_c") for axis in AXES}


def read(path):
    """Strict JSON: no NaN, no infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(Path(path).read_text(), parse_constant=refuse)


def check_estimate(content, names, quantile=1.96):
    assert list(content["parameters"]) == list(names)
    for name, p in content["parameters"].items():
        assert set(p) >= {"value", "std_error", "ci95", "unit"}
        low, high = p["ci95"]
        assert low < p["value"] < high
        assert_allclose([p["value"] - low, high - p["value"]], quantile * p["std_error"], rtol=1e-2)
        assert p["unit"] == {"K_i": "N/A", "K_s": "N/m", "tau_e": "s"}[name.partition(".")[0]]


def recorded(folder, rig_file):
    """The folder with a virtual record of a machine, and its rig with another nominal tau_e."""
    rig = ambid.Rig.load(rig_file)
    i_e = ambid.prbs(8, amplitude=0.1, hold=2, axes=len(rig.axes), periods=5)
    ambid.Model(rig).with_values({"tau_e": TAU_E}).virtual_experiment(i_e, seed=2).save(folder / "run.csv")
    (folder / "rig.toml").write_text(rig.to_toml())
    return folder


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A record of the demo's bench."""
    return recorded(tmp_path_factory.mktemp("short"), DATA / "rig.toml")


@pytest.fixture(scope="module")
def one_axis(tmp_path_factory):
    """Rig file and record of a mass on one axis."""
    folder = recorded(tmp_path_factory.mktemp("one_axis"), LEVITATOR)
    return (folder / "rig.toml", folder / "run.csv")


@pytest.fixture
def here(short, tmp_path, monkeypatch):
    """An empty folder to write into, where the command runs."""
    monkeypatch.chdir(tmp_path)
    return (short / "rig.toml", short / "run.csv")


@pytest.fixture(scope="module")
def identified(short, tmp_path_factory, command_in):
    """A folder with the result and the model that `identify` wrote of a record, and how it ended."""
    folder = tmp_path_factory.mktemp("identified")
    files = ("--json", "i.json", "--save", "model.json")
    return folder, command_in(folder, "identify", short / "rig.toml", short / "run.csv", *files)


def test_identify_writes_all_that_is_asked_for(identified, monkeypatch):
    folder, result = identified
    monkeypatch.chdir(folder)
    assert (result.code, result.err) == (0, "")
    for text in (*NAMES, "written: model.json"):
        assert text in result.out
    content = read("i.json")
    assert [finding["code"] for finding in content["findings"]] == ["noise_arises"]
    check_estimate(content, NAMES)
    assert set(content["fit_percent"]) == set(content["noise_ceiling_percent"]) == {*CHANNELS, "average"}
    assert set(content["correlation"]) == set(content["correlation"]["tau_e"]) == set(NAMES)
    assert content["status"] == "converged"
    assert content["status_meaning"] == STATUS["converged"]
    assert content["evaluations"] > 1
    assert content["seconds"] > 0.0
    assert abs(content["parameters"]["tau_e"]["value"] - TAU_E) < 5 * content["parameters"]["tau_e"]["std_error"]
    assert ambid.Model.load("model.json").names == NAMES


def test_the_saved_model_serves_compare_and_identify(identified, here, command):
    folder, _ = identified
    model, fitted = folder / "model.json", read(folder / "i.json")
    result = command("compare", *here, "--model", model, "--json", "c.json")
    assert result.code == 0
    (record,) = read("c.json")["records"]
    assert_allclose(record["fit_percent"]["average"], fitted["fit_percent"]["average"], rtol=1e-6)
    assert {c["channel"] for c in record["channels"]} == CHANNELS
    nominal = command("compare", *here, "--json", "-", "--quiet")
    assert json.loads(nominal.out)["records"][0]["misfit"] > record["misfit"]
    again = command("identify", *here, "--model", model, "--json", "-", "--quiet")
    content = json.loads(again.out)
    assert content["evaluations"] <= fitted["evaluations"]
    assert_allclose(content["parameters"]["tau_e"]["value"], fitted["parameters"]["tau_e"]["value"], rtol=1e-5)


def test_a_virtual_experiment_is_identified(here, command):
    rig = here[0]
    made = command("simulate", rig, "--out", "v.mat", "--seconds", "0.5", "--seed", "4", "--json", "v.json")
    assert made.code == 0
    assert "periods" in made.out
    assert made.out.endswith("written: v.mat\n")
    summary = read("v.json")
    assert summary["record"] == "v.mat"
    assert summary["periods"] >= 5
    assert summary["seconds"] >= 0.5
    assert summary["period_samples"] * summary["periods"] == summary["samples"]
    assert command("identify", rig, "v.mat", "--quiet", "--json", "i.json").code == 0
    found = read("i.json")["parameters"]
    off = [abs(found[n]["value"] - p["value"]) / found[n]["std_error"] for n, p in summary["parameters"].items()]
    assert max(off) < 4.5


def test_the_seed_repeats_a_virtual_experiment(here, command):
    for name, seed in (("a.csv", 1), ("b.csv", 1), ("c.csv", 2)):
        arguments = ("--out", name, "--seconds", "0.1", "--seed", seed, "--amplitude", "0.2", "--quiet")
        assert command("simulate", here[0], *arguments).out == ""
    assert Path("a.csv").read_text() == Path("b.csv").read_text() != Path("c.csv").read_text()
    assert_allclose(np.abs(ambid.Record.load("a.csv").i_e), 0.2)


def test_choices_of_parameters(here, command):
    arguments = ("--free", "K_i,tau_e", "--fix", "K_i.B_eta=251", "--share", "K_i.A=K_i.A_zeta,K_i.A_eta")
    bounds = ("--bound", "tau_e=1e-4:1e-3", "--weight", "i_c=0.5", "--starts", "2", "--seed", "3")
    result = command("identify", *here, *arguments, *bounds, "--save", "m.json", "--json", "-", "--quiet")
    assert result.code == 0
    check_estimate(json.loads(result.out), ["K_i.A", "K_i.B_zeta", "tau_e"])
    assert (
        dict(zip(ambid.Model.load("m.json").names, ambid.Model.load("m.json").theta, strict=True))["K_i.B_eta"] == 251
    )
    result = command("identify", *here, "--per-axis", "tau_e", "--fix", "K_s", "--json", "-", "--quiet")
    check_estimate(json.loads(result.out), [*NAMES[:4], *(f"tau_e.{axis}" for axis in AXES)])


def test_static_load(here, command):
    result = command("static-load", here[0], *LOADS, "--json", "s.json")
    assert result.code == 0
    assert "K_i.A_zeta" in result.out
    content = read("s.json")
    check_estimate(content, NAMES[:4], t.ppf(0.975, len(LOADS) - 1))
    assert "residual_newton" in content


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_several_records_and_pictures(one_axis, command):
    rig, run = one_axis
    result = command("compare", rig, run, run, "--plot", "fit.png", "--json", "-", "--quiet")
    assert result.code == 0
    assert len(json.loads(result.out)["records"]) == 2
    assert sorted(p.name for p in Path().glob("*.png")) == ["fit_1.png", "fit_2.png"]
    assert imread("fit_1.png").shape[0] > 400
    assert command("identify", rig, run, "--plot", "fit.svg", "--quiet").code == 0
    assert "<svg" in Path("fit.svg").read_text()


def test_a_stated_period_is_used(here, command):
    """Two periods are a period too."""
    result = command("check", *here, "--period", 1020, "--json", "-", "--quiet")
    (record,) = json.loads(result.out)["records"]
    assert (record["period_samples"], record["periods"]) == (1020, 2)


def test_a_stated_period_that_is_none_is_refused(here, command):
    """What differs from one such period to the next would all be taken for noise, and any model for right."""
    result = command("identify", *here, "--period", 700)
    assert result.code == 2
    assert {"700", "510"} <= set(re.findall(r"\d+", result.err.partition("run.csv")[2]))


def test_quiet_prints_nothing(here, command):
    jobs = (("identify", *here), ("compare", *here), ("check", *here), ("static-load", here[0], *LOADS), ("effects",))
    for arguments in jobs:
        result = command(*arguments, "--quiet")
        assert (result.code, result.out, result.err) == (0, "", "")


@pytest.fixture(scope="module")
def foreign(short):
    """The same record under other names and in other units, and the options that say so."""
    record = ambid.Record.load(short / "run.csv")
    signals = np.hstack([1e3 * record.i_e, 1e6 * record.y, 1e3 * record.i_c])
    names = [f"ch{k}" for k in range(12)]
    np.savetxt(short / "scope.csv", signals, "%.12g", ",", header=",".join(names), comments="")
    channels = [f"{signal}.{axis}" for signal in ("i_e", "y", "i_c") for axis in AXES]
    maps = [f"{c}={name}:{1e-6 if c[0] == 'y' else 1e-3:g}" for c, name in zip(channels, names, strict=True)]
    return [short / "scope.csv", *(word for text in maps for word in ("--map", text)), "--sample-rate", 10000]


@pytest.mark.parametrize("job", ["check", "identify", "compare"])
def test_records_in_other_columns_and_units(here, foreign, command, job):
    ours = command(job, *here, "--json", "ours.json", "--quiet")
    theirs = command(job, here[0], *foreign, "--json", "theirs.json", "--quiet")
    assert (ours.code, theirs.code) == (0, 0), theirs.err
    if job == "check":
        (ours,), (theirs,) = (read(f)["records"] for f in ("ours.json", "theirs.json"))
        assert_allclose(theirs["y_rms"], ours["y_rms"], rtol=1e-6)
        assert "columns_mapped" in {finding["code"] for finding in read("theirs.json")["findings"]}
    elif job == "identify":
        ours, theirs = (read(f)["parameters"]["tau_e"]["value"] for f in ("ours.json", "theirs.json"))
        assert_allclose(theirs, ours, rtol=1e-4)
    else:
        (ours,), (theirs,) = (read(f)["records"] for f in ("ours.json", "theirs.json"))
        assert_allclose(theirs["misfit"], ours["misfit"], rtol=1e-4)


@pytest.fixture(scope="module")
def bench(short, tmp_path_factory):
    """A campaign at one bias current."""
    point = tmp_path_factory.mktemp("bench") / "6A"
    point.mkdir()
    shutil.copy(short / "rig.toml", point)
    for k in (1, 2):
        shutil.copy(short / "run.csv", point / f"prbs_{k}.csv")
    for path in LOADS:
        shutil.copy(path, point)
    return point.parent


def test_campaign(here, bench, command):
    result = command("campaign", bench, "--json", "c.json", "--plot", "K_i.png")
    assert (result.code, result.err) == (0, "")
    for text in ("K_s [N/m]", "RSD %", "tau_e [s]", "written: K_i.png"):
        assert text in result.out
    content = read("c.json")
    assert {(row["axis"], row["method"]) for row in content["K_i"]} == {
        (a, m) for a in AXES for m in ("prbs", "static")
    }
    assert imread("K_i.png").shape[0] > 300


@pytest.mark.slow
def test_a_campaign_replaces_its_own_tables_but_no_record(bench, short, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    again = ("campaign", bench, "--quiet", "--table", "c.csv")
    assert [(command(*again).code, Path("c_K_s.csv").is_file()) for _ in range(2)] == [(0, True)] * 2
    shutil.copy(short / "run.csv", "c_K_s.csv")
    assert command(*again).code == 2
    assert ambid.Record.load("c_K_s.csv").samples > 0


def test_exit_code_1_when_the_evaluations_run_out(here, command):
    result = command("identify", *here, "--max-evaluations", "1", "--json", "i.json")
    assert result.code == 1
    assert "max_evaluations" in result.out
    assert read("i.json")["status"] == "max_evaluations"
    quiet = command("identify", *here, "--max-evaluations", "1", "--quiet")
    assert (quiet.code, quiet.out) == (1, "")
    assert quiet.err == f"error: max_evaluations: {STATUS['max_evaluations']}\n"


def test_exit_code_1_when_the_loop_is_unstable(here, command):
    rig, run = here
    Path("slow.toml").write_text(rig.read_text().replace("time_constant = 0.0004", "time_constant = 0.02"))
    result = command("compare", "slow.toml", run)
    assert result.code == 1
    assert result.err.startswith("error: ")
    assert "slow.toml" in result.err
    assert result.out == ""


def test_exit_code_1_and_no_numbers_when_a_plane_was_not_excited(here, command):
    rig, run = here
    machine = ambid.Rig.load(rig)
    record = ambid.Record.load(run, machine)
    ambid.Model(machine).virtual_experiment(record.i_e * [1.0, 0.0, 0.0, 0.0], seed=1).save("one.csv")
    result = command("identify", rig, "one.csv", "--json", "i.json")
    assert result.code == 1
    content = read("i.json")
    assert content["status"] == "not_identifiable"
    assert content["parameters"]["K_i.B_eta"]["value"] is None
    assert content["parameters"]["K_i.A_zeta"]["value"] is not None
    assert content["not_identifiable"]
    shown = {own["where"]["axis"] for own in content["findings"] if own["code"] == "axis_not_excited"}
    assert shown == {"A_eta", "B_zeta", "B_eta"}


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        ((), [*COMMANDS, "f = K_i i + K_s s"]),
        (("identify",), ["--free", "--fix", "--share", "--per-axis", "--bound", "--weight", "--starts", "--save"]),
        (("static-load",), ["LOADS", "--json", "--quiet"]),
        (("check",), ["RECORD", "--map", "--sample-rate", "--json"]),
        (("campaign",), ["DIR", "--plot", "--json", "--quiet"]),
        (("compare",), ["--model", "--plot", "--period", "--map", "--json"]),
        (
            ("diagnose",),
            ["--validate", "--effects", "--ask", "--tolerance", "--model", "--save", "--report", "--pdf", "--map"],
        ),
        (("effects",), ["NAME", "--rig", "--json"]),
        (("simulate",), ["--out", "--seconds", "--amplitude", "--effect", "--model", "--seed", "--sensor-noise"]),
        (("demo",), ["--out", "--json"]),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) and value else "",
)
def test_help(arguments, texts, command):
    result = command(*arguments, "--help")
    assert result.code == 0
    for text in texts:
        assert text in result.out


def test_version(command):
    assert command("--version").out.strip() == f"ambid {ambid.__version__}"


def test_a_process_says_the_same(one_axis):
    main = "from ambid.cli import main; main()"
    program = [sys.executable, "-c", main, "compare", *one_axis, "--json", "-", "--quiet"]
    result = subprocess.run(program, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert json.loads(result.stdout)["records"][0]["record"] == "run"


def test_the_python_of_the_readme_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {})
    assert "tau_e" in capsys.readouterr().out


def lines_of_the_readme():
    """The words of each line of the section on the shell."""
    section = (ROOT / "README.md").read_text().partition("From the shell")[2]
    block = re.search(r"```sh\n(.*?)```", section, re.DOTALL)[1]
    return [line.partition("#")[0].split() for line in block.splitlines()]


def test_the_commands_of_the_readme_are_there():
    lines = lines_of_the_readme()
    assert {line[1] for line in lines} == {*COMMANDS} - {"demo", "workbench"}  # which serves until it is stopped
    for line in lines:
        read_by_the_command_line(line)


@pytest.mark.slow
def test_the_commands_of_the_readme_do_their_work(here, one_axis, bench, command, undrawn):
    """With their files put in their places; searches of one axis; the JSON of each has findings."""
    for line in lines_of_the_readme():
        rig, run = one_axis if line[1] in ("diagnose", "frequency-response", "design", "monte-carlo") else here
        files = {"rig.toml": [rig], "run.csv": [run], "static_*.csv": LOADS, "bench": [bench]}
        files |= {f"run_{k}.mat": [run] for k in (1, 2, 3)}
        files |= {f"{point}/rig.toml": [rig] for point in ("6A", "10A")}
        files |= {f"{point}/run.mat": [run] for point in ("6A", "10A")}
        files |= {"64": ["8"]}  # runs
        words = [value for word in line[1:] for value in files.get(word, [word])]
        words += ["--draws", "100"] if line[1] == "margins" else []
        result = command(*words, "--json", "result.json", "--quiet")
        assert result.code == 0, result.err
        for finding in read("result.json")["findings"]:
            assert set(finding) == {"code", "severity", "where", "values", "message", "remedy"}


def test_identify_begins_with_a_misfit_above_its_bound_and_ends_with_what_check_finds(command, tmp_path):
    """A card that reads y a sample late: no parameter can make up for it, and the record is reported as wrong."""
    rig = ambid.Rig.load(DATA / "rig.toml")
    record = ambid.Record.load(DATA / "prbs.mat", rig)
    late = tmp_path / "late.mat"
    signals = {"y": record.y[1:], "i_e": record.i_e[:-1], "i_c": record.i_c[:-1]}
    ambid.Record.from_arrays(**signals, sample_rate=rig.sample_rate, axes=rig.axes).save(late)
    said = command("identify", DATA / "rig.toml", late, "--json", tmp_path / "out.json").out.splitlines()
    found = read(tmp_path / "out.json")
    assert f"{found['misfit']:.2f}" in said[0]
    assert not found["adequate"]
    assert said[-1] == MEND
    (delay,) = [own for own in found["findings"] if own["code"] == "channel_delay"]
    assert (delay["severity"], delay["where"]["channel"]) == ("error", "y")
    assert delay["values"]["delay_samples"] == pytest.approx(1.0, abs=0.05)
    assert found["check"] == [line.removeprefix("check: ") for line in said if line.startswith("check: ")]
    assert any(line.startswith("error: ") and delay["message"] in line for line in found["check"])
