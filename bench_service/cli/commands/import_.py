"""`bench-service import`: a measured run of any cycler's program, as a file of this project's own."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import fraction, positive
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from bench_service.exchange.foreign.importing import Imported
    from bench_service.exchange.foreign.looking import Choices, Look
    from bench_service.exchange.foreign.mapping import Column

_SHOWN_ROWS = 5
_OWN_KINDS = (".csv", ".txt", ".tsv", ".mpt", ".gz", ".parquet", ".mat", ".nda", ".ndax", ".mf4", ".mdf")


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="as the cycler's program wrote it, gzipped or not")
    parser.add_argument("--format", metavar="CYCLER", help="arbin, maccor, ...; default: recognised by its columns")
    parser.add_argument("--mapping", metavar="NAME", help="a remembered mapping of columns; default: guessed")
    parser.add_argument(
        "--out", type=Path, metavar="RUN", help="RUN.csv or RUN.parquet, RUN.bdf.csv or RUN.bdf.parquet for BDF labels"
    )
    parser.add_argument("--show", action="store_true", help="only look: print what the columns are taken for, and why")
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        type=_column,
        metavar="ROLE=NAME[:UNIT]",
        help="which column holds time_s, current_A, voltage_V, ...; ROLE= alone: none does",
    )
    parser.add_argument("--current-sign", choices=["charge-positive", "discharge-positive"])
    parser.add_argument("--date-order", choices=["day-first", "month-first"], help="of dates such as 03/04/2024")
    parser.add_argument("--time-zone", metavar="ZONE", help="of the file's clock, as Europe/Oslo")
    parser.add_argument("--cell", metavar="NAME", help="which cell of a file with several")
    parser.add_argument(
        "--bad-times", choices=["leave-out"], help="rows whose time lies before that of an earlier row are left out"
    )
    parser.add_argument("--capacity-Ah", type=positive, metavar="Q", help="of the cell; without --out, to store a run")
    parser.add_argument("--initial-soc", type=fraction, metavar="S", help="of the cell at the start of the file")
    parser.add_argument("--of-cell", metavar="ID", help="cell that the stored run belongs to, see the command cell")
    parser.add_argument("--save-mapping", metavar="NAME", help="remember the mapping, with what was chosen here")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where mappings are kept")


def _column(text: str) -> tuple[str, Column]:
    # Lazy: pyarrow and numpy take 100 ms.
    from bench_service.exchange.foreign.mapping import ROLES, Column
    from bench_service.exchange.foreign.units import unit_names

    role, equals, name = text.partition("=")
    if not equals or role not in ROLES:
        raise ArgumentTypeError(f"{text!r}: write ROLE=NAME[:UNIT] with a role of {', '.join(ROLES)}")
    quantity = ROLES[role]
    head, colon, unit = name.rpartition(":")
    if colon and quantity is not None and unit in unit_names(quantity):
        return role, Column(head, unit)
    return role, Column(name)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numpy takes 90 ms.
    from bench_service.exchange.foreign.outside import readable

    with readable(options.file, options.file.name, _readers(options)) as source:
        return _import(options, output, source)


def _readers(options: Namespace) -> dict[str, list[str]]:
    """Programs of the user's own; the configuration has no say over a kind that is always read here."""
    if options.file.suffix.lower() in _OWN_KINDS or not options.file.is_file():
        return {}
    # Lazy: pydantic takes 100 ms.
    from bench_service.config import load_config

    return load_config(options.config).readers


def _import(options: Namespace, output: Output, source: Path) -> int:
    """Import what `source` holds: the file itself, or what its reader prints."""
    # Lazy: as above.
    from bench_service.exchange.atomic import check_writable
    from bench_service.exchange.foreign.importing import import_file
    from bench_service.exchange.foreign.looking import look
    from bench_service.exchange.foreign.output import check_suffix, write_imported

    choices = _choices(options)
    if options.show:
        seen = replace(look(source, choices), path=options.file)
        _remember(options, seen)
        output.result(_told(seen), lambda console: _show(console, seen))
        return 0
    if options.out is None:
        return _store(options, output, source)
    check_suffix(options.out)
    check_writable(options.out)
    with output.progress(f"reading {options.file.name}") as report:
        run = import_file(source, choices, lambda share: report(0.9 * share, "reading"))
        with closing(run):
            report(0.9, "writing")
            write_imported(options.out, run)
    _remember(options, look(source, choices))
    output.warn(*(f"{options.file}: {remark}" for remark in run.remarks))
    output.result(_answer(options, run), lambda console: _say(console, options, run))
    return 0


