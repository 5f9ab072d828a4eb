"""The healthy files that the fuzzer starts from: small, so that thousands of runs take minutes."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pyuff
import scipy.io

import ambid
from ambid.demo import DATA

LEVITATOR = Path(__file__).parents[1] / "data" / "levitator.toml"
SUFFIXES = (".csv", ".mat", ".h5", ".parquet", ".tdms")
RESPONSES = ("response.csv", "response.mat", "response.uff")
"""Frequency responses of the record."""
CONTROLLERS = {
    "filter.toml": """
kind = "transfer_function"
implementation = "analog"
numerator = [60.0, 17000.0, 300000.0]
denominator = [1.0e-4, 1.0, 0.0]
""",
    "matrices.toml": """
kind = "state_space"
implementation = "digital"
delay_samples = 0.5
A = [[1.0, 0.0], [0.0, 0.3]]
B = [[30.0], [1.0]]
C = [[1.0, -150000.0]]
D = [[230000.0]]
""",
}
"""Of the same levitator."""
MODES = """
[rotor]
kind = "modes"
frequencies_hz = [0.0, 0.0, 180.0]
damping = [0.0, 0.0, 0.004]
positions = [0.14, 0.2, 0.66, 0.72]
shapes = [[0.3, 0.3, 0.3, 0.3], [0.5, 0.2, -0.2, -0.5], [0.5, -0.2, -0.2, 0.5]]
"""


def healthy(folder: Path) -> None:
    """Write one of each: rigs, records and responses in every format, a model, a loading, a campaign, rows of runs."""
    folder.mkdir(parents=True)
    shutil.copy(LEVITATOR, folder / "rig.toml")
    text = LEVITATOR.read_text()
    for name, controller in CONTROLLERS.items():
        (folder / name).write_text(f"{text.partition('[controller]')[0]}[controller]\n{controller}")
    bench = (DATA / "rig.toml").read_text()
    (folder / "bench.toml").write_text(bench)
    head, _, rest = bench.partition("[rotor]")
    (folder / "modes.toml").write_text(f"{head}{MODES}\n{rest[rest.index('[[bearing]]') :]}")
    rig = ambid.Rig.load(folder / "rig.toml")
    model = ambid.Model(rig)
    excitation = ambid.prbs(6, amplitude=0.3, hold=2, axes=1, periods=5)
    record = model.virtual_experiment(excitation, seed=1)
    for suffix in SUFFIXES:
        record.save(folder / f"run{suffix}")
    _responses(folder, record)
    (folder / "rows.parquet").mkdir()
    (folder / "rows.parquet" / "_plan.json").write_text("{}\n")
    with h5py.File(folder / "run73.mat", "w", userblock_size=512) as file:
        file["fs"], file["y"], file["i_e"], file["i_c"] = 1e4, record.y.T, record.i_e.T, record.i_c.T
    with (folder / "run73.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    model.add("loop_delay", {"delay": 2e-5}).save(folder / "model.json", np.diag([1.0, 1e6, 1e-9, 1e-12]))
    shutil.copy(DATA / "static_1.csv", folder / "load.csv")
    (folder / "bench_run" / "6A").mkdir(parents=True)
    shutil.copy(folder / "rig.toml", folder / "bench_run" / "6A" / "rig.toml")
    held = {k: v for k, v in scipy.io.loadmat(folder / "run.mat").items() if not k.startswith("__")}
    scipy.io.savemat(folder / "open.mat", held)
    shutil.copy(folder / "open.mat", folder / "bench_run" / "6A" / "prbs_1.mat")


def _responses(folder: Path, record: ambid.Record) -> None:
    own = record.frequency_response()
    for name in RESPONSES[:2]:
        own.save(folder / name)
    pyuff.UFF(str(folder / "response.uff")).write_sets(
        pyuff.prepare_58(
            binary=0,
            func_type=4,
            abscissa_spacing=1,
            abscissa_spec_data_type=18,
            ordinate_spec_data_type=8,
            orddenom_spec_data_type=13,
            rsp_node=1,
            rsp_dir=1,
            ref_node=2,
            ref_dir=1,
            rsp_ent_name="y.A_zeta",
            ref_ent_name="i_e.A_zeta",
            data=own.response[:, own.outputs.index("y.A_zeta"), own.inputs.index("i_e.A_zeta")],
            x=own.frequency_hz,
            id1="",
            id2="",
            id3="",
            id4="",
            id5="",
            ord_data_type=5,
        ),
        "overwrite",
    )
