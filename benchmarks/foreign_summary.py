"""Shares of `diagnosis_foreign.py` by family, and their tables."""

from typing import Any

import numpy as np
from diagnosis_cases import UNKNOWN, Row, above_power
from rich.console import Console
from rich.table import Table

SURE, MOST_RIVALS = 0.9, 3
# What shows in the temperature.
THERMAL = ("heat_transfer", "temperature_sensor")
_EDGES = (0.0, 0.5, 0.7, 0.9, 1.01)


def summary(rows: list[Row]) -> dict[str, Any]:
    """Figures of each family and of all."""
    families = list(dict.fromkeys(row["family"] for row in rows))
    groups = [(family, [row for row in rows if row["family"] == family]) for family in families]
    return {name: figures(part) for name, part in [*groups, ("all", rows)]}


def figures(rows: list[Row]) -> dict[str, Any]:
    """Figures of some rows.

    A false alarm is any claim on a log without a change, `unknown_effect` included. A case is not misled where the
    first name is right, where the verdict is `ambiguous` with the truth among at most three, or where it is
    `unknown_effect`. `above_power` counts only cases whose size is above the stated power, as far as it is stated.
    """
    nulls, cases = [row for row in rows if not row["truth"]], [row for row in rows if row["truth"]]
    loud = [row for row in cases if above_power(row)]
    sized = [row["size"] for row in cases if row["size"] is not None]
    return {
        "nulls": len(nulls),
        "false_alarms": sum(not row["right"] for row in nulls),
        "cases": len(cases),
        "named_first": sum(row["right"] for row in cases),
        "not_misled": sum(not_misled(row) for row in cases),
        "nothing_found": sum(row["verdict"] == "nothing_missing" for row in cases),
        "above_power": {
            "cases": len(loud),
            "named_first": sum(row["right"] for row in loud),
            "not_misled": sum(not_misled(row) for row in loud),
        },
        "wrong_above_0.9": sum(wrong_and_sure(row) for row in rows),
        "sizes": len(sized),
        "sizes_within_two_std": sum(abs(each["value"] - each["true"]) <= 2.0 * each["std"] for each in sized),
        "reliability": _reliability(rows),
        "longest_s": max((row["diagnosis_s"] for row in rows), default=0.0),
        "by_effect": {
            name: [sum(row["right"] for row in part), len(part)]
            for name in sorted({"|".join(row["truth"]) for row in cases})
            if (part := [row for row in cases if "|".join(row["truth"]) == name])
        },
    }


def not_misled(row: Row) -> bool:
    """Whether a technician would not look in the wrong place."""
    among = row["ambiguous_with_truth"] and len(row["rivals"]) < MOST_RIVALS
    return bool(row["right"] or among or row["named"][0] == UNKNOWN)


def wrong_and_sure(row: Row) -> bool:
    """Whether the first name is wrong with more confidence than 0.9."""
    return bool(not row["right"] and row["confidence"] and row["confidence"][0] > SURE)


def _reliability(rows: list[Row]) -> list[dict[str, Any]]:
    """Of the first names in each range of confidence: how many, how sure, how many right."""
    pairs = [(row["confidence"][0], bool(row["right"])) for row in rows if row["confidence"]]
    out = []
    for low, high in zip(_EDGES[:-1], _EDGES[1:], strict=True):
        inside = [pair for pair in pairs if low <= pair[0] < high]
        if inside:
            sure, right = np.mean(inside, axis=0)
            out.append({"from": low, "to": min(high, 1.0), "findings": len(inside), "sure": sure, "right": right})
    return out


def show(result: dict[str, Any]) -> None:
    """Print one row for each family, then reliability and effects."""
    table = Table(title="Diagnosis outside of the models' class, change mode")
    for heading in (
        "family",
        "false alarms",
        "named first",
        "not misled",
        "above power",
        "of these first",
        "of these not misled",
        "nothing found",
        "wrong above 0.9",
        "sizes within 2 std",
        "longest",
    ):
        table.add_column(heading, justify="left" if heading == "family" else "right")
    for name, each in result.items():
        table.add_row(
            name,
            f"{each['false_alarms']} of {each['nulls']}",
            f"{each['named_first']} of {each['cases']}",
            f"{each['not_misled']} of {each['cases']}",
            f"{each['above_power']['cases']} of {each['cases']}",
            str(each["above_power"]["named_first"]),
            str(each["above_power"]["not_misled"]),
            str(each["nothing_found"]),
            str(each["wrong_above_0.9"]),
            f"{each['sizes_within_two_std']} of {each['sizes']}",
            f"{each['longest_s']:.1f} s",
        )
    console = Console(width=190)
    console.print(table)
    for name, each in result.items():
        bins = ", ".join(
            f"{b['from']:.1f}..{b['to']:.1f}: {b['findings']} findings, sure {b['sure']:.2f}, right {b['right']:.2f}"
            for b in each["reliability"]
        )
        console.print(f"{name}: {bins or 'no finding'}", highlight=False)
        right = ", ".join(f"{effect} {n} of {m}" for effect, (n, m) in each["by_effect"].items())
        console.print(f"    right: {right or 'no case'}", highlight=False)