def _store(options: Namespace, output: Output, source: Path) -> int:
    """Put the file into the store, through the service that holds it or one of its own."""
    # Lazy: pydantic, sqlalchemy and httpx take 400 ms.
    from bench_service.cli.service import connected_to_store
    from bench_service.client import ClientError
    from bench_service.config import load_config

    if options.capacity_Ah is None or options.initial_soc is None:
        raise UsageError(
            "import: say where to with --out RUN.csv, or store it as a run with --capacity-Ah and --initial-soc; "
            "--show only looks"
        )
    choices = _choices(options)
    given: dict[str, Any] = {
        "format": options.format,
        "mapping": options.mapping,
        "columns": {role: {"column": each.name, "unit": each.unit} for role, each in choices.columns.items()},
        "current_sign": options.current_sign,
        "date_order": options.date_order,
        "time_zone": options.time_zone,
        "cell": options.cell,
        "leave_out": choices.leave_out,
    }
    _remember(options, _look_first(source, choices))
    with connected_to_store(load_config(options.config)) as client, output.progress(options.file.name) as report:
        upload = client.upload_file(options.file)
        try:
            stored = client.store_import(
                upload["id"],
                options.capacity_Ah,
                options.initial_soc,
                cell_id=options.of_cell,
                choices=given,
                on_progress=lambda job: report(job["progress"], job["message"]),
            )
        except ClientError as error:
            client.drop_import(upload["id"])
            if str(error).startswith(f"{options.file.name}: "):  # the file's fault, not the service's
                raise UsageError(str(error)) from error
            raise
    output.warn(*(f"{options.file}: {remark}" for remark in stored["remarks"]))
    answer = {"run": stored["run"], "state": stored["state"], "samples": stored["samples"], "reason": None}
    output.result(
        answer | {key: stored[key] for key in ("mapping", "remarks", "ignored_columns")},
        lambda console: console.print(f"run {stored['run']}: {stored['samples']} samples", markup=False),
    )
    return 0


def _look_first(source: Path, choices: Choices) -> Look:
    """Look at the file before a service is asked: what is missing is told at once."""
    from bench_service.exchange.foreign.looking import look

    return look(source, choices)


def _choices(options: Namespace) -> Choices:
    from bench_service.exchange.foreign.looking import Choices
    from bench_service.exchange.foreign.mapping import check_name, check_zone, load_mapping

    check_zone(options.time_zone, "--time-zone")
    if options.save_mapping is not None:
        check_name(options.save_mapping, "--save-mapping")
    if options.mapping is not None and options.format is not None:
        raise UsageError("import: --mapping says all that --format would; give one of them")
    return Choices(
        format=options.format,
        mapping=None if options.mapping is None else load_mapping(_kept(options), options.mapping),
        columns=dict(options.column),
        current_sign=options.current_sign,
        date_order=options.date_order,
        time_zone=options.time_zone,
        cell=options.cell,
        leave_out=options.bad_times == "leave-out",
    )


def _kept(options: Namespace) -> Path:
    # Lazy: pydantic takes 100 ms.
    from bench_service.config import load_config
    from bench_service.exchange.foreign.mapping import FOLDER

    return load_config(options.config).data_dir / FOLDER


def _remember(options: Namespace, seen: Look) -> None:
    if options.save_mapping is None:
        return
    from bench_service.exchange.foreign.mapping import save_mapping

    save_mapping(_kept(options), replace(seen.mapping, name=options.save_mapping))


def _told(seen: Look) -> dict[str, Any]:
    return {
        "file": str(seen.path),
        "state": "looked at",
        "kind": seen.table.kind,
        "mapping": seen.mapping.to_json(),
        "columns": list(seen.table.names),
        "first_rows": [list(row) for row in seen.table.sample[:_SHOWN_ROWS]],
    }


def _show(console: Console, seen: Look) -> None:
    # Lazy: rich takes 20 ms.
    from rich.table import Table

    console.print(f"{seen.path}: {seen.mapping.title}", markup=False)
    table = Table("is read as", "column", "unit", "first values", "why")
    for role, column in seen.mapping.columns.items():
        k = seen.table.names.index(column.name) if column.name in seen.table.names else None
        values = "" if k is None else ", ".join(row[k] for row in seen.table.sample[:_SHOWN_ROWS] if k < len(row))
        table.add_row(role, column.name, column.unit or "", values, column.why)
    console.print(table)
    used = {column.name for column in seen.mapping.columns.values()}
    unused = ", ".join(name for name in seen.table.names if name not in used)
    if unused:
        console.print(f"not used: {unused}", markup=False)


def _answer(options: Namespace, run: Imported) -> dict[str, Any]:
    return {
        "file": str(options.out),
        "state": "completed",
        "samples": run.n,
        "reason": None,
        "mapping": run.mapping.to_json(),
        "remarks": list(run.remarks),
        "ignored_columns": list(run.ignored_columns),
        "started_unix_s": run.started_unix_s,
    }


def _say(console: Console, options: Namespace, run: Imported) -> None:
    console.print(f"wrote {run.n} samples to {options.out} (read as {run.mapping.title})", markup=False)


COMMAND = Command("import", "read what any cycler's program wrote, into a file or as a stored run", _arguments, _run)
