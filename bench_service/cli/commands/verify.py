"""`bench-service verify`: whether all that was stored is still there, and as it was; with `--repair`, put right."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

_DAMAGED = 1


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--repair", action="store_true", help="turn wrong bits back; take out what cannot be saved")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the runs are stored")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy and pydantic take 340 ms.
    from bench_service.config import load_config
    from bench_service.store.access import FILE
    from bench_service.store.metadata import MetadataStore
    from bench_service.store.repair import repair
    from bench_service.store.verify import verify

    data_dir = load_config(options.config).data_dir
    if not (data_dir / FILE).exists():
        raise UsageError(f"nothing is stored in {data_dir}; see --config")
    if options.repair and MetadataStore.holder(data_dir) is not None:
        raise UsageError(f"a service has {data_dir} open; end it before a repair")
    report = verify(data_dir)
    done = []
    if options.repair:
        hurt = {finding.name for finding in report.damaged if finding.kind in ("run", "observer")}
        done = repair(data_dir, sorted(hurt))
        report = verify(data_dir)
    answer = {
        "state": "damaged" if report.damaged else "repaired" if done else "whole",
        "runs": report.n_runs,
        "samples": report.n_samples,
        "findings": [finding.to_json() for finding in report.findings],
        "repaired": [each.to_json() for each in done],
    }
    output.result(answer, lambda console: _show(console, answer))
    return _DAMAGED if report.damaged else 0


def _show(console: Console, answer: dict[str, Any]) -> None:
    console.print(f"{answer['state']}: {answer['runs']} runs, {answer['samples']} samples read")
    for each in answer["repaired"]:
        how = "whole again" if each["whole"] else f"{each['samples_lost']} samples lost"
        console.print(f"repaired run {each['run']}: {how}")
    for finding in answer["findings"]:
        known = " (known)" if finding["known"] else ""
        console.print(f"{finding['kind']} {finding['name']}{known}: {finding['what']}")


COMMAND = Command("verify", "read all that is stored and hold it against its records", _arguments, _run)
