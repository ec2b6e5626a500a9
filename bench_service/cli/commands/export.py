"""`bench-service export`: a stored run, or a run file, in another format."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.files import add_current_sign, read_runs
from bench_service.cli.output import Output
from bench_service.exchange.atomic import check_writable, write_atomically
from bench_service.exchange.registry import formats
from bench_service.exchange.write import encode_run

if TYPE_CHECKING:
    from bench_service.config import ServiceConfig
    from bench_service.store.metadata import MetadataStore
    from bench_service.store.records import RunRecord

_CRATE = "ro-crate"


def _arguments(parser: ArgumentParser) -> None:
    writable = sorted(name for name, each in formats().items() if each.encode is not None)
    parser.add_argument("run", metavar="RUN", help="id of a stored run, or a run file to convert")
    parser.add_argument("--format", choices=[*writable, _CRATE], required=True)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="a folder: the name is Institution__Cell__YYYYMMDD_XXX; BDF has its metadata file beside it",
    )
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the runs are stored")
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: pydantic takes 100 ms.
    from bench_service.config import load_config

    if options.out.is_dir():
        check_writable(options.out / "x")
    else:
        check_writable(options.out)
    if Path(options.run).is_file():
        if options.format == _CRATE or options.out.is_dir():
            raise UsageError(f"{options.run} is a file: a bundle, and a name of its own, have stored runs alone")
        content, answer = _convert(options, output)
        out, metadata = options.out, None
    else:
        found = _export_stored(options.run, options.format, load_config(options.config))
        content, answer, metadata = found.content, found.answer, found.metadata
        out = options.out / Path(found.name).name if options.out.is_dir() else options.out
    write_atomically(out, content)
    answer |= {"file": str(out)}
    if metadata is not None:
        beside = out.with_suffix(".metadata.json")
        write_atomically(beside, metadata)
        answer |= {"metadata": str(beside)}
    output.result(answer, lambda console: console.print(f"wrote {answer['samples']} samples to {answer['file']}"))
    return 0


def _convert(options: Namespace, output: Output) -> tuple[bytes, dict[str, Any]]:
    series = read_runs([Path(options.run)], options.current_sign, output)[0]
    names = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    columns = {name: getattr(series, name) for name in names if getattr(series, name) is not None}
    return encode_run(columns, options.format), {"run": series.name, "samples": len(series)}


@dataclass(frozen=True, slots=True)
class _Exported:
    """A stored run as files: its own name, bytes, those of the metadata file beside it, and what is told of it."""

    name: str
    content: bytes
    metadata: bytes | None
    answer: dict[str, Any]


def _export_stored(run_id: str, format_name: str, config: ServiceConfig) -> _Exported:
    """Read from the store; its metadata through the service that holds it, if there is one."""
    # Lazy: sqlalchemy, httpx and rich take 380 ms.
    from bench_service.client import BenchClient
    from bench_service.config.token import read_token
    from bench_service.exchange.bdf_metadata import encode_metadata
    from bench_service.store.access import FILE
    from bench_service.store.metadata import MetadataStore

    if not (config.data_dir / FILE).exists():
        raise UsageError(f"{run_id}: no such file, and no runs are stored in {config.data_dir}; see --config")
    beside = format_name.startswith("bdf")
    holder = MetadataStore.holder(config.data_dir)
    if holder is not None and holder.url is not None:
        with BenchClient(holder.url, token=read_token(config.data_dir)) as client:
            run = client.run(run_id)
            name, content = client.export_named(run_id, format_name)
            metadata = encode_metadata(client.metadata(run_id)) if beside else None
            return _Exported(name, content, metadata, _answer(run))
    with closing(MetadataStore.open(config.data_dir)) as store:
        return _encode(store, run_id, format_name, config)


def _encode(store: MetadataStore, run_id: str, format_name: str, config: ServiceConfig) -> _Exported:
    # Lazy: sqlalchemy takes 240 ms.
    from bench_service.campaign.crating import crate_of
    from bench_service.campaign.exporting import Export
    from bench_service.exchange.bdf_metadata import encode_metadata
    from bench_service.exchange.ro_crate import SUFFIX
    from bench_service.store.integrity import Expected, read_whole
    from bench_service.store.samples import SampleReader

    export = Export(store, store.runs.get(run_id), config.institution, version("bench-service"))
    with SampleReader(config.data_dir) as reader:
        data = read_whole(reader, Expected.of(export.run))
    if data.n == 0:
        raise UsageError(f"run {run_id} has no samples to export")
    answer = _answer(_fields(export.run))
    if format_name == _CRATE:
        return _Exported(f"{export.name}{SUFFIX}", crate_of(export, data.columns), None, answer)
    content = encode_run(data.columns, format_name, export.started_unix_s)
    metadata = encode_metadata(export.metadata()) if format_name.startswith("bdf") else None
    return _Exported(f"{export.name}{formats()[format_name].suffix}", content, metadata, answer)


def _fields(run: RunRecord) -> dict[str, Any]:
    names = ("id", "state", "n_samples", "missed_ticks", "reason")
    return {name: getattr(run, name) for name in names}


def _answer(run: dict[str, Any]) -> dict[str, Any]:
    return {
        "run": run["id"],
        "state": run["state"],
        "samples": run["n_samples"],
        "missed_ticks": run["missed_ticks"],
        "reason": run["reason"],
    }


COMMAND = Command("export", "write a stored run, or a run file, in another format", _arguments, _run)
