"""The command `export`: a saved model for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import ambid
from ambid.cli.options import Force, JsonFile, Quiet
from ambid.cli.outputs import conclude, require_outputs
from ambid.errors import InputError
from ambid.results import plain


def export_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="What --save of identify or diagnose wrote.")],
    uss: Annotated[
        Path,
        typer.Option(
            "--uss", metavar="FILE.mat", help="G, Delta with 95 % ranges and covariance, K; with a script FILE_uss.m."
        ),
    ],
    force: Force = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Write the uncertain model, and a script that makes a MATLAB uss of it."""
    from ambid.robustness.matlab import script_beside  # not at the top: --help need not open that room

    files = [uss, script_beside(uss)]
    for path in files:
        if path.exists() and not force:
            raise InputError(f"--uss {path}: is there already; give another file, or replace it with --force")
    require_outputs({"MODEL": model}, {"--uss": files, "--json": json_file}, replaced=["--uss"])
    found = ambid.uncertain(ambid.Model.load(model))
    ranges = zip(found.parameters, found.values.tolist(), found.ci95.tolist(), found.units, strict=True)
    data = {
        "files": [str(path) for path in files],
        "states": len(found.A),
        "delta": len(found.parameter),
        "parameters": {name: {"value": v, "ci95": plain(ci95), "unit": unit} for name, v, ci95, unit in ranges},
    }
    conclude(found, data, json_file, quiet, lambda: found.to_mat(uss))
