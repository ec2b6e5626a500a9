"""`bench-service maps`: list device maps, check one's own, write their JSON schema."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "action",
        choices=["list", "check", "schema"],
        help="list the maps that come with the program; check names or files; print the JSON schema for editors",
    )
    parser.add_argument("map", nargs="*", metavar="FILE", help="names or .toml files, for check")


def _run(options: Namespace, output: Output) -> int:
    if options.action == "schema":
        # Lazy: python-can takes 120 ms.
        from drivers.map_schema import map_schema

        schema = map_schema()
        output.result(schema, lambda console: console.print_json(json.dumps(schema)))
        return 0
    from drivers.register_map import list_maps

    if options.action == "check" and not options.map:
        raise UsageError("maps check: name at least one map or .toml file")
    every = options.map if options.action == "check" else [*list_maps(), *list_maps(kind="chamber")]
    maps = [_described(name) for name in every]
    output.result({"maps": maps}, lambda console: _show(console, maps))
    return 0


def _described(name: str) -> dict[str, Any]:
    """Read one map; what is wrong with it ends the command with file, key and reason."""
    # Lazy: python-can takes 130 ms.
    from drivers.map_frames import check_frames
    from drivers.register_map import load_can_map, load_map, map_kind, map_transport

    transport = map_transport(name)
    device_map = load_can_map(name) if transport == "can" else load_map(name, None)
    return {
        "file": str(device_map.file),
        "name": device_map.name,
        "title": device_map.title,
        "kind": map_kind(name),
        "transport": transport,
        "frames": check_frames(device_map),
        "verified_on_hardware": device_map.verified_on_hardware,
        "source": device_map.source,
        "state": "ok",
    }


def _show(console: Console, maps: list[dict[str, Any]]) -> None:

    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("map", "device", "transport", "sample frames", "on hardware", "title"):
        table.add_column(heading, overflow="fold")
    for each in maps:
        seen = "yes" if each["verified_on_hardware"] else "not yet"
        table.add_row(each["name"], each["kind"], each["transport"], f"{each['frames']} agree", seen, each["title"])
    console.print(table)


COMMAND = Command("maps", "list and check the device maps of cyclers and chambers", _arguments, _run)
