"""`bench-service export`: a stored run, or a run file, in another format."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from contextlib import closing
from datetime import datetime
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
    from bench_service.store.records import RunRecord


def _arguments(parser: ArgumentParser) -> None:
    writable = sorted(name for name, each in formats().items() if each.encode is not None)
    parser.add_argument("run", metavar="RUN", help="id of a stored run, or a run file to convert")
    parser.add_argument("--format", choices=writable, required=True)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the runs are stored")
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: pydantic takes 100 ms.
    from bench_service.config import load_config

    check_writable(options.out)
    if Path(options.run).is_file():
        content, answer = _convert(options, output)
    else:
        content, answer = _export_stored(options.run, options.format, load_config(options.config))
    write_atomically(options.out, content)
    answer |= {"file": str(options.out)}
    output.result(answer, lambda console: console.print(f"wrote {answer['samples']} samples to {answer['file']}"))
    return 0


def _convert(options: Namespace, output: Output) -> tuple[bytes, dict[str, Any]]:
    series = read_runs([Path(options.run)], options.current_sign, output)[0]
    names = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    columns = {name: getattr(series, name) for name in names if getattr(series, name) is not None}
    return encode_run(columns, options.format), {"run": series.name, "samples": len(series)}


def _export_stored(run_id: str, format_name: str, config: ServiceConfig) -> tuple[bytes, dict[str, Any]]:
    """Read from the store; its metadata through the service that holds it, if there is one."""
    # Lazy: sqlalchemy, httpx and rich take 380 ms.
    from bench_service.client import BenchClient
    from bench_service.config.token import read_token
    from bench_service.store.access import FILE
    from bench_service.store.metadata import MetadataStore

    if not (config.data_dir / FILE).exists():
        raise UsageError(f"{run_id}: no such file, and no runs are stored in {config.data_dir}; see --config")
    holder = MetadataStore.holder(config.data_dir)
    if holder is not None and holder.url is not None:
        with BenchClient(holder.url, token=read_token(config.data_dir)) as client:
            run = client.run(run_id)
            return client.export(run_id, format_name), _answer(run)
    with closing(MetadataStore.open(config.data_dir)) as store:
        record = store.runs.get(run_id)
        return _encode(record, format_name, config.data_dir), _answer({**_fields(record)})


def _encode(run: RunRecord, format_name: str, data_dir: Path) -> bytes:
    # Lazy: sqlalchemy takes 240 ms.
    from bench_service.store.integrity import Expected, read_whole
    from bench_service.store.samples import SampleReader

    with SampleReader(data_dir) as reader:
        data = read_whole(reader, Expected.of(run))
    if data.n == 0:
        raise UsageError(f"run {run.id} has no samples to export")
    started = None if run.started_utc is None else datetime.fromisoformat(run.started_utc).timestamp()
    return encode_run(data.columns, format_name, started)


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
