"""The stepper in C steps as the simulator in Python does."""

import shutil
import subprocess
from ctypes import CDLL, POINTER, byref, c_char_p, c_double, c_size_t, c_void_p
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.embedded.unit import LIBRARIES, NATIVE
from ambid.errors import ModelError
from embedded.agreement import require_equal
from places import ROOT

LIBRARY = NATIVE / LIBRARIES["linux"]
EXAMPLE = ROOT / "rust" / "c" / "examples" / "step.c"
HEADER = ROOT / "rust" / "c" / "include"
OK, NULL, FILE, FORMAT, SIZE, NOT_FINITE = range(6)

native = pytest.mark.skipif(not LIBRARY.is_file(), reason=f"no {LIBRARY}")


@pytest.fixture(scope="module")
def library():
    found = CDLL(str(LIBRARY))
    found.ambid_load.argtypes = [c_char_p, POINTER(c_void_p)]
    found.ambid_load_bytes.argtypes = [c_char_p, c_size_t, POINTER(c_void_p)]
    found.ambid_step.argtypes = [c_void_p, POINTER(c_double), c_size_t, POINTER(c_double), c_size_t]
    found.ambid_reset.argtypes = found.ambid_free.argtypes = found.ambid_inputs.argtypes = [c_void_p]
    found.ambid_error.restype = c_char_p
    return found


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The example, compiled."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc")
    own = tmp_path_factory.mktemp("c") / "step"
    options = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-I", HEADER, EXAMPLE, LIBRARY, "-o", own]
    subprocess.run([compiler, *map(str, options), f"-Wl,-rpath,{LIBRARY.parent}"], check=True)
    return own


@native
def test_the_example_in_c_steps_as_python_does(model, excitation, program, tmp_path):
    ambid.to_stepper(model, tmp_path / "model.stepper")
    text = "\n".join(" ".join(map(repr, row)) for row in excitation.tolist())
    done = subprocess.run([program, tmp_path / "model.stepper"], input=text, capture_output=True, text=True, check=True)
    assert done.stderr.split()[: len(model.loop.outputs)] == list(model.loop.outputs)
    found = np.array([row.split() for row in done.stdout.splitlines()], dtype=float)
    require_equal(found, model.simulator().run(excitation))


@native
def test_what_is_wrong_is_a_status_with_words(saturating, library, tmp_path):
    path, handle = tmp_path / "model.stepper", c_void_p()
    ambid.to_stepper(saturating, path)
    content = path.read_bytes()
    u, y = (c_double * 4)(), (c_double * 8)()
    assert library.ambid_load(None, byref(handle)) == NULL
    assert library.ambid_load(bytes(path), None) == NULL
    assert library.ambid_load(b"/nowhere/model.stepper", byref(handle)) == FILE
    assert b"/nowhere/model.stepper: cannot be read" in library.ambid_error()
    assert library.ambid_load_bytes(content[:-1], len(content) - 1, byref(handle)) == FORMAT
    assert b"checksum" in library.ambid_error()
    assert handle.value is None
    assert library.ambid_step(None, u, 4, y, 8) == NULL
    assert library.ambid_reset(None) == NULL
    assert library.ambid_inputs(None) == 0
    library.ambid_free(None)
    assert library.ambid_load(bytes(path), byref(handle)) == OK
    assert library.ambid_step(handle, u, 3, y, 8) == SIZE
    assert library.ambid_step(handle, None, 4, y, 8) == NULL
    u[1] = np.nan
    assert library.ambid_step(handle, u, 4, y, 8) == NOT_FINITE
    u[1] = 0.0
    assert library.ambid_step(handle, u, 4, y, 8) == OK
    library.ambid_free(handle)


def test_equal_models_are_equal_files(saturating, tmp_path):
    for name in ("one", "two"):
        ambid.to_stepper(saturating, tmp_path / name)
    content = (tmp_path / "one").read_bytes()
    assert content == (tmp_path / "two").read_bytes()
    assert content.startswith(b"ambid stepper 1\n")


def test_a_loop_too_large_to_step_is_refused(saturating, tmp_path):
    with pytest.raises(ModelError, match="more states or steps"):
        ambid.to_stepper(saturating.with_substeps(100_000), tmp_path / "large")
    assert not Path(tmp_path / "large").exists()
