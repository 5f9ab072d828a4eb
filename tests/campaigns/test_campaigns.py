"""A campaign over bias currents: what is found, how it is laid out, drawn and printed, and what is refused."""

import csv
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

import ambid
from ambid.campaigns import campaign
from ambid.campaigns.folder import EMPTY, OUTSIDE
from ambid.campaigns.procedure import STOPPED
from ambid.campaigns.result import BEGIN_ANEW, DIAGNOSE_KIND, NO_LOADINGS, VALIDATE_MODELS
from ambid.errors import InputError, RecordError, RigError, Stopped, UnstableLoopError
from ambid.excitation import prbs
from ambid.findings import has
from ambid.plot import plot_campaign, save_campaign
from ambid.rig import Rig
from places import BENCH, SHARED
from reference.static_loads import CROSS, reactions
from validated import relative

K_I = {"6A": [217.0, 225.0, 278.0, 285.0], "10A": [316.0, 327.0, 358.0, 367.0]}
K_S = {"6A": [2.39e6, 2.47e6, 3.13e6, 3.21e6], "10A": [5.69e6, 5.89e6, 6.49e6, 6.65e6]}
TAU_E = 2.5e-4
AMPLITUDES = {"prbs_small": 0.1, "prbs_large": 0.4}


def write_static(path, rig, k_i, seed):
    z = np.full(len(CROSS), 0.43)
    noise = 0.005 * np.random.default_rng(seed).standard_normal((len(CROSS), 4))
    table = np.column_stack([np.arange(len(z)), z, CROSS, reactions(rig, CROSS, z) / k_i + noise])
    names = ["step", "z", "F_x", "F_y", *(f"i_c.{axis}" for axis in rig.axes)]
    np.savetxt(path, table, "%.9g", ",", header=",".join(names), comments="")


@pytest.fixture(scope="session")
def template(request, tmp_path_factory):
    """Two bias currents; two runs of each amplitude, two static loadings, with other files beside them."""
    folder = tmp_path_factory.mktemp("campaign")
    rig = Rig.load(BENCH)
    i_e = prbs(8, amplitude=1.0, hold=3, axes=4, periods=4)
    for name, k_i in K_I.items():
        point = folder / name
        point.mkdir()
        here = rig.replace(bearings=[b.model_copy(update={"bias_current": float(name[:-1])}) for b in rig.bearings])
        (point / "rig.toml").write_text(here.to_toml())
        (point / "photo.png").touch()
        values = {f"K_i.{axis}": k for axis, k in zip(rig.axes, k_i, strict=True)}
        values |= {f"K_s.{axis}": k for axis, k in zip(rig.axes, K_S[name], strict=True)}
        truth = ambid.Model(here).with_values(values | {"tau_e": TAU_E})
        for number in (1, 2):
            for kind, amplitude in AMPLITUDES.items():
                record = truth.virtual_experiment(amplitude * i_e, seed=number)
                record.save(point / f"{kind}_{number}.mat")
            write_static(point / f"static_{number}.csv", here, k_i, number)
    (folder / "README.md").touch()
    (folder / "plots").mkdir()
    return folder


@pytest.fixture(scope="session")
def found(template):
    return campaign(template)


@pytest.fixture
def broken(template, tmp_path):
    """A copy to break."""
    return shutil.copytree(template, tmp_path / "campaign")


def test_values_at_every_bias_current(found, validated):
    assert [point.folder.name for point in found.points] == ["6A", "10A"]
    assert found.methods == ("prbs_large", "prbs_small", "static")
    for point in found.points:
        true_k_i = dict(zip(found.axes, K_I[point.folder.name], strict=True))
        true_k_s = dict(zip(found.axes, K_S[point.folder.name], strict=True))
        for axis in found.axes:
            for method in found.methods:
                k_i = point.force_current(method, axis)
                validated(
                    "K_i of a campaign by closed-loop identification and static loading: error in standard errors",
                    "truth of virtual experiments, reactions of the bearings by hand",
                    (k_i.value - true_k_i[axis]) / k_i.std_error,
                    5.0,
                )
            for runs in point.runs:
                found_k_s, found_tau_e = runs.mean(f"K_s.{axis}"), runs.joint.parameters["tau_e"].value
                validated(
                    "K_s and tau_e of a campaign: relative error",
                    "truth of virtual experiments",
                    relative([found_k_s, found_tau_e], [true_k_s[axis], TAU_E]),
                    0.02,
                )


