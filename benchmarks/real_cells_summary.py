"""What the rows of the scoreboard say together, and how they are shown; used by `real_cells.py`."""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

Row = dict[str, Any]

# `auto` counts as good as the best single structure up to this factor.
CLOSE = 1.05
# A record whose band holds this share of all its samples.
HELD = 0.80
PARTS = ("inside", "outside")
_NOT_SINGLE = "auto"


def summary(rows: list[Row], networks: Iterable[str]) -> Row:
    """Figures over all rows.

    Parameters
    ----------
    rows : one for each record, split and structure
    networks : structures that `auto` could have taken; circuits and peers are none

    Returns
    -------
    dict
        `structures`: by structure rows, failures, pooled bands, expected error and worst read-outs; `auto`: in how many
        pairs of record and split it comes close to the best single structure.
    """
    by_structure = _grouped(rows, lambda row: row["structure"])
    return {
        "structures": {name: _of_structure(own) for name, own in by_structure.items()},
        "auto": auto_against_best(rows, set(networks) - {_NOT_SINGLE}),
    }


def auto_against_best(rows: list[Row], single: set[str]) -> Row:
    """In how many pairs of record and split `auto` is within `CLOSE` of the best single structure."""
    pairs, far = 0, []
    for (record, split), own in _grouped(rows, lambda row: (row["record"], row["split"])).items():
        errors = {row["structure"]: row["held_out_rmse_mV"] for row in own if not row["error"]}
        others = {name: error for name, error in errors.items() if name in single and error is not None}
        asked = {row["structure"] for row in own}
        if not others or _NOT_SINGLE not in asked:
            continue
        pairs += 1
        best, auto = min(others, key=lambda name: others[name]), errors.get(_NOT_SINGLE)
        if auto is None or auto > CLOSE * others[best]:
            far.append({"record": record, "split": split, "auto_mV": auto, "best": best, "best_mV": others[best]})
    return {
        "pairs": pairs,
        "close": pairs - len(far),
        "share": (pairs - len(far)) / pairs if pairs else None,
        "far": far,
    }


def pooled(rows: list[Row]) -> Row:
    """Bands over all samples of several rows: coverage, and mean half width over RMSE, inside and outside."""
    found: Row = {}
    for part in PARTS:
        known = [row[part] for row in rows if row.get(part, {}).get("coverage") is not None]
        n = np.array([each["n"] for each in known], dtype=float)
        if not n.sum():
            continue
        mean = {name: float(n @ [each[name] for each in known] / n.sum()) for name in ("coverage", "half_width_mV")}
        rmse_mV = float(np.sqrt(n @ [each["rmse_mV"] ** 2 for each in known] / n.sum()))
        found[part] = {
            "n": int(n.sum()),
            **mean,
            "rmse_mV": rmse_mV,
            "width_over_rmse": mean["half_width_mV"] / max(rmse_mV, 1e-9),
        }
    return found


def expected_off(rows: list[Row], name: str = "expected_rmse_mV") -> float | None:
    """Median of |expected / held out - 1|, over all judged samples; None where nothing was expected.

    Parameters
    ----------
    name : of what was expected: by the fit of any run, or by `compare` of the judged ones
    """
    off = [
        abs(row[name] / row["held_out_all_rmse_mV"] - 1.0)
        for row in rows
        if row.get(name) is not None and row.get("held_out_all_rmse_mV")
    ]
    return float(np.median(off)) if off else None


def show(rows: list[Row], found: Row) -> None:
    """Print every row, then the summary."""
    # A table of this many columns, cut to the 80 of a file, says nothing.
    console = Console(width=None if sys.stdout.isatty() else 220)
    console.print(_table(rows))
    for row in rows:
        if len(row.get("runs") or {}) > 1:
            listed = ", ".join(f"{run} {_text(rmse_mV)}" for run, rmse_mV in row["runs"].items())
            console.print(f"{row['record']} {row['split']} {row['structure']}: {listed} mV", soft_wrap=True)
    for row in rows:
        for spell in row.get("far_inside") or []:
            where = f"{row['record']} {row['split']} {row['structure']}"
            console.print(f"{where}: far off inside: {far_line(spell)}", soft_wrap=True)
    for row in rows:
        if row["error"]:
            console.print(f"{row['record']} {row['split']} {row['structure']}: {row['error']}", soft_wrap=True)
    console.print(_pooled_table(found["structures"]))
    auto = found["auto"]
    if auto["pairs"]:
        console.print(f"auto within {CLOSE - 1.0:.0%} of the best single structure: {auto['close']} of {auto['pairs']}")
        for far in auto["far"]:
            errors = f"auto {_text(far['auto_mV'])}, {far['best']} {far['best_mV']:.1f} mV"
            console.print(f"  {far['record']} {far['split']}: {errors}", soft_wrap=True)


def line(row: Row) -> str:
    """One row in a few words, for somebody who waits."""
    where = f"{row['record']} {row['split']} {row['structure']}"
    if row["error"]:
        return f"{where}: {row['error']}"
    judged_mV = row["held_out_rmse_mV"] if row["held_out_rmse_mV"] is not None else row["held_out_all_rmse_mV"]
    return f"{where}: {judged_mV:.1f} mV, {row['seconds']:.1f} s"


def far_line(spell: Row) -> str:
    """One spell in a line."""
    degC = "" if spell["temperature_degC"] is None else f", {_range(spell['temperature_degC'], '.0f')} degC"
    return (
        f"{spell['run']} {spell['from_s']:.0f}..{spell['to_s']:.0f} s: {spell['samples']} samples "
        f"({spell['share']:.2%}), SoC {_range(spell['soc'], '.3f')}, {_range(spell['current_A'], '.2f')} A{degC}: "
        f"{spell['error_mV']:+.0f} mV, {spell['mV_per_percent']:.0f} mV a percent of charge: a slip of "
        f"{spell['slip_percent']:+.2f} %, or {spell['resistance_mOhm']:+.0f} mOhm"
    )


