"""The rig file: read as it is written, refused with a helpful word, and its controllers as state space."""

import pickle

import numpy as np
import pytest
import scipy.io

from ambid.errors import RigError
from ambid.rig import (
    Actuator,
    Amplifier,
    Bearing,
    FiniteElementRotor,
    Material,
    MatrixRotor,
    ModalRotor,
    PidController,
    PointMassRotor,
    Rig,
    Section,
    StateSpaceController,
    Tolerance,
    TransferFunctionController,
)
from places import BENCH, SHARED

SHARED_RIGS = sorted(SHARED.glob("cases/*/rig.toml")) + sorted(SHARED.glob("campaign/*/rig.toml"))

STATE_SPACE = 'kind = "state_space"\nimplementation = "digital"\n'
TRANSFER = 'kind = "transfer_function"\nimplementation = "analog"\n'
MASS = 'kind = "mass"\nmass = 2.0\n'
MODES = 'kind = "modes"\nfrequencies_hz = [0, 0, 550.0]\ndamping = [0, 0, 0.01]\npositions = [0.0, 0.4, 0.86]\n'
SHAPES = "shapes = [[0.1, 0.1, 0.1], [0.2, 0.0, -0.2], [0.1, -0.1, 0.1]]\n"


def bench_text() -> str:
    return BENCH.read_text(encoding="utf-8")


def edited(*edits: tuple[str, str]) -> str:
    """Text of the bench rig with the first occurrence of each pattern replaced."""
    text = bench_text()
    for old, new in edits:
        assert old in text, f"the bench rig has no {old!r}"
        text = text.replace(old, new, 1)
    return text


def with_table(name: str, body: str) -> str:
    """Text of the bench rig whose [rotor] or [controller], with all that is in it, has another body."""
    text = bench_text()
    start = text.index(f"[{name}]")
    end = text.index("[[bearing]]") if name == "rotor" else len(text)
    return f"{text[:start]}[{name}]\n{body}\n{text[end:]}"


def levitator(**changes) -> Rig:
    forces = {"bias_current": 1.0, "air_gap": 1e-3, "force_current": 20.0, "force_displacement": 2e4}
    bearing = Bearing(name="A", axes=("zeta",), position=0.0, sensor_position=0.0, **forces)
    values = {
        "name": "levitator",
        "sample_rate": 2000.0,
        "rotor": PointMassRotor(mass=0.5),
        "bearings": [bearing],
        "tolerance": Tolerance(exact=True),
        "amplifier": Amplifier(time_constant=0.0),
        "actuator": Actuator(time_constant=1e-3),
        "controller": PidController(
            implementation="analog", proportional=3e3, derivative=10.0, derivative_time_constant=1e-3
        ),
    }
    return Rig(**(values | changes))


# --- reading -------------------------------------------------------------------------------------------------


def test_reads_every_key_of_the_bench():
    rig = Rig.load(BENCH)
    assert rig.axes == ("A_zeta", "A_eta", "B_zeta", "B_eta")
    assert (rig.sample_rate, rig.speed, rig.path) == (10000.0, 0.0, BENCH)
    assert isinstance(rig.rotor, FiniteElementRotor)
    assert rig.rotor.flexible_modes == 2
    assert rig.rotor.bending_frequencies_hz == (553.788, 1382.733)
    assert rig.rotor.span == (0.0, 0.86)
    assert (len(rig.rotor.section), len(rig.rotor.disk)) == (12, 7)
    assert rig.bearings[1].force_displacement == (2.9e6, 2.9e6)
    assert rig.bearings[0].tilt == 45.0
    assert (rig.amplifier.time_constant, rig.actuator.time_constant) == (2e-4, 4e-4)
    assert isinstance(rig.controller, PidController)
    assert rig.controller.proportional == 28000.0


@pytest.mark.skipif(not SHARED_RIGS, reason="the shared reference rigs are not beside the project")
@pytest.mark.parametrize("path", SHARED_RIGS, ids=lambda p: p.parent.name)
def test_reads_the_reference_rigs(path):
    rig = Rig.load(path)
    assert len(rig.axes) == 4
    assert Rig.from_toml(rig.to_toml()) == rig