@pytest.mark.slow
@pytest.mark.skipif(not (SHARED / "campaign").is_dir(), reason="the campaign's files are not here")
@pytest.mark.parametrize("bias", ["6A", "10A"])
def test_the_closed_loop_identification_of_the_paper(bias, validated):
    """Small runs, in which the curvature of the force does not count."""
    folder = SHARED / "campaign"
    truth, rig = json.loads((folder / "answers.json").read_text())[bias], Rig.load(folder / bias / "rig.toml")
    runs = sorted((folder / bias).glob("prbs_small_*.mat"))
    parameters = ambid.identify(rig, [ambid.Record.load(path, rig) for path in runs]).parameters
    names = [*(f"{kind}.{axis}" for kind in ("K_i", "K_s") for axis in rig.axes), "tau_e"]
    true = [*truth["K_i"], *truth["K_s"], truth["tau_e"]]
    validated(
        "K_i, K_s, tau_e at 6, 8 and 10 A from five small runs each: error in standard errors",
        "independent simulator whose K_s are those of Table 2 of the paper",
        [
            (parameters[name].value - value) / parameters[name].std_error
            for name, value in zip(names, true, strict=True)
        ],
        4.0,
    )


def test_scatter_over_the_runs(found):
    small = found.points[0].runs[1]
    values = [run.parameters["K_s.A_zeta"].value for run in small.single]
    assert small.values("K_s.A_zeta") == values
    deviation = abs(values[0] - values[1]) / np.sqrt(2)
    assert small.rsd_percent("K_s.A_zeta") == pytest.approx(100 * deviation / np.mean(values))
    error = 100 * small.single[0].parameters["K_s.A_zeta"].std_error / values[0]
    assert 0.0 < small.rsd_percent("K_s.A_zeta") < 5 * error
    assert [len(estimate.records) for estimate in (small.joint, *small.single)] == [2, 1, 1]


@pytest.mark.slow
def test_errors_of_the_rig_file_are_those_of_one_machine(broken):
    for point in (broken / name for name in K_I):
        rig = Rig.load(point / "rig.toml").replace(tolerance={"sensor_gain": 0.01})
        (point / "rig.toml").write_text(rig.to_toml())
        for path in {*point.glob("prbs_large*"), *point.glob("static*"), *point.glob("*_2.mat")}:
            path.unlink()
    low, high = (point.runs[0] for point in campaign(broken).points)
    assert low.joint.tolerances
    for name, known in low.joint.tolerances.items():
        assert high.joint.tolerances[name].posterior_value == pytest.approx(known.posterior_value, abs=1e-9)
        assert high.joint.tolerances[name].posterior_std == pytest.approx(known.posterior_std)
    for runs in (low, high):
        assert all(p.std_error < runs.single[0][name].std_error for name, p in runs.joint.parameters.items())


def test_json_and_tables(found, template):
    content = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert len(content["K_i"]) == 2 * 4 * 3
    row = content["K_i"][0]
    assert (row["folder"], row["bias_current"], row["axis"], row["method"]) == ("6A", 6.0, "A_zeta", "prbs_large")
    assert row["ci95"][0] < row["value"] < row["ci95"][1]
    point = content["points"][1]
    assert point["bias_current"] == {"A": 10.0, "B": 10.0}
    assert len(point["closed_loop"]["prbs_small"]["runs"]) == 2
    assert point["closed_loop"]["prbs_small"]["over_runs"]["tau_e"]["rsd_percent"] > 0
    (unused,) = content["findings"]
    assert (unused["code"], unused["where"]["file"]) == (EMPTY.code, str(template / "plots"))
    assert content["notes"] == list(found.notes)
    lines = str(found).splitlines()
    k_i = found.points[1].force_current("static", "B_eta")
    assert any(line.split()[:3] == ["10A", "B_eta", "10"] and f"{k_i.value:.2f} [" in line for line in lines)
    assert sum(line.split()[:1] == ["6A"] for line in lines) == 4 + 2 + 2
    assert "forces: f = K_i i + K_s s, K_s > 0 destabilises" in lines
    assert found.next_step.kind is VALIDATE_MODELS
    assert lines[-1] == f"next: {content['next']}"


