"""Tables of static loading: what is read of them, and what is refused."""

import numpy as np
import pytest

from ambid.errors import RecordError
from ambid.record import StaticLoading
from found import codes
from reference.records import AXES, RIG

LOADS = """step,z,F_x,F_y,i_c.A_zeta,i_c.A_eta,i_c.B_zeta,i_c.B_eta
0,0.43,0,0,0.01,0.02,0.01,0
1,0.43,250,0,-0.4,0.4,-0.3,0.3
2,0.43,500,1,-0.8,0.8,-0.6,0.6
3,0.43,0,250,-0.4,-0.4,-0.3,-0.3
"""


def test_static_loading(tmp_path, golden):
    path = tmp_path / "static_1.csv"
    path.write_text(LOADS)
    loads = StaticLoading.load(path, RIG)
    assert (loads.name, loads.axes, loads.i_c.shape, loads.findings) == ("static_1", AXES, (4, 4), ())
    np.testing.assert_array_equal(loads.force[2], [500, 1])
    golden.holds(repr(loads))
    path.write_text(LOADS.replace("i_c.A_zeta,i_c.A_eta", "i_c.A_eta,i_c.A_zeta"))
    swapped = StaticLoading.load(path, RIG)
    np.testing.assert_array_equal(swapped.i_c[:, [1, 0, 2, 3]], loads.i_c)
    assert codes(swapped) == ["axes_reordered"]
    assert StaticLoading.load(path).axes[0] == "A_eta"


BROKEN = {
    "no F_x": ("F_x", "Fx"),
    "no i_c": ("i_c.", "i."),
    "another axis": ("i_c.B_eta", "i_c.C_eta"),
    "NaN": ("500", "nan"),
    "z in mm": ("0.43", "430"),
    "mA": ("-0.8", "-800"),
    "a letter": ("0.02", "a"),
    "two steps": ("1,0.43,250,0,-0.4,0.4,-0.3,0.3\n2,0.43,500,1,-0.8,0.8,-0.6,0.6\n", ""),
    "empty": (LOADS, ""),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_static_loading(tmp_path, name, golden):
    path = tmp_path / "static_1.csv"
    path.write_text(LOADS.replace(*BROKEN[name]))
    with golden.raises(RecordError):
        StaticLoading.load(path, RIG)


def test_static_loading_needs_a_change_of_load(tmp_path, golden):
    path = tmp_path / "s.csv"
    path.write_text("step,z,F_x,F_y,i_c.A_zeta\n0,0.4,9,9,0.1\n1,0.4,9,9,0.2\n2,0.4,9,9,0.3\n")
    with golden.raises(RecordError):
        StaticLoading.load(path)
    with golden.raises(RecordError):
        StaticLoading.load(tmp_path / "s.mat")