def test_a_section_may_name_its_own_material():
    table = "[rotor.section.material]\ndensity = 2700\nyoungs_modulus = 7e10\npoisson_ratio = 0.33\n"
    rig = Rig.from_toml(edited(("inner_diameter = 0.0\n", table)))
    assert rig.rotor.section[0].material == Material(density=2700, youngs_modulus=7e10, poisson_ratio=0.33)
    assert Rig.from_toml(rig.to_toml()) == rig


def test_a_plain_number_stands_for_all_axes():
    rig = Rig.from_toml(edited(("force_current = [180.0, 180.0]", "force_current = 180")))
    assert rig.bearings[0].force_current == (180.0, 180.0)


def test_other_rotors_are_read():
    assert isinstance(Rig.from_toml(with_table("rotor", MODES + SHAPES)).rotor, ModalRotor)
    matrix = np.eye(8).tolist()
    body = f'kind = "matrices"\nnode_positions = [0.0, 0.9]\nM = {matrix}\nK = {matrix}'
    rotor = Rig.from_toml(with_table("rotor", body)).rotor
    assert rotor == MatrixRotor(node_positions=np.array([0.0, 0.9]), M=np.eye(8), K=np.eye(8))


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_matrices_are_read_from_a_file_beside_the_rig(tmp_path, suffix):
    content = {"node_positions": np.array([0.0, 0.9]), "M": 2.0 * np.eye(8), "K": np.eye(8), "G": np.zeros((8, 8))}
    if suffix == ".npz":
        np.savez(tmp_path / "rotor.npz", **content)
    else:
        scipy.io.savemat(tmp_path / "rotor.mat", content)
    path = tmp_path / "rig.toml"
    path.write_text(with_table("rotor", f'kind = "matrices"\nfile = "rotor{suffix}"\nflexible_modes = 1'))
    rig = Rig.load(path)
    assert rig.rotor == MatrixRotor(flexible_modes=1, **content)
    assert Rig.from_toml(rig.to_toml()) == rig


# --- round trip, equality, copies ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rig",
    [
        levitator(),
        levitator(name='quote " slash \\ tab \t é 😀 \x7f'),
        levitator(controller=PidController(implementation="digital", proportional=0.1 + 0.2, delay_samples=1.25)),
        levitator(controller=StateSpaceController(implementation="analog", D=[[3.0]])),
        levitator(controller=StateSpaceController(implementation="analog", A=[[-1.0]], B=[[1]], C=[[2]], D=[[3]])),
        levitator(
            controller=TransferFunctionController(
                implementation="digital", numerator=[1, 2], denominator=[1, 0.5], sample_rate=4000
            )
        ),
    ],
    ids=["levitator", "odd-name", "digital-pid", "gain", "state-space", "transfer-function"],
)
def test_round_trip_is_exact(rig):
    assert Rig.from_toml(rig.to_toml()) == rig
    assert hash(Rig.from_toml(rig.to_toml())) == hash(rig)
    assert pickle.loads(pickle.dumps(rig)) == rig


def test_path_is_no_part_of_equality():
    assert Rig.load(BENCH) == Rig.from_toml(bench_text())
    assert Rig.from_toml(bench_text()).path is None


def test_replace_checks_and_leaves_the_original(golden):
    rig = Rig.load(BENCH)
    faster = rig.replace(speed=100.0)
    assert (rig.speed, faster.speed, faster.path) == (0.0, 100.0, BENCH)
    assert faster != rig
    with pytest.raises(RigError, match="speed = -1: expected 0 to 50000 rad/s"):
        rig.replace(speed=-1)
    with golden.raises(RigError):
        rig.replace(sped=1)


def test_a_rig_is_frozen():
    with pytest.raises(ValueError, match="frozen"):
        Rig.load(BENCH).speed = 3.0


# --- one thing broken at a time: edit of the bench, then key and value of the message -------------------------------

