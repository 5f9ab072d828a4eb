"""Every command of the command line: the words it needs, and its options with values that are fine, odd or at a bound.

`test_every_option_of_the_command_line_is_tried` holds this against the command line.
"""

from dataclasses import dataclass

from fuzz import mutations

Options = dict[str, tuple[str, ...]]

JSON = ("--json", "out.json")
ODD = (
    *mutations.NUMBERS,
    *mutations.WORDS,
    "y.A_zeta=2",
    "K_i",
    "K_i.*",
    "tau_e=1e-4",
    "a=b:c",
    "[",
    "*",
    "0x10",
    "1_0",
    "٣",
    "-",
)


@dataclass(frozen=True)
class Command:
    """A command of the command line.

    Attributes
    ----------
    words : tuple of str
        Arguments and options that it needs; ``RECORD`` stands for a record of any format.
    options : dict
        Values by option; none for a flag, and those of ``""`` are further arguments.
    last : tuple of str
        Options that no other may replace.
    often : int
        How often it is tried, against the others; the dear ones seldom.
    """

    words: tuple[str, ...]
    options: Options
    last: tuple[str, ...] = JSON
    often: int = 8


QUIET: Options = {"--quiet": ()}
FORCE: Options = {"--force": ()}
SEED: Options = {"--seed": ("-1", "0", "1", "18446744073709551616")}
MODEL: Options = {"--model": ("model.json", "model.json", "rig.toml", "none.json", "run.csv", "")}
BEFORE: Options = {"--before": MODEL["--model"]}
PLOT: Options = {
    "--plot": ("out.svg", "out.png", "out.xyz", "out", "none/out.svg", "rig.toml", "out.json", "/dev/full")
}
SAVE: Options = {
    "--save": ("saved.json", "model.json", "rig.toml", "out.json", "none/x.json", ".", "/dev/full", ""),
    "--save-rig": ("new.toml", "new.toml", "rig.toml", "new.json", "out.json", "none/x.toml", ".", "/dev/full", ""),
}
MEND: Options = {"--mend": ("mended.csv", "mended.mat", "mended.xyz", "run.csv", "rig.toml", "none/x.csv", "", ".")}
EXACT: Options = {"--exact": ()}
READ: Options = {
    "--period": ("1", "3", "4", "5", "126", "126", "630", "-1", "315", "252", "100"),
    "--map": (
        "y.A_zeta=2",
        "y.A_zeta=y.A_zeta:1e300",
        "t=1:nan",
        "y.=1",
        "y.A_zeta=3:1e-320",
        "fs=2",
        "i_e.A_zeta=2:1e-3",
        "i_e.A_zeta=1:inf",
    ),
    "--sample-rate": ("1e4", "1e4", "10001", "-1", "1e-300", "1e300", "inf"),
}
RECORDS: Options = READ | {
    "": ("run.csv", "rig.toml", "bench.toml", "response.csv", "response.mat", "response.uff", "load.csv", "none.csv"),
}
ALLOW: Options = {"--allow": ("travel", "current", "x", "")}
VALIDATE: Options = {"--validate": ("run.csv", "run.csv", "rig.toml", "response.csv", "none.csv", "load.csv")}
LIMITS: Options = {
    "--travel": ("0.1", "1", "0", "-1", "nan", "1e300"),
    "--current": ("0.5", "1", "0", "-1", "nan", "1e-300"),
    "--slew-rate": ("1e4", "0", "-1", "inf", "1e-300"),
    "--full-scale": ("1", "0.01", "nan", "inf", "1e300"),
}
EXPERIMENT: Options = SEED | {
    "--channel": ("b.A_zeta:1e-3", "b", "b:1e-3", "y:1", "x", "b.A_zeta:nan", "u:-1", "f:inf", ""),
    "--seconds": ("0.05", "0.1", "nan", "inf", "-1", "1e300"),
    "--amplitude": ("1e300", "1e-300", "0", "nan", "-1", "1e8"),
    "--effect": (
        "loop_delay",
        "loop_delay:delay=1",
        "loop_delay:delay=nan",
        "sensor_lag:time_constant=1e300",
        "x:y=z",
        "flux_saturation",
    ),
    "--sensor-noise": ("1e300", "nan", "-1", "inf"),
    "--current-noise": ("1e300", "nan", "-1", "inf"),
}
OF_IDENTIFY: Options = SEED | {
    "--free": ("K_i", "tau_e", "K_i,K_s", ",", "*"),
    "--fix": ("tau_e", "tau_e=1e-4", "tau_e=1e300", "K_s.A_zeta=1e-300", "K_i.A_zeta=inf"),
    "--share": ("K=K_i.*", "x=K_i.A_zeta", "=", "tau_e=K_i"),
    "--per-axis": ("tau_e", "K_i"),
    "--bound": (
        "tau_e=1e-4:1e-3",
        "tau_e=nan:1",
        "tau_e=-inf:inf",
        "K_i=0:1e308",
        "K_i.A_zeta=180:180",
        "tau_e=0:5e-324",
    ),
    "--weight": ("eq9", "y=1e300", "i_c=0", "y=1e-300", "y=inf", "y=nan", "i_c=1e308"),
    "--starts": ("2", "0", "-1", "5"),
    "--max-evaluations": ("1", "0", "3", "-1"),
}
OF_DIAGNOSE: Options = {
    "--effects": ("loop_delay", "", ",", "x", "loop_delay,sensor_lag", "loop_delay,loop_delay"),
    "--ask": (),
    "--prior": ("loop_delay=0.5", "loop_delay=0", "loop_delay=1", "x=0.1", "loop_delay", "loop_delay=nan", ""),
    "--tolerance": ("1", "0", "nan", "inf", "1e300"),
    "--report": ("out.html", "out.htm", "out.pdf", "out", "rig.toml", "out.json", "/dev/full"),
    "--pdf": ("out.pdf", "out.pdf", "out.html", "none/out.pdf", "out.json", "/dev/full"),
    "--next": (),
}
OF_EXCITATION: Options = SEED | {
    "--out": ("played.wav", "played.mat", "run.csv", "rig.toml", "out.json", "none/x.csv", "x", "/dev/full"),
    "--signal": ("prbs", "multisine", "multisine", "x"),
    "--amplitude": EXPERIMENT["--amplitude"],
    "--periods": ("1", "2", "0", "-1", "1000000", "1000000000"),
    "--order": ("5", "15", "2", "0", "-1", "20", "64", "1000"),
    "--hold": ("1", "5", "0", "-1", "1000000"),
    "--period": ("64", "1000", "1", "0", "-1", "1000000000"),
    "--band": ("5:1500", "0:0", "-1:1", "5000:10000", "nan:1", "1e-300:1e300", "1", ":"),
    "--axes": ("A_zeta", "x", ",", "A_zeta,A_zeta", ""),
}
OF_DESIGN: Options = {
    "--channel": ("b.A_zeta:1e-3", "b", "b:1e-3", "y:1", "x", "b.A_zeta:nan", "u:-1", "f:inf", ""),
    "--record": ("run.csv", "run.csv", "response.csv", "load.csv", "none.csv", "rig.toml"),
    "--accuracy": ("K_i=1%", "tau_e=2e-6", "K_i=0", "K_i=nan", "K_i=1e-300", "K_s=1e300", "x=1", "K_i=%"),
    "--effect": ("loop_delay", "sensor_lag", "flux_saturation", "x", ""),
    "--apart": (
        "loop_delay:delay=1e-4",
        "sensor_lag:time_constant=1e-4",
        "loop_delay",
        "loop_delay:delay=nan",
        "x:y=1",
    ),
    "--seconds": ("0.5", "5", "0", "nan", "-1", "3600", "3601", "1e-300"),
    "--signal": ("prbs", "multisine", "x"),
    "--sensor-noise": EXPERIMENT["--sensor-noise"],
    "--current-noise": EXPERIMENT["--current-noise"],
    "--without-currents": (),
    "--spread": ("0", "0.05", "1", "-1", "nan", "1e-300"),
    "--peak": ("0.1", "10", "0", "-1", "nan", "1e-300", "1e300"),
    "--out": OF_EXCITATION["--out"],
}
OF_MONTE_CARLO: Options = {
    "--runs": ("1", "3", "0", "-1", "1000000000000"),
    "--out": (
        "runs.parquet",
        "rows.parquet",
        "rig.toml",
        "out.json",
        "none/x.parquet",
        "x",
        "/dev/full",
        "run.parquet",
    ),
    "--spread": (
        "K_i=normal:5%",
        "bearing.A.air_gap=normal:1e-5",
        "amplitude=uniform:0:1",
        "amplitude=normal:1e300",
        "K_i=uniform:1:0",
        "tau_e=uniform:nan:1",
        "tau_e=normal:inf",
        "bearing.A.name=normal:1",
        "rotor.mass=normal:300%",
        "x=normal:1",
        "K_i=x:1",
        "K_i=",
    ),
    "--diagnose": (),
    "--workers": ("1", "1", "2", "0", "-1", "100000000000"),
    "--cluster": ("127.0.0.1:1", "x", "tcp://[::1", "http://127.0.0.1:1", ""),
}

