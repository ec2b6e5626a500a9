"""Runs and models that commands read, with the arguments that say which."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from bench_service.cli.arguments import fractions
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.module.log import ModuleLog
    from models.module.models import ModuleModel
    from models.module.network import ModuleNetwork
    from models.network.local_model_network import LocalModelNetwork
    from models.network.structure import Structure


def add_current_sign(parser: ArgumentParser) -> None:
    """Add `--current-sign`."""
    parser.add_argument(
        "--current-sign",
        choices=["charge-positive", "discharge-positive"],
        help="which sign charges in the run files; without it the current is checked against the voltage",
    )


def add_runs_to_learn_from(parser: ArgumentParser, out: str) -> None:
    """Add `--initial-soc`, `--out` and `--current-sign` of a command that learns from runs and judges by others."""
    parser.add_argument(
        "--initial-soc",
        type=fractions,
        action="extend",
        metavar="S[,S...]",
        help="of the training, then the validation runs; one value, or one for each; default: their soc_ref",
    )
    parser.add_argument("--out", type=Path, required=True, metavar=out)
    add_current_sign(parser)


def read_runs(paths: Sequence[Path], current_sign: str | None, output: Output) -> list[TimeSeries]:
    """Read measured runs; remarks go to `output`, two files of one name are told apart by their directory.

    Where that is one as well, by the whole of their names: `b/run.csv` and `b/run.parquet`.
    """
    return [log.run for log in read_logs(paths, current_sign, output)]


def read_logs(paths: Sequence[Path], current_sign: str | None, output: Output) -> list[ModuleLog]:
    """Read measured runs, with the voltages of a module's cells where the files have them; see `read_runs`."""
    # Lazy: numba and scipy take 1.0 s.
    from bench_service.exchange.read import read_run_file
    from models.module.log import ModuleLog

    files = []
    for path in paths:
        files.append(read_run_file(path, current_sign))  # pyright: ignore[reportArgumentType]  # argparse checked it
        output.warn(*files[-1].warnings)
    names = _told_apart(paths, [read.series.name for read in files])
    return [ModuleLog(replace(read.series, name=name), read.cells_V) for read, name in zip(files, names, strict=True)]


def _told_apart(paths: Sequence[Path], names: Sequence[str]) -> list[str]:
    """Names of runs, longer where several have one: with the directory, then also with the ending of the file."""
    parents = [path.absolute().parent.name for path in paths]
    placed = [
        f"{parent}/{name}" if names.count(name) > 1 else name for parent, name in zip(parents, names, strict=True)
    ]
    files = {name: {path.name for path, other in zip(paths, placed, strict=True) if other == name} for name in placed}
    return [
        f"{parent}/{path.name}" if len(files[name]) > 1 else name
        for parent, path, name in zip(parents, paths, placed, strict=True)
    ]


def read_model(path: Path) -> LocalModelNetwork:
    """Read a MODEL.json.

    Raises
    ------
    UsageError
        The file is missing, is not JSON, or holds no model; or it carries no seal and means no cell that can be.
    """
    # Lazy: numba and scipy take 1.1 s.
    from bench_service.jobs.screening import checked_model
    from models.data.errors import ModelError
    from models.data.seal import SEAL
    from models.network.local_model_network import LocalModelNetwork

    document = _read_json(path, "a model")
    try:
        if isinstance(document, dict) and SEAL not in document:
            return checked_model(document)
        return LocalModelNetwork.from_json(document)
    except ModelError as error:
        raise UsageError(f"{path}: {error}") from error


def read_any_model(path: Path) -> LocalModelNetwork | ModuleNetwork:
    """Read a MODEL.json of a cell or of a module; see `read_model`."""
    # Lazy: numba and scipy take 1.1 s.
    from bench_service.jobs.screening import checked_any
    from models.data.errors import ModelError
    from models.data.seal import SEAL
    from models.module.network import model_from_json

    document = _read_json(path, "a model")
    try:
        return (
            checked_any(document) if isinstance(document, dict) and SEAL not in document else model_from_json(document)
        )
    except ModelError as error:
        raise UsageError(f"{path}: {error}") from error


def read_module(path: Path) -> ModuleModel:
    """Read a module model (S1 to S4).

    Raises
    ------
    UsageError
        The file is missing, is not JSON, or holds no module model.
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.data.errors import ModelError
    from models.module.models import ModuleModel

    document = _read_json(path, "a module model")
    try:
        return ModuleModel.from_json(document)
    except (ModelError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: {error}") from error


def read_structure(name: str) -> str | Structure:
    """Return the name of a structure, or the one in a file: a structure's document or a MODEL.json that has one.

    Raises
    ------
    UsageError
        Neither a known name nor a readable file.
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.data.errors import ModelError
    from models.network.structure import Structure
    from models.pipeline import STRUCTURES

    if name in STRUCTURES:
        return name
    if not name.endswith(".json"):
        raise UsageError(f"--structure {name!r} is unknown; use one of {', '.join(STRUCTURES)} or a file FILE.json")
    document = _read_json(Path(name), "a structure")
    try:
        return Structure.from_json(document.get("structure", document) if isinstance(document, dict) else document)
    except (ModelError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f"{name}: is not a structure: {error}") from error


def _read_json(path: Path, what: str) -> Any:
    try:
        return json.loads(path.read_bytes(), parse_constant=_refuse_constant)
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)
        raise UsageError(f"{path}: {reason}") from error
    except ValueError as error:
        raise UsageError(f"{path}: is not {what}: not valid JSON ({error})") from error


def _refuse_constant(token: str) -> NoReturn:
    raise ValueError(f"{token} is not a JSON number; every number must be finite")


def write_document(path: Path, document: dict[str, Any]) -> None:
    """Write a model's document as JSON with the hash of its content, whole or not at all."""
    # Lazy: numpy takes 70 ms.
    from bench_service.exchange.atomic import write_atomically
    from models.data.seal import sealed

    write_atomically(path, (json.dumps(sealed(document), allow_nan=False) + "\n").encode())