BROKEN_VALUES = [
    ("air_gap = 0.0005", "air_gap = 0.5", "bearing[0] (A).air_gap = 0.5"),
    ("air_gap = 0.0005", "air_gap = 500", "bearing[0] (A).air_gap = 500"),
    ("air_gap = 0.0005", "air_gap = 0", "bearing[0] (A).air_gap = 0"),
    ("air_gap = 0.0005", "air_gap = nan", "bearing[0] (A).air_gap = nan"),
    ("air_gap = 0.0005", "air_gap = true", "bearing[0] (A).air_gap = True"),
    ("air_gap = 0.0005", 'air_gap = "0.5 mm"', "bearing[0] (A).air_gap = '0.5 mm'"),
    ("air_gap", "airgap", "bearing[0] (A).airgap = 0.0005"),
    ("air_gap = 0.0005", "", "bearing[0] (A).air_gap is missing"),
    ("position = 0.2          # m\nsensor", "position = 0.9\nsensor", "bearing[0] (A).position = 0.9"),
    ("sensor_position = 0.72", "sensor_position = 720", "bearing[1] (B).sensor_position = 720"),
    ("bias_current = 6.0", "bias_current = 6000", "bearing[0] (A).bias_current = 6000"),
    ("bias_current = 6.0", "bias_current = -6", "bearing[0] (A).bias_current = -6"),
    ("tilt = 45.0", "tilt = 450", "bearing[0] (A).tilt = 450"),
    ("[180.0, 180.0]", "[180.0, -180.0]", "force_current[1] = -180"),
    ("[180.0, 180.0]", "[1.0, 2.0, 3.0]", "force_current = (1.0, 2.0, 3.0)"),
    ("[2200000.0, 2200000.0]", "0", "force_displacement[0] = 0"),
    ("[2200000.0, 2200000.0]", "2.2", "force_displacement = 2.2"),
    ('name = "B"', 'name = "A"', "bearing[1] (A).name = 'A'"),
    ('name = "A"', 'name = "A.1"', "bearing[0] (A.1).name = 'A.1'"),
    ("tilt = 45.0", 'axes = ["eta"]', "bearing[0] (A).axes = ('eta',)"),
    ("tilt = 45.0", 'axes = ["axial"]', "bearing[0] (A).axes[0] = 'axial'"),
    ("time_constant = 0.0002", "time_constant = 0.2", "amplifier.time_constant = 0.2"),
    ("time_constant = 0.0004", "time_constant = 0", "actuator.time_constant = 0"),
    ("sample_rate = 10000.0", "sample_rate = 0.5", "sample_rate = 0.5"),
    ("sample_rate = 10000.0", "sample_rate = inf", "sample_rate = inf"),
    ("speed = 0", "speed = -5", "speed = -5"),
    ('name = "two-bearing test bench"', "name = 3", "name = 3"),
    ("density = 7850.0", "density = 7.85", "rotor.material.density = 7.85"),
    ("2.060e+11", "206", "rotor.material.youngs_modulus = 206"),
    ("poisson_ratio = 0.3", "poisson_ratio = 3", "rotor.material.poisson_ratio = 3"),
    ("[rotor.material]", "[rotor.materal]", "rotor.materal = {"),
    ("inner_diameter = 0.0", "inner_diameter = 0.06", "rotor.section[0].inner_diameter = 0.06"),
    ("outer_diameter = 0.06", "outer_diameter = 60", "rotor.section[0].outer_diameter = 60"),
    ("length = 0.06", "length = -0.06", "rotor.section[0].length = -0.06"),
    ("mass = 2.4629207", "mass = -2.5", "rotor.disk[0].mass = -2.5"),
    ("position = 0.14  ", "position = 140  ", "rotor.disk[0].position = 140"),
    ("flexible_modes = 2", "flexible_modes = 3", "bending_frequencies_hz = (553.788, 1382.733)"),
    ("flexible_modes = 2", "flexible_modes = 2.5", "rotor.flexible_modes = 2.5"),
    ("flexible_modes = 2", "flexible_modes = -1", "rotor.flexible_modes = -1"),
    ("[553.788, 1382.733]", "[1382.733, 553.788]", "bending_frequencies_hz = (1382.733, 553.788)"),
    ("modal_damping = 0.004", "modal_damping = 4", "rotor.modal_damping = 4"),
    ("modal_damping = 0.004", "modal_damping = [0.01]", "rotor.modal_damping = (0.01,)"),
    ("[rotor]", '[rotor]\nkind = "beam"', "rotor.kind = 'beam'"),
    ('kind = "pid"', 'kind = "lqr"', "controller.kind = 'lqr'"),
    ('kind = "pid"', "", "controller.kind is missing"),
    ('implementation = "analog"', 'implementation = "dsp"', "controller.implementation = 'dsp'"),
    ('"analog"', '"analog"\ndelay_samples = 2', "controller.delay_samples = 2"),
    ('"analog"', '"analog"\nsample_rate = 20000', "controller.sample_rate = 20000"),
    ('"analog"', '"digital"\nsample_rate = 15000', "controller.sample_rate = 15000"),
    ('"analog"', '"digital"\ndelay_samples = -1', "controller.delay_samples = -1"),
    ("28000.0", "-28000.0", "controller.proportional = -28000"),
    ("28000.0", "[28000.0, 1.0]", "controller.proportional = (28000.0, 1.0)"),
    ("proportional = 28000.0", "", "controller.proportional is missing"),
    ("derivative_time_constant = 0.0001", "", "controller.derivative_time_constant is missing"),
    ("[amplifier]\ntime_constant = 0.0002", "", "amplifier is missing"),
    ("[actuator]\ntime_constant = 0.0004", "", "actuator is missing"),
]


