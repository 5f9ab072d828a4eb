"""Whatever a user can get wrong ends with exit code 2 and a message of its own that names the thing."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ambid.demo import DATA
from ambid.excitation import prbs
from ambid.model import Model
from ambid.rig import Rig

RIG_TEXT = (DATA / "rig.toml").read_text()
LOAD_TEXT = (DATA / "static_1.csv").read_text()


@pytest.fixture(scope="module")
def table():
    """Columns of a healthy record, 4 periods of 254 samples on the demo's bench."""
    rig = Rig.load(DATA / "rig.toml")
    i_e = prbs(7, amplitude=0.1, hold=2, axes=4, periods=4)
    record = Model(rig).virtual_experiment(i_e, seed=3)
    columns = {"t": record.t}
    for signal in ("i_e", "y", "i_c"):
        columns |= {f"{signal}.{axis}": getattr(record, signal)[:, k] for k, axis in enumerate(record.axes)}
    return columns


@pytest.fixture
def files(tmp_path, table, healthy_text, monkeypatch):
    """A folder with a healthy rig.toml, run.csv and load.csv, in which the command runs."""
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(RIG_TEXT)
    Path("load.csv").write_text(LOAD_TEXT)
    Path("run.csv").write_text(healthy_text)
    return table


def write_columns(columns) -> None:
    np.savetxt("run.csv", np.stack(list(columns.values()), 1), "%.9g", ",", header=",".join(columns), comments="")


