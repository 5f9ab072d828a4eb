"""Functional mock-up units do in FMPy what the simulator in Python does."""

import zipfile

import numpy as np
import pytest

import ambid
from ambid.embedded.unit import LIBRARIES, NATIVE
from ambid.errors import ModelError
from embedded.agreement import require_equal
from validated import of_peak

fmpy = pytest.importorskip("fmpy")
pytest.importorskip("fmpy.validation")
pytestmark = pytest.mark.skipif(not (NATIVE / LIBRARIES["linux"]).is_file(), reason="no native library")


@pytest.fixture(scope="module", params=[2, 3])
def unit(request, model, tmp_path_factory):
    path = tmp_path_factory.mktemp("units") / f"model {request.param}.fmu"
    ambid.to_fmu(model, path, fmi=request.param)
    return path


class Slave:
    """An instance of a unit in FMPy, ready to step."""

    def __init__(self, unit, folder, name="one", **parameters):
        self.description = fmpy.read_model_description(unit)
        self.version = int(self.description.fmiVersion[0])
        fmpy.extract(unit, folder)
        self.messages = []
        self.fmu = fmpy.instantiate_fmu(folder, self.description, "CoSimulation", logger=self._log)
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}
        self.begin(**parameters)

    def _log(self, *shown):
        self.messages.append(shown[-1].decode())

    def begin(self, **parameters):
        for name, value in parameters.items():
            self.set([name], [value])
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, names):
        references = [self.reference[name] for name in names]
        return self.fmu.getReal(references) if self.version == 2 else self.fmu.getFloat64(references)

    def set(self, names, values):
        references = [self.reference[name] for name in names]
        (self.fmu.setReal if self.version == 2 else self.fmu.setFloat64)(references, list(values))

    def run(self, model, u, outputs=None):
        rows = []
        for k, row in enumerate(u.tolist()):
            self.set(model.loop.inputs, row)
            rows.append(self.get(outputs or model.loop.outputs))
            self.fmu.doStep(k * model.loop.sample_time, model.loop.sample_time)
        return np.array(rows)


@pytest.fixture
def slave(unit, tmp_path):
    own = Slave(unit, tmp_path)
    yield own
    own.fmu.terminate()
    own.fmu.freeInstance()


def test_fmpy_finds_nothing_wrong(unit):
    assert fmpy.validation.validate_fmu(str(unit)) == []


def test_fmpy_simulates_it_as_python_does(unit, model, excitation, validated):
    dt, names = model.loop.sample_time, model.loop.inputs
    rows = [(k * dt, *row) for k, row in enumerate(excitation.tolist())]
    given = np.array(rows, dtype=[(name, float) for name in ("time", *names)])
    stop = (len(rows) - 1) * dt
    found = fmpy.simulate_fmu(
        str(unit), stop_time=stop, output_interval=dt, input=given, output=list(model.loop.outputs)
    )
    columns = np.column_stack([found[name] for name in model.loop.outputs])
    validated(
        "Functional mock-up units (FMI 2.0 and 3.0), linear, digital and nonlinear: error relative to the peak",
        "the simulator in Python, units run by FMPy {fmpy}",
        of_peak(columns, model.simulator().run(excitation)),
        1e-12,
    )


def test_each_step_is_that_of_python_and_a_reset_one_begins_again(slave, model, excitation):
    expected = model.simulator().run(excitation)
    require_equal(slave.run(model, excitation), expected)
    slave.fmu.reset()
    slave.begin()
    require_equal(slave.run(model, excitation), expected)


def test_instances_do_not_know_of_each_other(unit, model, excitation, tmp_path):
    slaves = [Slave(unit, tmp_path / str(k)) for k in range(3)]
    expected = model.simulator().run(excitation)
    slaves[0].run(model, 0.1 * excitation[:50])
    require_equal(slaves[1].run(model, excitation), expected)
    slaves[0].fmu.freeInstance()
    require_equal(slaves[2].run(model, excitation), expected)


def test_parameters_may_be_set_until_the_initialization_ends(unit, model, excitation, tmp_path):
    name = "K_i.A_zeta"
    value = 1.05 * dict(zip(model.names, model.theta, strict=True))[name]
    own = Slave(unit, tmp_path, **{name: value})
    assert own.get([name]) == [value]
    require_equal(own.run(model, excitation), model.with_values({name: value}).simulator().run(excitation))
    with pytest.raises(Exception, match="fail"):
        own.set([name], [value])
    assert name in own.messages[-1]


def test_a_step_holds_its_inputs_over_whole_samples(slave, model, excitation):
    dt = model.loop.sample_time
    slave.set(model.loop.inputs, excitation[0])
    slave.fmu.doStep(0.0, 3.0 * dt)
    held = np.repeat(excitation[:1], 4, axis=0)
    require_equal(np.array([slave.get(model.loop.outputs)]), model.simulator().run(held)[3:])
    with pytest.raises(Exception, match="fail"):
        slave.fmu.doStep(3.0 * dt, 2.5 * dt)
    assert f"{dt:g} s" in slave.messages[-1]


def test_a_description_of_another_model_is_refused(unit, tmp_path):
    changed = tmp_path / "changed.fmu"
    with zipfile.ZipFile(unit) as old, zipfile.ZipFile(changed, "w") as new:
        for part in old.namelist():
            content = old.read(part)
            if part == "resources/model.stepper":
                content = content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]
            new.writestr(part, content)
    with pytest.raises(Exception, match="instantiate"):
        Slave(changed, tmp_path / "folder")


def test_equal_models_are_equal_units(unit, model, tmp_path):
    again = tmp_path / "again.fmu"
    ambid.to_fmu(model, again, fmi=int(unit.stem[-1]))
    assert again.read_bytes() == unit.read_bytes()


@pytest.mark.parametrize(("name", "fmi"), [("unit.zip", 2), ("unit.fmu", 1)])
def test_what_no_unit_has_is_told(saturating, tmp_path, name, fmi, golden):
    with golden.raises(ModelError):
        ambid.to_fmu(saturating, tmp_path / name, fmi=fmi)