@pytest.mark.parametrize(("old", "new", "key_and_value"), BROKEN_VALUES, ids=[key for _, _, key in BROKEN_VALUES])
def test_broken_value_is_named(tmp_path, old, new, key_and_value, golden):
    path = tmp_path / "rig.toml"
    path.write_text(edited((old, new)), encoding="utf-8")
    with golden.raises(RigError) as caught:
        Rig.load(path)
    line = next(line for line in str(caught.value).splitlines() if key_and_value in line)
    assert line.startswith(f"  {path}: ")


BROKEN_TABLES = [
    ("rotor", MASS, "bearing.axes = ['A_zeta', 'A_eta', 'B_zeta', 'B_eta']"),
    ("rotor", 'kind = "mass"\nmass = -2.0', "rotor.mass = -2.0"),
    ("rotor", MODES, "rotor.shapes is missing"),
    ("rotor", MODES + "shapes = [[1.0, 1.0, 1.0]]", "rotor.shapes = ((1.0"),
    ("rotor", MODES + SHAPES + "gyroscopic = [[1.0]]", "rotor.gyroscopic = ((1.0,),)"),
    ("rotor", (MODES + SHAPES).replace("0.86]", "0.7]"), "bearing[1] (B).sensor_position = 0.72"),
    ("rotor", (MODES + SHAPES).replace("[0, 0, 0.01]", "[0.01]"), "rotor.damping = (0.01,)"),
    ("rotor", 'kind = "matrices"\nfile = "no.npz"', "rotor.file = 'no.npz'"),
    ("rotor", 'kind = "matrices"\nfile = "M.txt"', "rotor.file = 'M.txt'"),
    ("rotor", 'kind = "matrices"\nfile = "a.npz"\nM = [[1.0]]', "rotor.file = 'a.npz'"),
    ("rotor", 'kind = "matrices"\nnode_positions = [0, 1]\nM = [[1]]\nK = [[1]]', "rotor.M = ((1.0,),)"),
    ("controller", STATE_SPACE + "D = [[1.0, 0.0], [0.0, 1.0]]", "controller.D = ((1.0, 0.0)"),
    ("controller", STATE_SPACE + "A = [[0.5]]\nB = [[1.0]]\nC = [[1, 2]]\nD = [[0]]", "controller.C = ((1"),
    ("controller", TRANSFER + "numerator = [1, 0, 0]\ndenominator = [1, 1]", "controller.numerator[0] = (1"),
    ("controller", TRANSFER + 'numerator = [1]\ndenominator = [1, "a"]', "controller.denominator[0][1] = 'a'"),
    ("controller", TRANSFER + "numerator = [1.0]\ndenominator = [0, 0]", "controller.denominator[0] = (0.0, 0.0)"),
    (
        "controller",
        TRANSFER + "numerator = [1, 1.7e304]\ndenominator = [1, 1]",
        "controller.numerator[0][1] = 1.7e+304",
    ),
    (
        "controller",
        TRANSFER + "numerator = [1, 1e90]\ndenominator = [1e-20, 1]",
        "controller.numerator[0] = (1.0, 1e+90)",
    ),
    (
        "controller",
        TRANSFER + "numerator = [1.0]\ndenominator = [[1, 1], [1, 2]]",
        "controller.denominator = ((1.0, 1.0), (1.0, 2.0))",
    ),
]