def test_what_the_worst_records_miss_is_to_be_diagnosed(found):
    """At the bias current and of the kind with the largest misfit; files are those that were read."""
    first, point = found.points
    large, small = point.runs
    wrong = small.joint.model.with_values({"tau_e": 1.2 * TAU_E})
    bad = replace(small.joint, comparison=small.joint.comparison.of(wrong))
    worse = replace(found, points=(first, replace(point, runs=(large, replace(small, joint=bad)))))
    assert worse.missed == (worse.points[1], worse.points[1].runs[1])
    train, other = str(small.joint.records[0].path), str(large.joint.records[0].path)
    shown = worse.next_step
    assert shown.kind is DIAGNOSE_KIND
    files = {"rig": str(point.rig.path), "record": train, "validate": other}
    assert shown.values == {"kind": "prbs_small", "folder": "10A", **files}


def test_pictures_of_two_methods_a_panel_for_each_axis(found, golden):
    panels = plot_campaign(found)
    assert [panel.get_title(loc="left") for panel in panels] == [f"K_i.{axis}" for axis in found.axes]
    static = panels[3].containers[2]
    assert static.has_yerr
    k_i = [point.force_current("static", "B_eta") for point in found.points]
    np.testing.assert_allclose(static.lines[0].get_ydata(), [p.value for p in k_i])
    strip = panels[3].figure.axes[7]
    golden.holds(f"{static.get_label()}, {strip.get_ylabel()}")
    low = strip.containers[2].lines[2][0].get_segments()[0][0, 1]
    means = np.mean([found.points[0].force_current(method, "B_eta").value for method in found.methods])
    assert low == pytest.approx(100.0 * (k_i[0].ci95[0] / means - 1.0))
    styles = {(c.lines[0].get_marker(), str(c.lines[0].get_linestyle())) for c in panels[0].containers}
    assert len(styles) == 3


@pytest.mark.slow
def test_other_quantities_are_drawn_and_the_axes_that_are_given_are_used(found, tmp_path, golden):
    (given,) = Figure().subplots(1, 1, squeeze=False).ravel()
    assert list(plot_campaign(found, "tau_e", [given])) == [given]
    tau_e = found.points[0].runs[0].joint.parameters["tau_e"].value
    assert given.containers[0].lines[0].get_ydata()[0] == pytest.approx(1e6 * tau_e)
    assert given.get_ylabel() == "[µs]"
    files = save_campaign(found, tmp_path / "bench.png")
    assert [file.name for file in files] == ["bench.png", "bench_K_s.png", "bench_tau_e.png"]
    assert all(imread(file).shape[0] > 300 for file in files)
    for quantity, ax in (("K_x", None), ("K_s", [given])):
        with golden.raises(InputError):
            plot_campaign(found, quantity, ax)
    with golden.raises(InputError):
        save_campaign(found, tmp_path / "k_i.bmp")


def test_tables_as_csv_and_for_latex(found, tmp_path, golden):
    k_i, k_s, tau_e = found.save_tables(tmp_path / "bench.csv")
    rows = list(csv.reader(k_s.open()))
    assert rows[0][:5] == ["folder", "records", "i0 [A]", "A_zeta", "RSD %"]
    assert float(rows[1][3]) == pytest.approx(found.points[0].runs[0].joint.parameters["K_s.A_zeta"].value, rel=1e-4)
    assert len(rows) == 1 + 4
    assert len(list(csv.reader(k_i.open()))) == 1 + 8
    assert len(list(csv.reader(tau_e.open()))) == 1 + 4
    *_, latex = found.save_tables(tmp_path / "bench.tex")
    text = latex.read_text()
    assert r"$\tau_{e}$ & RSD \%" in text
    assert r"prbs\_large" in text
    assert text.count("tabular") == 2
    with golden.raises(InputError):
        found.save_tables(tmp_path / "bench.xls")


@pytest.mark.slow
def test_deflection_is_taken_in_by_static_loading(found, template):
    bent = campaign(template, deflection=True)
    for own, other in zip(found.points, bent.points, strict=True):
        k_i = [point.force_current("static", "A_zeta").value for point in (own, other)]
        assert 1e-4 < abs(k_i[1] / k_i[0] - 1.0) < 0.05
        assert own.force_current("prbs_small", "A_zeta").value == other.force_current("prbs_small", "A_zeta").value


