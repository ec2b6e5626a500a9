"""`bench-service cell`: the cells that there are, whose they are, on which bench they stand, which runs are theirs."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import number, positive
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from bench_service.client import BenchClient
    from bench_service.config import ServiceConfig

_ACTIONS = ("list", "show", "add", "change", "retire", "reuse", "on", "off", "give")


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "action",
        choices=_ACTIONS,
        help="list (by WORDs); show, change, retire or reuse an ID; add one; put ID on a bench or take what is there "
        "off; give RUNs to ID",
    )
    parser.add_argument("what", nargs="*", metavar="WORD|ID|RUN", help="small and large letters of an ID are the same")
    parser.add_argument("--id", metavar="ID", help="of a new cell; default: the next free one, such as C7")
    parser.add_argument("--label", metavar="TEXT", help="what people call it; '' takes it away")
    parser.add_argument("--owner", metavar="NAME", help="whose it is; '' takes it away")
    parser.add_argument("--type", type=Path, metavar="TYPE.toml", help="what its data sheet says, as for a bench")
    parser.add_argument("--like", metavar="ID", help="of the same type as that cell")
    parser.add_argument("--capacity-Ah", type=positive, metavar="Q", help="as measured; default: its type's")
    parser.add_argument(
        "--set", action="append", default=[], type=_entry, metavar="NAME=VALUE", help="whatever else is kept with it"
    )
    parser.add_argument("--bench", default="sim", metavar="NAME", help="for on and off; default: sim")
    parser.add_argument("--retired", action="store_true", help="list those too that are not used any more")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the data are")


def _entry(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise ArgumentTypeError(f"{text!r} does not read NAME=VALUE")
    try:
        return name.strip(), number(value)
    except ArgumentTypeError:
        return name.strip(), {"true": True, "false": False}.get(value, value)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: pydantic, sqlalchemy and httpx take 400 ms.
    from bench_service.config import load_config

    config = load_config(options.config)
    if options.action in ("on", "off"):
        _place(options, config, output)
        return 0
    from bench_service.cli.service import connected_to_store

    does = {"list": _list, "add": _add, "show": _show, "change": _change, "give": _give}
    told = _told(options)
    with connected_to_store(config) as client:
        does.get(options.action, _retire)(client, options, told, output)
    return 0


def _one(options: Namespace) -> str:
    if not options.what:
        raise UsageError(f"cell {options.action}: name a cell by its id, such as C7")
    return options.what[0]


def _told(options: Namespace) -> dict[str, Any]:
    """What the options say of a cell; an empty text takes away what stands there."""
    # Lazy: pydantic takes 100 ms.
    from bench_service.config.cell_type import read_cell_type

    told: dict[str, Any] = {
        name: getattr(options, name) for name in ("label", "owner") if getattr(options, name) is not None
    }
    told = {name: value or None for name, value in told.items()}
    if options.type is not None:
        try:
            told["type"] = read_cell_type(options.type).model_dump(mode="json")
        except ValueError as error:
            raise UsageError(str(error)) from error
    if options.capacity_Ah is not None:
        told["capacity_Ah"] = options.capacity_Ah
    if options.set:
        told["metadata"] = dict(options.set)
    return told


def _list(client: BenchClient, options: Namespace, _told: dict[str, Any], output: Output) -> None:
    cells = list(client.cells(" ".join(options.what) or None, retired=options.retired))

    def show(console: Console) -> None:
        # Lazy: rich takes 20 ms.
        from rich import box
        from rich.table import Table

        table = Table("id", "label", "owner", "type", "capacity Ah", "bench", "runs", "models", box=box.SIMPLE_HEAD)
        for cell in cells:
            named = [cell["id"], cell["label"] or "", cell["owner"] or "", _type_name(cell), _capacity(cell)]
            table.add_row(*named, cell["bench"] or ("retired" if cell["retired_utc"] else ""),
                          str(cell["n_run"]), str(cell["n_model"]))  # fmt: skip
        console.print(table if cells else "no cells; 'bench-service cell add' takes one in")

    output.result({"cells": cells}, show)


def _add(client: BenchClient, options: Namespace, told: dict[str, Any], output: Output) -> None:
    if options.what:
        raise UsageError(f"cell add: {options.what[0]!r} is too much; --id {options.what[0]} chooses the id")
    given = told | {name: getattr(options, name) for name in ("id", "like") if getattr(options, name) is not None}
    cell = client.add_cell(**given)
    output.result(cell, lambda console: console.print(f"cell {cell['id']} is taken in", markup=False))


def _show(client: BenchClient, options: Namespace, _told: dict[str, Any], output: Output) -> None:
    cell = client.cell(_one(options))
    runs = client.runs(cell_id=cell["id"], limit=20)

    def show(console: Console) -> None:
        for line in _lines(cell):
            console.print(line, markup=False)
        for run in runs:
            began = (run["started_utc"] or run["created_utc"])[:16]
            name = run["label"] or run["name"] or ""
            console.print(f"  run {run['id']}  {began}  {run['state']}  {name}", markup=False)

    output.result(cell | {"runs": [run["id"] for run in runs]}, show)


def _change(client: BenchClient, options: Namespace, told: dict[str, Any], output: Output) -> None:
    cell_id = _one(options)
    if "metadata" in told:
        told["metadata"] = client.cell(cell_id)["metadata"] | told["metadata"]
    if options.like is not None:
        told["type"] = client.cell(options.like)["type"]
    if not told:
        raise UsageError("cell change: say what, with --label, --owner, --type, --like, --capacity-Ah or --set")
    cell = client.change_cell(cell_id, **told)
    output.result(cell, lambda console: console.print("\n".join(_lines(cell)), markup=False))


def _retire(client: BenchClient, options: Namespace, _told: dict[str, Any], output: Output) -> None:
    act: Callable[[str], dict[str, Any]] = client.reuse_cell if options.action == "reuse" else client.retire_cell
    cell = act(_one(options))
    state = "in use" if cell["retired_utc"] is None else "retired"
    output.result(cell, lambda console: console.print(f"cell {cell['id']} is {state}", markup=False))


def _give(client: BenchClient, options: Namespace, _told: dict[str, Any], output: Output) -> None:
    cell_id, run_ids = _one(options), options.what[1:]
    if not run_ids:
        raise UsageError("cell give: name the runs behind the cell's id")
    runs = [client.describe_run(run_id, cell_id=cell_id) for run_id in run_ids]
    answer = {"cell_id": runs[0]["cell_id"], "runs": [run["id"] for run in runs]}
    text = f"{len(runs)} run{'s' if len(runs) > 1 else ''} of cell {answer['cell_id']}"
    output.result(answer, lambda console: console.print(text, markup=False))


def _place(options: Namespace, config: ServiceConfig, output: Output) -> None:
    """Put a cell on a bench; where no service runs this needs no hardware, so none is started."""
    from bench_service.client import BenchClient
    from bench_service.config.token import read_token
    from bench_service.store.metadata import MetadataStore

    cell_id = _one(options) if options.action == "on" else None
    holder = MetadataStore.holder(config.data_dir)
    if holder is not None and holder.url is not None:
        with BenchClient(holder.url, token=read_token(config.data_dir)) as client:
            placed = client.put_cell(options.bench, cell_id)
            known = {key: placed[key] for key in ("limits", "capacity_Ah")}
            known["cell_id"] = placed["cell"] and placed["cell"]["id"]
    else:
        known = _placed_in_store(options.bench, cell_id, config)
    there = "no cell that is named" if cell_id is None else f"cell {known['cell_id']}"
    output.result(
        {"bench": options.bench, **known},
        lambda console: console.print(f"on bench {options.bench} there is {there}", markup=False),
    )


def _placed_in_store(bench: str, cell_id: str | None, config: ServiceConfig) -> dict[str, Any]:
    from bench_service.campaign.cell_on_bench import with_cell
    from bench_service.cli.service import check_data_dir
    from bench_service.store.metadata import MetadataStore

    check_data_dir(config.data_dir)
    if bench not in config.bench:
        raise UsageError(f"unknown bench {bench!r}; the configuration has {', '.join(sorted(config.bench))}")
    with closing(MetadataStore.open(config.data_dir)) as store:
        cell = None if cell_id is None else store.cells.get(cell_id)
        both = with_cell(config.bench[bench], cell)
        before = store.cells.place(bench)
        if (None if before is None else before.cell_id) != (None if cell is None else cell.id):
            store.cells.put(bench, None if cell is None else cell.id)
            text = f"bench {bench!r} is empty" if cell is None else f"cell {cell.called} is put on bench {bench!r}"
            told = {"bench": bench, "cell_id": (before and before.cell_id) if cell is None else cell.id}
            store.events.add("info", "cell_off_bench" if cell is None else "cell_on_bench", text, **told)
    known = {"limits": both.limits.model_dump(mode="json"), "capacity_Ah": both.capacity_Ah}
    return known | {"cell_id": None if cell is None else cell.id}


def _lines(cell: dict[str, Any]) -> list[str]:
    kind = cell["type"] or {}
    lines = [f"cell {cell['id']}: {cell['label'] or 'no label'}, {cell['owner'] or 'nobody'}'s"]
    if kind:
        low, high = kind["voltage_V"]
        lines.append(
            f"  {_type_name(cell)}, {kind['chemistry']}: {low:g} to {high:g} V, -{kind['discharge_A']:g} to "
            f"{kind['charge_A']:g} A, {kind['temperature_degC'][0]:g} to {kind['temperature_degC'][1]:g} °C "
            f"({kind['source']})"
        )
    lines.append(f"  holds {_capacity(cell) or 'an unknown number of'} Ah; {_where(cell)}")
    lines += [f"  {name}: {value}" for name, value in cell["metadata"].items()]
    lines.append(f"  {cell['n_run']} runs, {cell['n_model']} models, {cell['n_diagnosis']} diagnoses")
    return lines


def _where(cell: dict[str, Any]) -> str:
    if cell["retired_utc"] is not None:
        return f"retired on {cell['retired_utc'][:10]}"
    return "on no bench" if cell["bench"] is None else f"on bench {cell['bench']}"


def _type_name(cell: dict[str, Any]) -> str:
    return "" if cell["type"] is None else f"{cell['type']['maker']} {cell['type']['model']}"


def _capacity(cell: dict[str, Any]) -> str:
    capacity_Ah = cell["capacity_Ah"] or (cell["type"] or {}).get("capacity_Ah")
    return "" if capacity_Ah is None else f"{capacity_Ah:g}"


COMMAND = Command("cell", "the cells that there are: take one in, put it on a bench, see its runs", _arguments, _run)