def _range(pair: list[float], form: str) -> str:
    return f"{pair[0]:{form}}..{pair[1]:{form}}"


def _of_structure(rows: list[Row]) -> Row:
    judged = [row for row in rows if not row["error"]]
    by_record = {name: pooled(own) for name, own in _grouped(judged, lambda row: row["record"]).items()}
    covered = {name: share for name, bands in by_record.items() if (share := _overall(bands)) is not None}
    return {
        "rows": len(rows),
        "failed": len(rows) - len(judged),
        "bands": pooled(judged),
        "records": {"coverage": covered, "held": sum(share >= HELD for share in covered.values())},
        "expected_off": expected_off(judged),
        "expected_here_off": expected_off(judged, "expected_here_rmse_mV"),
        "worst_negative": _worst(judged, "negative"),
        "worst_falling": _worst(judged, "falling"),
        "worst_inside_mV": max((row["inside"]["max_mV"] for row in judged if _has_inside(row)), default=None),
        "seconds": sum(row["seconds"] for row in judged),
    }


def _has_inside(row: Row) -> bool:
    return bool(row.get("inside", {}).get("n"))


def _overall(bands: Row) -> float | None:
    """Coverage over the samples inside and outside."""
    n = sum(bands[part]["n"] for part in bands)
    return sum(bands[part]["n"] * bands[part]["coverage"] for part in bands) / n if n else None


def _worst(rows: list[Row], name: str) -> Row | None:
    """The row with the most read-outs of an impossible kind, and how many rows have any."""
    counted = [row for row in rows if row.get("impossible")]
    if not counted:
        return None
    worst = max(counted, key=lambda row: row["impossible"][name])
    any_of_them = sum(row["impossible"][name] > 0 for row in counted)
    at = {key: worst[key] for key in ("record", "split")} if any_of_them else {}
    return {"count": worst["impossible"][name], "rows": any_of_them, **at}


def _grouped(rows: list[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    found: dict[Any, list[Row]] = defaultdict(list)
    for row in rows:
        found[key(row)].append(row)
    return found


_COLUMNS: tuple[tuple[str, Callable[[Row], Any]], ...] = (
    ("held out / mV", lambda row: row.get("held_out_rmse_mV")),
    ("99.9 %", lambda row: row.get("p999_mV")),
    ("all SoC", lambda row: row.get("held_out_all_rmse_mV")),
    ("training", lambda row: row.get("train_rmse_mV")),
    ("expected", lambda row: row.get("expected_rmse_mV")),
    ("here", lambda row: row.get("expected_here_rmse_mV")),
    ("99.9 % inside", lambda row: row.get("inside", {}).get("p999_mV")),
    ("max inside", lambda row: row.get("inside", {}).get("max_mV")),
    ("rmse inside", lambda row: row.get("inside", {}).get("rmse_mV")),
    ("outside", lambda row: row.get("outside", {}).get("rmse_mV")),
    ("band inside", lambda row: _band(row.get("inside", {}))),
    ("outside", lambda row: _band(row.get("outside", {}))),
    ("R < 0", lambda row: _share(row.get("impossible"), "negative")),
    ("OCV falls", lambda row: _share(row.get("impossible"), "falling")),
    ("s", lambda row: row.get("seconds")),
)


def _table(rows: list[Row]) -> Table:
    table = Table(title="Free run on runs that no fit saw")
    for name in ("record", "split", "structure"):
        table.add_column(name)
    for name, _ in _COLUMNS:
        table.add_column(name, justify="right")
    for row in rows:
        figures = ["failed"] if row["error"] else [_text(value(row)) for _, value in _COLUMNS]
        table.add_row(row["record"], row["split"], row["structure"], *figures)
    return table


def _pooled_table(structures: dict[str, Row]) -> Table:
    table = Table(title=f"Pooled; band: share in it, mean half width over RMSE; records: with {HELD:.0%} in the band")
    names = ("structure", "rows", "failed", "band inside", "outside", "records", "|expected/held out - 1|, here")
    for name in (*names, "most R < 0", "most OCV falls", "max inside / mV", "s"):
        table.add_column(name, justify="left" if name == "structure" else "right")
    for name, found in structures.items():
        table.add_row(
            name,
            str(found["rows"]),
            str(found["failed"]),
            *(_band(found["bands"].get(part, {})) or "-" for part in PARTS),
            f"{found['records']['held']} of {len(found['records']['coverage'])}",
            ", ".join(_off(found[name]) for name in ("expected_off", "expected_here_off")),
            *(_count(found[f"worst_{kind}"]) for kind in ("negative", "falling")),
            _text(found["worst_inside_mV"]),
            f"{found['seconds']:.0f}",
        )
    return table


def _off(share: float | None) -> str:
    return "-" if share is None else f"{share:.2f}"


def _band(part: Row) -> str | None:
    return f"{part['coverage']:.0%}, {part['width_over_rmse']:.1f}x" if "coverage" in part else None


def _share(impossible: Row | None, name: str) -> str | None:
    return None if impossible is None else f"{impossible[name]} ({impossible[f'{name}_share']:.1%})"


def _count(worst: Row | None) -> str:
    return "-" if worst is None else f"{worst['count']} ({worst['rows']} rows)"


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.1f}" if isinstance(value, float) else str(value)
