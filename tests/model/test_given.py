"""A model, a rig or the path of the file of either: what a script has at hand."""

import numpy as np
import pytest

import ambid
from ambid.errors import ModelError, RigError
from ambid.model import as_model
from hidden.one_axis import ONE_AXIS, record


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("given")
    rig, run = ONE_AXIS.rig, record({}, 5)
    rig.save(folder / "rig.toml")
    run.save(folder / "train.mat")
    ambid.Model(rig).with_values({"tau_e": 2.9e-4}).save(folder / "model.json")
    return folder


def test_paths_stand_for_what_they_hold(files):
    rig, path = str(files / "rig.toml"), files / "train.mat"
    loaded = ambid.Rig.load(rig)
    assert ambid.compare(rig, path).misfit == ambid.compare(loaded, ambid.Record.load(path, loaded)).misfit
    np.testing.assert_array_equal(as_model(files / "rig.toml").theta, ambid.Model(loaded).theta)
    saved = as_model(files / "model.json")
    assert dict(zip(saved.names, saved.theta, strict=True))["tau_e"] == 2.9e-4
    found, *_ = ambid.identify_many(rig, [path], free="K_i").values
    wanted = [ambid.identify(rig, path, free="K_i")[name].value for name in loaded_names(rig)]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
    assert ambid.check(rig, path).findings == ambid.check(loaded, path).findings
    assert ambid.margins(rig).zone == ambid.margins(ambid.Model(loaded)).zone


def loaded_names(rig):
    return [name for name in as_model(rig).names if name.startswith("K_i.")]


@pytest.mark.parametrize("call", [ambid.identify, ambid.compare, ambid.diagnose])
def test_what_is_none_of_them_is_named(call, files, golden):
    with golden.raises(ModelError):
        call(3, files / "train.mat")
    with golden.raises(RigError):
        call(files / "train.mat", files / "rig.toml")


def test_a_model_is_made_of_a_rig(files, golden):
    with golden.raises(ModelError):
        ambid.Model(str(files / "rig.toml"))
    with golden.raises(RigError):
        ambid.check(3)
    with golden.raises(RigError):
        ambid.static_load(3, [])
