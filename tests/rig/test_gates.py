"""Slips of a rig file that were once taken in silence, or reported under another key."""

import numpy as np
import pytest

import ambid
from ambid.errors import RigError
from ambid.rig import MatrixRotor, ModalRotor, Rig, StateSpaceController
from ambid.rig.parts import Disk
from ambid.rig.rotor import off_the_shaft
from places import BENCH

MODES = {"frequencies_hz": [0, 0, 550.0], "damping": [0, 0, 0.01], "positions": [0.14, 0.2, 0.66, 0.72]}
SHAPES = [[0.12] * 4, [-0.157, -0.124, 0.124, 0.157], [0.106, 0.025, 0.025, 0.106]]


def lines_of(error) -> list[str]:
    return str(error.value).splitlines()[1:]


@pytest.mark.parametrize("value", ['"yes"', '"no"', '"off"', "1", "0", "1.0"])
@pytest.mark.parametrize("key", ["controller.reference", "actuator.has_lag"])
def test_only_true_and_false_are_truths(key, value):
    table, name = key.split(".")
    with pytest.raises(RigError) as error:
        Rig.from_toml(BENCH.read_text().replace(f"[{table}]", f"[{table}]\n{name} = {value}"))
    (line,) = lines_of(error)
    assert all(word in line for word in (f"{key} = ", "true", "false"))


def test_true_is_still_read():
    text = BENCH.read_text().replace("[controller]", "[controller]\nreference = true")
    assert Rig.from_toml(text).controller.reference is True


def test_a_disk_with_more_polar_inertia_than_any_body_is_named(golden):
    with golden.raises(RigError):
        Disk(position=0.1, mass=2.0, transverse_inertia=0.02, polar_inertia=0.0421)
    assert Disk(position=0.1, mass=2.0, transverse_inertia=0.02, polar_inertia=0.04).polar_inertia == 0.04
    assert Disk(position=0.1, mass=2.0, transverse_inertia=0.0, polar_inertia=0.0).mass == 2.0


def two_lumps(polar: float, transverse: float = 0.01) -> dict[str, np.ndarray]:
    """Two rigid disks on a shaft without mass, as matrices."""
    M = np.diag([2.0, 2.0, transverse, transverse] * 2)
    G = np.zeros((8, 8))
    for k in (0, 4):
        G[k + 2, k + 3], G[k + 3, k + 2] = polar, -polar
    return {"node_positions": np.array([0.0, 0.02]), "M": M, "K": np.zeros((8, 8)), "G": G}


def test_matrices_with_more_polar_inertia_than_any_body_are_named(golden):
    """About the centre of mass both lumps have 0.02 + 2 * 2 * 0.01^2 kg m^2 across."""
    assert MatrixRotor(**two_lumps(0.02)).G is not None
    with golden.raises(RigError):
        MatrixRotor(**two_lumps(0.02 * 105.0))


def test_modes_with_more_polar_inertia_than_any_body_are_named(golden):
    G = np.zeros((3, 3))
    G[1, 1] = 1.9
    assert ModalRotor(**MODES, shapes=SHAPES, gyroscopic=G).gyroscopic is not None
    G[1, 1] = 2.3
    with golden.raises(RigError):
        ModalRotor(**MODES, shapes=SHAPES, gyroscopic=G)


@pytest.mark.parametrize("speed", [0.0, 100.0])
@pytest.mark.parametrize("has_own", [False, True])
def test_a_turning_rotor_without_gyroscopic_moments_is_told(speed, has_own):
    own = {"gyroscopic": 0.01 * np.eye(3)} if has_own else {}
    rig = Rig.load(BENCH).replace(rotor=ModalRotor(**MODES, shapes=SHAPES, **own), speed=speed)
    shown = [finding for finding in ambid.check(rig).findings if finding.where.key == "rotor.gyroscopic"]
    assert len(shown) == (speed > 0.0 and not has_own)
    for finding in shown:
        assert (finding.code, finding.severity) == ("gyroscopic_matrix_missing", "note")


@pytest.mark.parametrize("position", [0.8, 2.0, 140.0, -0.1])
def test_only_a_position_far_off_the_shaft_looks_like_millimetres(position, golden):
    shown = off_the_shaft((0.0, 0.7), position)
    golden.holds(shown)
    assert ("millimetres" in shown) == (position == 140.0)


TWO = {"A": [[0.5, 0.0], [0.0, 0.2]], "B": [[1.0], [1.0]], "C": [[1.0, 2.0]], "D": [[3.0]]}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("A", [[0.5, 0.0]]),
        ("A", [[0.5]]),
        ("A", [[0.5, 0.0], [0.0]]),
        ("B", [[1.0]]),
        ("C", [[1.0]]),
        ("D", [[3.0, 1.0]]),
        ("D", [[3.0], [1.0]]),
    ],
    ids=str,
)
def test_one_matrix_of_a_wrong_shape_is_the_one_that_is_named(key, value, golden):
    with golden.raises(RigError) as error:
        StateSpaceController(implementation="digital", **(TWO | {key: value}))
    (line,) = lines_of(error)
    assert f": {key} = " in line