@pytest.fixture(scope="module")
def healthy_text(table, tmp_path_factory):
    """The healthy record as it is written."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("healthy"))
        write_columns(table)
        return Path("run.csv").read_text()


# Each maker breaks one thing in the folder.


def rig(old, new):
    """Replace the first `old` in the rig file."""

    def make(_):
        assert old in RIG_TEXT
        Path("rig.toml").write_text(RIG_TEXT.replace(old, new, 1))

    return make


def without_table(name):
    """Take a table out of the rig file."""

    def make(_):
        before, _, rest = RIG_TEXT.partition(f"\n[{name}]\n")
        assert rest
        after = rest.find("\n[")
        Path("rig.toml").write_text(before + (rest[after:] if after >= 0 else ""))

    return make


def text(name, content):
    return lambda _: Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())


def column(name, change):
    """Change one column of the record; None takes it out."""

    def make(columns):
        values = change(columns[name].copy()) if change else None
        write_columns({k: values if k == name else v for k, v in columns.items() if k != name or change})

    return make


def columns(change):
    """Change the columns of the record."""
    return lambda found: write_columns(change(dict(found)))


def at(row, value):
    def change(values):
        values[row] = value
        return values

    return change


def rows(change):
    """Change the lines of the record, header first."""
    return lambda _: Path("run.csv").write_text("\n".join(change(Path("run.csv").read_text().splitlines())) + "\n")


def loads(change):
    """Change the lines of the static loading, header first."""
    return lambda _: Path("load.csv").write_text("\n".join(change(LOAD_TEXT.splitlines())) + "\n")


def cell(line, row, k, value):
    cells = line[row].split(",")
    cells[k] = value
    return [*line[:row], ",".join(cells), *line[row + 1 :]]


def renamed(old, new):
    return lambda found: {k.replace(old, new): v for k, v in found.items()}


def model(change):
    """Write model.json, changed."""

    def make(_):
        Model(Rig.load("rig.toml")).save("model.json")
        content = json.loads(Path("model.json").read_text())
        change(content)
        Path("model.json").write_text(json.dumps(content))

    return make


def healthy(_):
    pass


IDENTIFY = ("identify", "rig.toml", "run.csv")
COMPARE = ("compare", "rig.toml", "run.csv")
STATIC = ("static-load", "rig.toml", "load.csv")
SIMULATE = ("simulate", "rig.toml", "--out", "virtual.csv")
PID = 'kind = "pid"'

RIGS = {
    "rig, no such file": (healthy, ("identify", "rigg.toml", "run.csv"), "rigg.toml"),
    "rig, a folder": (healthy, ("identify", ".", "run.csv"), ".: "),
    "rig, empty": (text("rig.toml", ""), IDENTIFY, "name"),
    "rig, not TOML": (rig("sample_rate = ", "sample_rate : "), IDENTIFY, "TOML"),
    "rig, binary": (text("rig.toml", b"\xff\xfe\x00\x01"), IDENTIFY, "UTF-8"),
    "rig, unknown key": (rig("air_gap", "air_gpa"), IDENTIFY, "air_gpa"),
    "rig, unknown table": (rig("[amplifier]", "[amplifyer]"), IDENTIFY, "amplifyer"),
    "rig, gap in mm": (rig("air_gap = 0.000515", "air_gap = 0.515"), IDENTIFY, "air_gap"),
    "rig, gap zero": (rig("air_gap = 0.000502", "air_gap = 0.0"), IDENTIFY, "bearing[1] (B).air_gap"),
    "rig, gap as text": (rig("air_gap = 0.000515", 'air_gap = "0.5 mm"'), IDENTIFY, "0.5 mm"),
    "rig, negative mass": (rig("mass = 2.4629207 ", "mass = -2.4629207 "), IDENTIFY, "rotor.disk[0].mass"),
    "rig, disk off the shaft": (rig("position = 0.14 ", "position = 1.4 "), IDENTIFY, "rotor.disk[0].position"),
    "rig, bearing off the shaft": (rig('name = "B"\nposition = 0.66', 'name = "B"\nposition = 0.99'), IDENTIFY, "0.99"),
    "rig, sensor in mm": (rig("sensor_position = 0.72", "sensor_position = 720.0"), IDENTIFY, "sensor_position"),
    "rig, no amplifier": (without_table("amplifier"), IDENTIFY, "amplifier"),
    "rig, no actuator": (without_table("actuator"), IDENTIFY, "actuator"),
    "rig, no controller": (without_table("controller"), IDENTIFY, "controller"),
    "rig, no material": (without_table("rotor.material"), IDENTIFY, "material"),
    "rig, K_s zero": (rig("[2200000.0, 2200000.0]", "[0.0, 2200000.0]"), IDENTIFY, "force_displacement[0]"),
    "rig, K_s in N/um": (rig("[2200000.0, 2200000.0]", "[2.2, 2.2]"), IDENTIFY, "force_displacement"),
    "rig, three K_i": (rig("[200.0, 200.0]", "[200.0, 200.0, 200.0]"), IDENTIFY, "force_current"),
    "rig, K_i zero": (rig("[250.0, 250.0]", "[250.0, 0.0]"), IDENTIFY, "force_current[1]"),
    "rig, rate in kHz": (rig("sample_rate = 10000.0", "sample_rate = 10.0"), IDENTIFY, "sample_rate"),
    "rig, time constant in ms": (rig("time_constant = 0.0002 ", "time_constant = 0.2 "), IDENTIFY, "amplifier.time_"),
    "rig, tau_e zero": (rig("time_constant = 0.0004", "time_constant = 0.0"), IDENTIFY, "actuator.time_constant"),
    "rig, modulus in GPa": (rig("youngs_modulus = 2.060e+11", "youngs_modulus = 206.0"), IDENTIFY, "youngs_modulus"),
    "rig, half a mode": (rig("flexible_modes = 2 ", "flexible_modes = 2.5 "), IDENTIFY, "flexible_modes"),
    "rig, more modes than frequencies": (rig("flexible_modes = 2 ", "flexible_modes = 3 "), IDENTIFY, "bending_freq"),
    "rig, frequencies descend": (rig("[553.788, 1382.733]", "[1382.733, 553.788]"), IDENTIFY, "bending_freq"),
    "rig, damping in percent": (rig("modal_damping = 0.004", "modal_damping = 4.0"), IDENTIFY, "modal_damping"),
    "rig, hollow beyond its skin": (rig("inner_diameter = 0.0", "inner_diameter = 0.07"), IDENTIFY, "inner_diameter"),
    "rig, two bearings of one name": (rig('name = "B"', 'name = "A"'), IDENTIFY, "bearing[1] (A).name"),
    "rig, bearing name with a dot": (rig('name = "B"', 'name = "B.1"'), IDENTIFY, "B.1"),
    "rig, unknown controller": (rig(PID, 'kind = "pdi"'), IDENTIFY, "pdi"),
    "rig, unknown implementation": (rig('= "analog"', '= "fpga"'), IDENTIFY, "fpga"),
    "rig, delay of an analog controller": (rig(PID, f"{PID}\ndelay_samples = 1.0"), IDENTIFY, "delay_samples"),
    "rig, unfiltered derivative": (
        rig("derivative_time_constant = 0.0001", ""), IDENTIFY, "controller.derivative_time_constant"
    ),
    "rig, gain not a number": (rig("proportional = 28000.0", "proportional = nan"), IDENTIFY, "proportional"),
    "rig, gain of the other sign": (rig("proportional = 28000.0", "proportional = -28000.0"), IDENTIFY, "-28000"),
    "rig, speed negative": (rig("speed = 0 ", "speed = -10.0 "), IDENTIFY, "speed"),
    "rig, speed as truth value": (rig("speed = 0 ", "speed = true "), IDENTIFY, "True"),
}  # fmt: skip

RECORDS = {
    "record, no such file": (healthy, ("identify", "rig.toml", "runn.csv"), "runn.csv"),
    "record, empty": (text("run.csv", ""), IDENTIFY, "run.csv"),
    "record, unknown suffix": (healthy, ("identify", "rig.toml", "run.dat"), ".dat"),
    "record, damaged .mat": (text("run.mat", b"no matlab " * 40), ("identify", "rig.toml", "run.mat"), "run.mat"),
    "record, damaged .h5": (text("run.h5", b"no hdf5 " * 40), ("identify", "rig.toml", "run.h5"), "HDF5"),
    "record, damaged .parquet": (text("run.parquet", b"none"), ("identify", "rig.toml", "run.parquet"), "Parquet"),
    "record, header alone": (rows(lambda lines: lines[:1]), IDENTIFY, "run.csv"),
    "record, no header": (rows(lambda lines: lines[1:]), IDENTIFY, "run.csv"),
    "record, text in a cell": (rows(lambda lines: cell(lines, 7, 5, "overrange")), IDENTIFY, "overrange"),
    "record, short row": (rows(lambda lines: [*lines[:9], "0.1,0.2", *lines[9:]]), IDENTIFY, "row 9"),
    "record, binary": (text("run.csv", b"\xff\xfe\x80abc"), IDENTIFY, "run.csv"),
    "record, too short": (rows(lambda lines: lines[:3]), IDENTIFY, "2 samples"),
    "record, no t": (column("t", None), IDENTIFY, "'t' [s]"),
    "record, no y": (columns(renamed("y.", "x.")), IDENTIFY, "y.<axis>"),
    "record, an axis less": (column("y.B_eta", None), IDENTIFY, "B_eta"),
    "record, other axes": (columns(renamed("A_zeta", "A_x")), IDENTIFY, "A_x"),
    "record, column twice": (rows(lambda x: [x[0].replace("y.A_eta", "y.A_zeta"), *x[1:]]), IDENTIFY, "y.A_zeta"),
    "record, not a number": (column("y.A_zeta", at(41, np.nan)), IDENTIFY, "y.A_zeta"),
    "record, infinite": (column("i_c.B_zeta", at(41, np.inf)), IDENTIFY, "i_c.B_zeta"),
    "record, gap in t": (column("t", lambda t: np.where(t > 0.05, t + 0.01, t)), IDENTIFY, "row 502"),
    "record, t turns back": (column("t", at(50, 0.001)), IDENTIFY, "row 51"),
    "record, t in ms": (column("t", lambda t: 1e3 * t), IDENTIFY, "10 Hz"),
    "record, other rate": (column("t", lambda t: 2.0 * t), IDENTIFY, "5000 Hz"),
    "record, dead sensor": (column("y.B_zeta", np.zeros_like), IDENTIFY, "y.B_zeta"),
    "record, dead current": (column("i_c.B_zeta", lambda i: 0.0 * i + 1.5), IDENTIFY, "i_c.B_zeta"),
    "record, clipped": (column("y.A_eta", lambda y: np.clip(y, -1e-7, 1e-7)), IDENTIFY, "y.A_eta"),
    "record, micrometres": (column("y.A_eta", lambda y: 1e6 * y), IDENTIFY, "y.A_eta"),
    "record, milliamperes": (column("i_c.A_eta", lambda i: 1e4 * i), IDENTIFY, "i_c.A_eta"),
    "record, no excitation": (
        columns(lambda found: {k: 0.0 * v if k.startswith("i_e") else v for k, v in found.items()}),
        IDENTIFY,
        "i_e",
    ),
    "record, neither i_e nor i_c": (
        columns(lambda found: {k: v for k, v in found.items() if not k.startswith("i_")}), IDENTIFY, "i_e"
    ),
    "record, period of nothing": (healthy, (*IDENTIFY, "--period", "0"), "period = 0"),
    "record, period too long": (healthy, (*COMPARE, "--period", "5000"), "period = 5000"),
    "load, no such file": (healthy, ("static-load", "rig.toml", "loads.csv"), "loads.csv"),
    "load, other format": (healthy, ("static-load", "rig.toml", "load.mat"), ".mat"),
    "load, no force": (loads(lambda x: [x[0].replace("F_x", "P_x"), *x[1:]]), STATIC, "F_x"),
    "load, two steps": (loads(lambda x: x[:3]), STATIC, "load.csv: 2"),
    "load, off the shaft": (loads(lambda x: cell(x, 2, 1, "430.0")), STATIC, "430"),
    "load, current in mA": (loads(lambda x: cell(x, 2, 4, "1e5")), STATIC, "i_c.A_zeta"),
    "load, not a number": (loads(lambda x: cell(x, 2, 3, "nan")), STATIC, "F_y"),
}  # fmt: skip

OPTIONS = {
    "free, unknown": (healthy, (*IDENTIFY, "--free", "K_x"), "K_x"),
    "free, nothing left": (healthy, (*IDENTIFY, "--free", "tau_e", "--fix", "tau_e"), "`free`"),
    "fix, unknown": (healthy, (*IDENTIFY, "--fix", "tau_f"), "tau_f"),
    "fix, not a number": (healthy, (*IDENTIFY, "--fix", "tau_e=fast"), "'fast'"),
    "fix, negative": (healthy, (*IDENTIFY, "--fix", "tau_e=-1e-4"), "-0.0001"),
    "share, no members": (healthy, (*IDENTIFY, "--share", "K_i.A"), "--share K_i.A"),
    "share, unknown member": (healthy, (*IDENTIFY, "--share", "K_i.A=K_i.C_*"), "K_i.C_*"),
    "share, other units": (healthy, (*IDENTIFY, "--share", "K=K_i.A_zeta,K_s.A_zeta"), "K_i.A_zeta, K_s.A_zeta"),
    "share, name taken": (healthy, (*IDENTIFY, "--share", "tau_e=K_i.A_*"), "tau_e"),
    "per axis, unknown": (healthy, (*IDENTIFY, "--per-axis", "tau_x"), "tau_x"),
    "per axis, already": (healthy, (*IDENTIFY, "--per-axis", "K_i"), "K_i"),
    "bound, one number": (healthy, (*IDENTIFY, "--bound", "tau_e=1e-4"), "--bound tau_e=1e-4"),
    "bound, no number": (healthy, (*IDENTIFY, "--bound", "tau_e=a:b"), "'a'"),
    "bound, turned round": (healthy, (*IDENTIFY, "--bound", "tau_e=2e-3:1e-4"), "0.002 .. 0.0001"),
    "bound, start outside": (healthy, (*IDENTIFY, "--bound", "tau_e=1e-3:2e-3"), "tau_e = 0.0004"),
    "bound, unknown": (healthy, (*IDENTIFY, "--bound", "tau_z=1e-4:1e-3"), "tau_z"),
    "weight, unknown": (healthy, (*IDENTIFY, "--weight", "z=1"), "weights: z"),
    "weight, negative": (healthy, (*IDENTIFY, "--weight", "y=-1"), "y = -1"),
    "weight, not a number": (healthy, (*IDENTIFY, "--weight", "y=much"), "'much'"),
    "weight, nothing left": (healthy, (*IDENTIFY, "--weight", "y=0", "--weight", "i_c=0"), "weights"),
    "starts, none": (healthy, (*IDENTIFY, "--starts", "0"), "starts"),
    "starts, a fraction": (healthy, (*IDENTIFY, "--starts", "2.5"), "--starts"),
    "seed, negative": (healthy, (*IDENTIFY, "--starts", "2", "--seed", "-3"), "seed = -3"),
    "evaluations, none": (healthy, (*IDENTIFY, "--max-evaluations", "0"), "max_evaluations = 0"),
    "plot, unknown format": (healthy, (*COMPARE, "--plot", "fit.xyz"), ".xyz"),
    "plot, no such folder": (healthy, (*COMPARE, "--plot", "nowhere/fit.png"), "nowhere/fit.png"),
    "json, no such folder": (healthy, (*COMPARE, "--json", "nowhere/fit.json"), "nowhere/fit.json"),
    "save, no such folder": (healthy, (*IDENTIFY, "--save", "nowhere/model.json"), "nowhere/model.json"),
    "model, no such file": (healthy, (*COMPARE, "--model", "none.json"), "none.json"),
    "model, not ours": (model(lambda m: m.update(format="x")), (*COMPARE, "--model", "model.json"), "'x'"),
    "json, a folder": (healthy, (*COMPARE, "--json", "."), ".: "),
    "model, of another machine": (
        model(lambda m: m["parameters"].update(extra={"value": 1, "unit": "s", "slots": ["tau_e.C_zeta"]})),
        (*COMPARE, "--model", "model.json"),
        "model.json: tau_e.C_zeta",
    ),
    "model, not JSON": (text("model.json", "{"), (*COMPARE, "--model", "model.json"), "model.json"),
    "model, a list": (text("model.json", "[1]"), (*COMPARE, "--model", "model.json"), "model.json"),
    "model, a parameter less": (
        model(lambda m: m["parameters"].pop("tau_e")), (*COMPARE, "--model", "model.json"), "tau_e.A_zeta"
    ),
    "model, negative value": (
        model(lambda m: m["parameters"]["tau_e"].update(value=-1.0)), (*COMPARE, "--model", "model.json"), "tau_e = -1"
    ),
    "simulate, too short": (healthy, (*SIMULATE, "--seconds", "0.01"), "--seconds 0.01"),
    "simulate, endless": (healthy, (*SIMULATE, "--seconds", "inf"), "inf"),
    "simulate, no amplitude": (healthy, (*SIMULATE, "--amplitude", "0"), "amplitude"),
    "simulate, negative noise": (healthy, (*SIMULATE, "--sensor-noise", "-1e-9"), "sensor_noise = -1e-09"),
    "simulate, noise not a number": (healthy, (*SIMULATE, "--current-noise", "nan"), "current_noise = nan"),
    "simulate, negative seed": (healthy, (*SIMULATE, "--seed", "-1"), "seed = -1"),
    "simulate, unknown format": (healthy, ("simulate", "rig.toml", "--out", "virtual.xls"), ".xls"),
    "simulate, no such folder": (healthy, ("simulate", "rig.toml", "--out", "nowhere/v.csv"), "nowhere/v.csv"),
    "record, a folder": (healthy, ("compare", "rig.toml", "."), ".: "),
    "record, a folder with a suffix": (
        lambda _: Path("runs.mat").mkdir(),
        ("identify", "rig.toml", "runs.mat"),
        "runs.mat",
    ),
    "before, without a plot": (healthy, (*COMPARE, "--before", "m.json"), "--before m.json"),
    "stretch, without a plot": (healthy, (*COMPARE, "--stretch", "0:1"), "--stretch 0:1"),
    "before, no such file": (healthy, (*COMPARE, "--before", "gone.json", "--plot", "c.png"), "gone.json: "),
    "fix, beyond its range": (healthy, (*IDENTIFY, "--fix", "tau_e=0.25"), "--fix tau_e=0.25"),
    "fix, a pattern below zero": (healthy, (*IDENTIFY, "--fix", "K_i=-5"), "--fix K_i=-5: K_i"),
    "fix, no such parameter": (healthy, (*IDENTIFY, "--fix", "tau_x=1"), "--fix tau_x=1: tau_x"),
    "no record": (healthy, ("identify", "rig.toml"), "RECORD"),
    "no rig": (healthy, ("compare",), "RIG"),
    "unknown command": (healthy, ("identifi",), "identifi"),
    "unknown option": (healthy, (*COMPARE, "--modle", "m.json"), "--modle"),
}  # fmt: skip

CASES = RIGS | RECORDS | OPTIONS
IN_WORDS_OF_OTHERS = {
    *("no record", "no rig", "unknown command", "unknown option", "starts, a fraction"),  # of Click
    *("rig, a folder", "rig, binary", "rig, not TOML"),
    *("record, damaged .mat", "record, damaged .h5", "record, damaged .parquet"),
    *("model, no such file", "before, no such file", "model, not JSON", "model, a list"),
}
"""Cases whose message cites a library or the system, whose words change with their versions."""
MESSAGES: dict[str, str] = {}
"""Message of each case that has run, to be compared with those of the others; a module runs in one process."""


@pytest.mark.parametrize("case", CASES)
def test_bad_input_ends_with_its_own_message(case, files, command, golden):
    make, arguments, names = CASES[case]
    make(files)
    result = command(*arguments)
    assert result.code == 2, result.err or result.out
    assert names in " ".join(result.err.split())
    if case not in IN_WORDS_OF_OTHERS:
        golden.holds(result.err)
    assert "Traceback" not in result.err
    assert "panicked" not in result.err
    twin = MESSAGES.get(result.err)
    assert twin in (None, case), f"the same message as {twin}: {result.err}"
    MESSAGES[result.err] = case


@pytest.mark.parametrize(
    "case",
    [
        "record, gap in t",
        "unknown option",
        pytest.param("rig, gap in mm", marks=pytest.mark.slow),
        pytest.param("free, unknown", marks=pytest.mark.slow),
    ],
)
def test_bad_input_of_a_process(case, files):
    make, arguments, names = CASES[case]
    make(files)
    program = [sys.executable, "-c", "from ambid.cli import main; main()", *arguments]
    result = subprocess.run(program, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert names in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