@pytest.mark.parametrize(("table", "body", "key_and_value"), BROKEN_TABLES, ids=[key for _, _, key in BROKEN_TABLES])
def test_broken_table_is_named(table, body, key_and_value, golden):
    with golden.raises(RigError) as caught:
        Rig.from_toml(with_table(table, body))
    assert key_and_value in str(caught.value)


OF_HDF5 = b"MATLAB 7.3 MAT-file".ljust(124) + bytes([0, 2]) + b"IM" + bytes(384)


@pytest.mark.parametrize("name", ["rotor.npz", "rotor.mat"])
@pytest.mark.parametrize(
    "content", [b"junk", b"PK\x03\x04junk", b"", OF_HDF5], ids=["text", "half-zip", "empty", "version 7.3"]
)
def test_a_matrix_file_that_is_none(tmp_path, name, content, golden):
    (tmp_path / name).write_bytes(content)
    with golden.raises(RigError):
        Rig.from_toml(with_table("rotor", f'kind = "matrices"\nfile = "{name}"'), tmp_path / "rig.toml")


def test_matrices_must_be_symmetric_and_positive(golden):
    skewed = np.eye(8)
    skewed[0, 4] = 0.5
    with golden.raises(RigError):
        MatrixRotor(node_positions=[0, 1], M=np.eye(8), K=skewed)
    with golden.raises(RigError):
        MatrixRotor(node_positions=[0, 1], M=np.diag([1.0] * 7 + [0.0]), K=np.eye(8))


def test_all_problems_are_told_at_once(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(edited(("air_gap = 0.0005", "air_gap = 0.5"), ("7850.0", "7.85"), ("[actuator]", "[actuatr]")))
    with pytest.raises(RigError) as caught:
        Rig.load(path)
    first, *rest = str(caught.value).splitlines()
    assert first.startswith(f"{path}: 4 ")
    keys = [line.removeprefix(f"  {path}: ").split()[0] for line in rest]
    assert keys == ["rotor.material.density", "bearing[0]", "actuator", "actuatr"]


NO_RIGS = {
    "absent": None,
    "syntax": b"name = \n",
    "csv": b"t,i_e.A_zeta\n0,1\n",
    "binary": b"MATLAB \xff\xfe\x00",
    "empty": b"",
}


@pytest.mark.parametrize("name", NO_RIGS)
def test_not_a_rig_file(tmp_path, name, golden):
    path = tmp_path / "rig.toml"
    if NO_RIGS[name] is not None:
        path.write_bytes(NO_RIGS[name])
    with golden.raises(RigError):
        Rig.load(path)


def test_a_folder_is_not_a_rig_file(tmp_path, golden):
    with golden.raises(RigError):
        Rig.load(tmp_path)


def test_errors_on_construction_from_python(golden):
    with golden.raises(RigError):
        Section(length=60, outer_diameter=0.05)
    with golden.raises(RigError):
        levitator(bearings=[levitator().bearings[0].model_copy(update={"axes": ("zeta", "eta")})])