SHORT = ("--seconds", "0.1")
COMMANDS = {
    "init": Command(("--out", "new.toml"), QUIET | FORCE | {
        "": ("pid", "state_space", "levitator", "modal_rotor", "x", ""),
        "--out": ("new.toml", "rig.toml", "new.json", "out.json", "none/new.toml", "/dev/full", ".", "x.toml/y.toml"),
    }),
    "check": Command(("rig.toml", "RECORD"), QUIET | EXACT | RECORDS | ALLOW),
    "compare": Command(("rig.toml", "RECORD"), QUIET | EXACT | RECORDS | ALLOW | MODEL | BEFORE | PLOT | {
        "--stretch": ("0:0.01", "0.01:0", "nan:nan", "0:inf", "-1:-2", "1e300:1e308", "0:1e-300", "x"),
    }),
    "identify": Command(("rig.toml", "RECORD"), QUIET | EXACT | RECORDS | ALLOW | MODEL | OF_IDENTIFY | SAVE | PLOT),
    "static-load": Command(("bench.toml", "load.csv"), QUIET | EXACT | {
        "": ("load.csv", "run.csv", "none.csv", "bench.toml"),
        "--deflection": (),
    }),
    "campaign": Command(("bench_run",), QUIET | EXACT | {
        "--deflection": (),
        "--plot": PLOT["--plot"],
        "--table": ("out.csv", "out.tex", "out.xyz", "none/out.csv", "rig.toml", "out.json", "/dev/full"),
    }, often=3),
    "rank": Command(("rig.toml", "RECORD"), QUIET | EXACT | RECORDS | ALLOW | MODEL | PLOT | {
        "--predict": ("loop_delay", "sensor_lag", "flux_saturation", "x", ""),
    }, often=2),
    "diagnose": Command(
        ("rig.toml", "RECORD"),
        QUIET | EXACT | RECORDS | ALLOW | MODEL | SAVE | PLOT | VALIDATE | OF_DIAGNOSE | MEND,
        often=2,
    ),
    "frequency-response": Command(("rig.toml", "RECORD"), QUIET | EXACT | FORCE | RECORDS | MODEL | BEFORE | PLOT | {
        "--out": ("frf.csv", "frf.mat", "frf.uff", "response.csv", "run.csv", "rig.toml", "none/frf.csv", "/dev/full"),
    }),
    "margins": Command(("rig.toml",), QUIET | EXACT | MODEL | SEED | PLOT | {
        "--at": ("controller", "sensor", "sensor", "x", ""),
        "--draws": ("1", "40", "100", "0", "-1", "39", "1000000000"),
    }),
    "poles": Command(("rig.toml",), QUIET | EXACT | MODEL | BEFORE | PLOT),
    "campbell": Command(("bench.toml",), QUIET | EXACT | MODEL | PLOT | {
        "--measured": MODEL["--model"],
        "--speeds": ("0:1000", "1000:0", "0:0", "-1:1", "nan:1", "0:1e300", "0:1e-300", "x", ":"),
    }, often=4),
    "export": Command(("model.json", "--stepper", "first.step"), QUIET | FORCE | {
        "": ("rig.toml", "none.json"),
        "--uss": ("out.mat", "out.mat", "run.mat", "out.m", "none/x.mat", "out.json", "/dev/full", "9.mat"),
        "--stepper": ("out.step", "out.step", "rig.toml", "model.json", "none/x", ".", "/dev/full", "out.mat"),
        "--fmu": ("out.fmu", "out.fmu", "out.zip", "none/x.fmu", "9 %.fmu", "out.json", "/dev/full"),
        "--fmi": ("2", "3", "3", "1", "-1"),
    }),
    "workbench": Command(("--no-browser", "rig.toml", "RECORD"), QUIET | EXACT | RECORDS | ALLOW | MODEL | VALIDATE | {
        "--port": ("0", "-1", "1", "65535", "65536", "9999999999"),
        "--no-browser": (),
    }, often=2),
    "effects": Command((), QUIET | {
        "": ("loop_delay", "x", "loop"),
        "--rig": ("rig.toml", "bench.toml", "modes.toml", "none", "model.json"),
    }, often=4),
    "excitation": Command(("rig.toml", "--out", "out.csv"), QUIET | EXACT | FORCE | MODEL | LIMITS | OF_EXCITATION),
    "design": Command(
        ("rig.toml", "--accuracy", "K_i=5%", "--seconds", "2"),
        QUIET | EXACT | FORCE | MODEL | LIMITS | READ | OF_DESIGN,
        often=4,
    ),
    "simulate": Command(("rig.toml", "--out", "out.csv"), QUIET | EXACT | FORCE | MODEL | EXPERIMENT | {
        "--out": ("out.mat", "out.h5", "out.parquet", "run.csv", "rig.toml", "out.json", "none/x.csv", "/dev/full"),
    }),
    "monte-carlo": Command(
        ("rig.toml", "--runs", "2", *SHORT), QUIET | EXACT | MODEL | EXPERIMENT | OF_MONTE_CARLO, often=4
    ),
    "demo": Command((), QUIET | FORCE | {
        "--out": ("rig.toml", "none/story", ".", "/dev/full", "x" * 300, "out.json"),
    }, last=("--json", "nowhere/out.json"), often=1),
}  # fmt: skip
"""The whole story of the demo takes too long to be fuzzed: it is always asked for a file in a folder that is none."""
