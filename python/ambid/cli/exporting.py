"""The command `export`: a saved model for other programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import ambid
from ambid.cli.options import Force, JsonFile, Quiet
from ambid.cli.outputs import conclude, require_new, require_outputs
from ambid.errors import InputError, ModelError
from ambid.results import plain


def export_command(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="What --save of identify or diagnose wrote.")],
    uss: Annotated[
        Path | None,
        typer.Option(
            "--uss", metavar="FILE.mat", help="G, Delta with 95 % ranges and covariance, K; with a script FILE_uss.m."
        ),
    ] = None,
    stepper: Annotated[
        Path | None, typer.Option("--stepper", metavar="FILE", help="The loop for the stepper in C, see ambid.h.")
    ] = None,
    fmu: Annotated[
        Path | None, typer.Option("--fmu", metavar="FILE.fmu", help="The loop as a unit for co-simulation.")
    ] = None,
    fmi: Annotated[int, typer.Option(metavar="2|3", help="Version of the standard of the unit.")] = 2,
    force: Force = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Write the model for MATLAB (an uncertain one), for C, or as a functional mock-up unit."""
    files = {"--uss": _with_script(uss), "--stepper": _listed(stepper), "--fmu": _listed(fmu)}
    if not any(files.values()):
        raise InputError("nothing to write; give --uss FILE.mat, --stepper FILE or --fmu FILE.fmu")
    if fmu is not None:
        from ambid.embedded.unit import require_fmu

        require_fmu(fmu, fmi)
    for option, paths in files.items():
        for path in paths:
            require_new(option, path, force)
    require_outputs({"MODEL": model}, {**files, "--json": json_file}, replaced=list(files))
    own = ambid.Model.load(model)
    result: object = own
    data: dict[str, Any] = {"files": [str(path) for paths in files.values() for path in paths]}
    writers: list[Callable[[], Sequence[Path]]] = []
    if uss is not None:
        try:
            result = found = ambid.uncertain(own)
        except ModelError as error:
            raise ModelError(f"{model}: {error}") from None
        ranges = zip(found.parameters, found.values.tolist(), found.ci95.tolist(), found.units, strict=True)
        data |= {
            "states": len(found.A),
            "delta": len(found.parameter),
            "parameters": {name: {"value": v, "ci95": plain(ci95), "unit": unit} for name, v, ci95, unit in ranges},
        }
        writers.append(lambda: found.to_mat(uss))
    if stepper is not None or fmu is not None:
        data |= {"inputs": own.loop.inputs, "outputs": own.loop.outputs, "sample_time": own.loop.sample_time}
    if stepper is not None:
        writers.append(_writing(stepper, lambda path: ambid.to_stepper(own, path)))
    if fmu is not None:
        writers.append(_writing(fmu, lambda path: ambid.to_fmu(own, path, fmi=fmi)))
    conclude(result, data, json_file, quiet, *writers)


def _with_script(uss: Path | None) -> list[Path]:
    """The files of the uncertain model."""
    if uss is None:
        return []
    from ambid.robustness.uncertain_model import script_beside  # not at the top: --help need not open that room

    return [uss, script_beside(uss)]


def _listed(path: Path | None) -> list[Path]:
    return [] if path is None else [path]


def _writing(path: Path, write: Callable[[Path], None]) -> Callable[[], Sequence[Path]]:
    """A writer that names its file."""

    def written() -> Sequence[Path]:
        write(path)
        return [path]

    return written