def test_what_is_missing_is_said(broken):
    shutil.rmtree(broken / "10A")
    for path in [*broken.glob("6A/static_*.csv"), *broken.glob("6A/prbs_large_*"), broken / "6A" / "prbs_small_2.mat"]:
        path.unlink()
    shutil.copy(broken / "6A" / "prbs_small_1.mat", broken)
    steps = []
    found = campaign(broken, progress=lambda *step: steps.append(step))
    assert steps == [(k, 2, str(broken / "6A" / name)) for k, name in enumerate(("prbs_small_1", "prbs_small"))]
    assert found.methods == ("prbs_small",)
    point = found.points[0]
    assert point.static is None
    assert point.force_current("static", "A_zeta") is None
    assert has(point.findings, NO_LOADINGS)
    assert point.runs[0].rsd_percent("tau_e") is None
    (unused,) = (own for own in found.findings if own.kind is OUTSIDE)
    assert unused.where.file == str(broken / "prbs_small_1.mat")
    assert found.to_json()["points"][0]["static_load"] is None
    assert "prbs_small" in str(found)


@pytest.mark.slow
def test_runs_are_ordered_by_number(broken):
    shutil.rmtree(broken / "10A")
    for number in (9, 10):
        shutil.copy(broken / "6A" / "prbs_small_1.mat", broken / "6A" / f"prbs_small_{number}.mat")
    seen = []
    campaign(broken, progress=lambda done, total, what: seen.append(what.rpartition("_")[2]))
    assert seen[-5:] == ["1", "2", "9", "10", "small"]


def test_layouts_that_are_refused(broken, tmp_path, golden):
    with golden.raises(InputError):
        campaign(tmp_path / "nowhere")
    with golden.raises(InputError):
        campaign(broken / "6A")
    (broken / "6A" / "rig.toml").rename(broken / "rig.toml")
    with golden.raises(RigError):
        campaign(broken)


def test_no_records(broken, golden):
    for path in broken.glob("10A/prbs_*"):
        path.unlink()
    with golden.raises(RecordError):
        campaign(broken)


@pytest.mark.parametrize("name", ["prbs_small_2.mat", "static_1.csv"])
def test_a_broken_file_is_named(broken, name):
    path = broken / "10A" / name
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(RecordError, match=f"10A/{name}"):
        campaign(broken)


def test_another_machine(broken, golden):
    path = broken / "6A" / "rig.toml"
    path.write_text(path.read_text().replace('name = "B"', 'name = "C"'))
    for record in broken.glob("6A/*.*"):
        if record.suffix in (".mat", ".csv"):
            record.unlink()
    rig = Rig.load(path)
    i_e = prbs(8, amplitude=0.1, hold=3, axes=4, periods=4)
    ambid.Model(rig).virtual_experiment(i_e, seed=0).save(broken / "6A" / "run_1.csv")
    with golden.raises(RigError):
        campaign(broken)


def test_an_identification_that_fails_names_its_record(broken):
    shutil.rmtree(broken / "6A")
    path = broken / "10A" / "rig.toml"
    text = path.read_text()
    assert "proportional = 28000.0" in text
    path.write_text(text.replace("proportional = 28000.0", "proportional = 280.0"))
    with pytest.raises(UnstableLoopError, match="10A/prbs_large_1: "):
        campaign(broken)


@pytest.mark.parametrize("call", [0, 1, 2, 3, 5, 6, 9])
def test_ctrl_c_hands_back_the_fits_that_are_done(call, template, found, monkeypatch, tmp_path):
    """Six fits belong to each of the two points; those of the whole campaign stand in for them."""
    estimates = [estimate for point in found.points for runs in point.runs for estimate in (*runs.single, runs.joint)]
    calls = iter(range(len(estimates)))

    def fit(*_):
        if (number := next(calls)) == call:
            raise KeyboardInterrupt
        return estimates[number]

    monkeypatch.setattr("ambid.campaigns.procedure.identify", fit)
    with pytest.raises(KeyboardInterrupt) as stopped:
        campaign(template)
    assert isinstance(stopped.value, Stopped) == (call > 0)
    if call == 0:
        return
    result = stopped.value.result
    shown = [e for point in result.points for own in point.runs for e in (*own.single, own.joint)]
    assert [*shown, *(e for point in result.points for e in point.begun)] == estimates[:call]
    assert result.findings[-1].kind is STOPPED
    left = ["10A"] if call >= 6 else ["6A", "10A"]
    assert result.findings[-1].values == {"done": call, "total": 12, "folders": left}
    data = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert data["stopped"]
    assert sum(len(point["begun"]) for point in data["points"]) == len(result.points[-1].begun)
    assert result.notes[-1] in str(result)
    assert f"{estimates[call - 1].parameters['tau_e'].value:.5g}" in str(result)
    assert result.next_step.kind is BEGIN_ANEW
    if call == 9:  # in the middle of the last kind
        assert len(plot_campaign(result)) == 4
        assert len(result.save_tables(tmp_path / "k.tex")) == 3
