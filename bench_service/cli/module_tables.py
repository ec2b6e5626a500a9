"""Tables of a module: the models S1 to S4 side by side, and what differs from group to group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

if TYPE_CHECKING:
    from rich.console import Console


_ERRORS = {
    "train": "training mV",
    "held_out_rmse_mV": "left out mV",
    "validation": "validation mV",
    "overall": "RMSE mV",
}


def show_module(console: Console, module: Mapping[str, Any]) -> None:
    """Print what an answer says of a module."""
    console.print(kinds_table(module))
    if module["groups"]:
        console.print(groups_table(module["groups"]))
        weak = module["weak_group"]
        console.print("no group is weaker than the others for sure" if weak is None else f"weak: {weak['text']}")


def kinds_table(module: Mapping[str, Any]) -> Table:
    """Error of each module model, of a fit or of a comparison, with R and V_0 where they were identified."""
    table = Table(title="Module models", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("model")
    parts = [part for part in _ERRORS if _has(module["models"], part)]
    for part in parts:
        table.add_column(_ERRORS[part], justify="right")
    told = _has(module["models"], "resistance_Ohm")
    for label in ("R mOhm", "V0 mV") if told else ():
        table.add_column(label, justify="right")
    for each in module["models"]:
        errors = [each[part] if part == "held_out_rmse_mV" else each[part]["rmse_mV"] for part in parts]
        beside = [_pair(each["resistance_Ohm"]), _pair(each["offset_V"])] if told else []
        name = each["kind"] + (" (taken)" if each["kind"] == module["chosen"] else "")
        table.add_row(name, *(f"{error:.1f}" for error in errors), *beside)
    return table


def groups_table(groups: Sequence[Mapping[str, Any]]) -> Table:
    """What differs in each group."""
    table = Table(title="Groups in series", title_justify="left", box=box.SIMPLE_HEAD)
    from_mean = ("SoC from the mean when full %", "R from the mean mOhm")
    for label in ("group", "capacity Ah", *from_mean, "empty after Ah", "lowest V"):
        table.add_column(label, justify="right")
    for each in groups:
        cells = [
            _value(each["capacity_Ah"], 1.0, 2),
            _value(each["soc_offset"], 100.0, 1),
            _value(each["resistance_Ohm"], 1e3, 3),
            _value(each["until_empty_Ah"], 1.0, 2),
        ]
        table.add_row(str(each["group"]), *cells, f"{each['lowest_V']:.3f}")
    return table


def _has(models: Sequence[Mapping[str, Any]], part: str) -> bool:
    return all(each.get(part) is not None for each in models)


def _pair(both: Mapping[str, Mapping[str, float]]) -> str:
    """A value for charge and one for discharge, or one for both."""
    charge, discharge = _value(both["charge"], 1e3, 3), _value(both["discharge"], 1e3, 3)
    return charge if charge == discharge else f"charge {charge}, discharge {discharge}"


def _value(found: Mapping[str, float], factor: float, digits: int) -> str:
    return f"{factor * found['value']:.{digits}f} +- {factor * found['std']:.{digits}f}"
