"""Maps of known cyclers: data files, one for each, recognised by the names of a table's columns."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.units import split_name

GENERIC = "generic"


@dataclass(frozen=True, slots=True)
class CyclerMap:
    """What a cycler's program calls its columns.

    Attributes
    ----------
    name, title, source : of the map; where its facts come from
    requires : for each needed column the names it may have (normalised by `units.split_name`, or `exact`)
    exact : names are compared as they stand
    columns : role -> names it may have, best first, normalised
    units : role -> unit where the file names none
    sign_convention : which sign charges, by its maker; None: not known, or written without a sign
    states : "charge", "discharge", "rest" -> words of the state column
    date_order : of dates such as 03/04/2024 where nothing else tells
    """

    name: str
    title: str
    source: str
    requires: tuple[tuple[str, ...], ...]
    exact: bool
    columns: dict[str, tuple[str, ...]]
    units: dict[str, str]
    sign_convention: str | None
    states: dict[str, tuple[str, ...]]
    date_order: str | None

    def fits(self, names: Sequence[str]) -> bool:
        """Whether a table with these columns comes from this cycler."""
        there = set(names) if self.exact else {split_name(name)[0] for name in names}
        return all(there.intersection(choices) for choices in self.requires)


@cache
def cycler_maps() -> dict[str, CyclerMap]:
    """Every map by name."""
    found = {}
    for path in sorted(files("bench_service.exchange.foreign").joinpath("maps").iterdir(), key=lambda path: path.name):
        if path.name.endswith(".json"):
            document = json.loads(path.read_text(encoding="utf-8"))
            each = CyclerMap(
                name=document["name"],
                title=document["title"],
                source=document["source"],
                requires=tuple(tuple(choices) for choices in document["requires"]),
                exact=document.get("exact", False),
                columns={role: tuple(names) for role, names in document["columns"].items()},
                units=document["units"],
                sign_convention=document["sign_convention"],
                states={state: tuple(words) for state, words in document["states"].items()},
                date_order=document["date_order"],
            )
            found[each.name] = each
    return found


def recognise(names: Sequence[str]) -> CyclerMap:
    """Return the map that asks for most of these columns; the generic one fits everything."""
    fitting = [each for each in cycler_maps().values() if each.fits(names)]
    return max(fitting, key=lambda each: (each.exact, len(each.requires)))


def cycler_map(name: str, where: str) -> CyclerMap:
    """Return the map of a name; raises RunFileError naming those there are."""
    maps = cycler_maps()
    if name not in maps:
        raise RunFileError(f"{where}: format {name!r} is not known; choose from {', '.join(sorted(maps))}")
    return maps[name]
