"""Steps and cycles as tables: what each has moved, from the rows of the stream ``steps``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench_service.protocol.counters import Ending

_SUMS = ("duration_s", "charged_Ah", "discharged_Ah", "charged_Wh", "discharged_Wh")


def step_table(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one object for each step that was played.

    Parameters
    ----------
    columns : mapping of str to sequence
        The stream's columns, of one run or of several that go on from each other, in order. A step that was cut off
        and taken up again counts once, as it ended at last.
    """
    if not columns:
        return []
    names = list(columns)
    last: dict[int, dict[str, Any]] = {}
    for values in zip(*(_plain(columns[name]) for name in names), strict=True):
        row = dict(zip(names, values, strict=True))
        row["ended_by"] = Ending(row["ended_by"]).name.lower()
        row["end_time_s"] = row.pop("time_s")
        last[row["step_count"]] = row
    return [last[count] for count in sorted(last)]


def cycle_table(steps: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one object for each cycle: sums over its steps, mean voltages and efficiencies (None without charge).

    A cycle that begins part charged gives more than it takes; what came out of what went in says nothing there, so
    that its efficiencies are None, and `begun_part_charged` is true.
    """
    cycles: dict[int, dict[str, Any]] = {}
    for step in steps:
        count = step["cycle_count"]
        cycle = cycles.setdefault(count, {"cycle_count": count, "n_steps": 0, **dict.fromkeys(_SUMS, 0.0)})
        cycle["n_steps"] += 1
        for name in _SUMS:
            cycle[name] += step[name]
        cycle["cut_off"] = step["ended_by"] == Ending.RUN_ENDED.name.lower()
    for cycle in cycles.values():
        cycle["mean_charge_voltage_V"] = _ratio(cycle["charged_Wh"], cycle["charged_Ah"])
        cycle["mean_discharge_voltage_V"] = _ratio(cycle["discharged_Wh"], cycle["discharged_Ah"])
        coulombic = _ratio(cycle["discharged_Ah"], cycle["charged_Ah"])
        more_came_out = coulombic is not None and coulombic > _MOST_EFFICIENCY
        cycle["coulombic_efficiency"] = None if more_came_out else coulombic
        cycle["energy_efficiency"] = None if more_came_out else _ratio(cycle["discharged_Wh"], cycle["charged_Wh"])
        # One that was cut off may have been about to charge.
        cycle["begun_part_charged"] = more_came_out and not cycle["cut_off"]
    return [cycles[count] for count in sorted(cycles)]


# Less than this is noise of a current that rests.
_LEAST = 1e-3
# More than sensors and a change of temperature make of an efficiency of 1.
_MOST_EFFICIENCY = 1.05


def _ratio(over: float, under: float) -> float | None:
    return over / under if under > _LEAST and over > _LEAST else None


def _plain(values: Any) -> list[Any]:
    return values.tolist() if hasattr(values, "tolist") else list(values)
