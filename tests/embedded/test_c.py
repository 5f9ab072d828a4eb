"""The stepper in C steps as the simulator in Python does."""

import re
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
from validated import of_peak

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
    return compiled(EXAMPLE, tmp_path_factory.mktemp("c") / "step")


def compiled(source, own):
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc")
    options = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-I", HEADER, source, LIBRARY, "-o", own]
    subprocess.run([compiler, *map(str, options), f"-Wl,-rpath,{LIBRARY.parent}"], check=True)
    return own


@native
def test_the_example_in_c_steps_as_python_does(model, excitation, program, tmp_path, validated):
    ambid.to_stepper(model, tmp_path / "model.stepper")
    text = "\n".join(" ".join(map(repr, row)) for row in excitation.tolist())
    done = subprocess.run([program, tmp_path / "model.stepper"], input=text, capture_output=True, text=True, check=True)
    assert done.stderr.split()[: len(model.loop.outputs)] == list(model.loop.outputs)
    found = np.array([row.split() for row in done.stdout.splitlines()], dtype=float)
    validated(
        "Stepper in C, linear, digital and nonlinear: error relative to the peak",
        "the simulator in Python, program compiled by gcc",
        of_peak(found, model.simulator().run(excitation)),
        1e-12,
    )


@native
def test_valgrind_finds_no_error_and_no_byte_that_is_not_given_back(program, digital, tmp_path):
    """Of a loop with a digital controller; what it reports falsely of others stands in the documents."""
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        pytest.skip("there is no valgrind on this machine: apt-get install valgrind")
    ambid.to_stepper(digital, tmp_path / "model.stepper")
    asked = ["--leak-check=full", "--show-leak-kinds=all", "--errors-for-leak-kinds=all", "--error-exitcode=9"]
    run = [valgrind, *asked, program, tmp_path / "model.stepper"]
    done = subprocess.run(run, input="0.1\n" * 50, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "ERROR SUMMARY: 0 errors" in done.stderr
    assert len(done.stdout.splitlines()) == 50


@native
def test_what_the_page_shows_runs(demo_rig, tmp_path):
    page = (ROOT / "python" / "docs" / "embedded.md").read_text()
    (shown,) = re.findall(r"^```c\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    include, rest = shown.split("\n", 1)
    say = 'for (int k = 0; k < 8; k++) printf("%.17g ", y_and_i_c[k]);'
    source = tmp_path / "shown.c"
    source.write_text(f"#include <stdio.h>\n{include}\nint main(void) {{\n{rest}{say}\nreturn 0;\n}}\n")
    ambid.to_stepper(ambid.Model(demo_rig), tmp_path / "model.stepper")
    own = compiled(source, tmp_path / "shown")
    done = subprocess.run([own], cwd=tmp_path, capture_output=True, text=True, check=True)
    i_e = np.array([[0.1, 0.0, 0.0, 0.0]])
    require_equal(np.array([done.stdout.split()], dtype=float), ambid.Model(demo_rig).simulator().run(i_e))


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
    assert content.startswith(b"ambid stepper 4\n")


def test_a_loop_too_large_to_step_is_refused(saturating, tmp_path, golden):
    with golden.raises(ModelError):
        ambid.to_stepper(saturating.with_substeps(100_000), tmp_path / "large")
    assert not Path(tmp_path / "large").exists()
