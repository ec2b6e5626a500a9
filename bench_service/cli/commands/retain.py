"""`bench-service retain`: give up samples of old runs that nothing rests on."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from contextlib import closing
from pathlib import Path

from bench_service.cli.arguments import positive
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--days", type=positive, required=True, metavar="N", help="age from which samples may go")
    parser.add_argument("--yes", action="store_true", help="do it; without it only what would go is listed")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the data are")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy and pydantic take 340 ms.
    from bench_service.config import load_config
    from bench_service.store.metadata import MetadataStore
    from bench_service.store.retention import give_up, old_runs

    data_dir = load_config(options.config).data_dir
    if options.yes:
        if MetadataStore.holder(data_dir) is not None:
            raise UsageError(f"a service has {data_dir} open; end it before samples are given up")
        old = give_up(data_dir, options.days)
    else:
        with closing(MetadataStore.look(data_dir)) as store:
            old = old_runs(store, options.days)
    samples = sum(run.n_samples or 0 for run in old.runs)
    state = "given up" if options.yes else "listed"
    answer = {"state": state, "runs": [run.id for run in old.runs], "samples": samples, "kept": old.n_kept}
    told = f"{state}: {samples} samples of {len(old.runs)} runs; {old.n_kept} more stay: models or results need them"
    output.result(answer, lambda console: console.print(told))
    return 0


COMMAND = Command("retain", "give up samples of old runs that no model and no result rests on", _arguments, _run)
