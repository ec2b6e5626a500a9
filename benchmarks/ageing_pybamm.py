"""Cells of an electrochemical simulator that lost lithium or material, or grew a resistance, by known amounts.

``python benchmarks/ageing_pybamm.py --pybamm-python PATH [--cases 60] [--nulls 20] [--seed 0] [--keep FOLDER]
[--rows FILE] [--json]``

PATH is the Python of an environment with PyBaMM, which this one need not have. Of each case (published parameter set,
constants moved at random, rates, temperature, constant currents or a drive cycle, sensors) two fresh cycles make the
model; then one fresh cycle, one aged by half and one aged by the whole amount are followed as one series, each as two
files, a charge and a discharge, with a minute of rest. Every case follows from (seed, number). Records are kept in
FOLDER, rows go to FILE as soon as they are there, and a second call goes on.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from row_file import add_row, read_rows
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray, TimeSeries
from models.diagnosis.trend.life import Places, RunTrend
from models.diagnosis.trend.trend import trend
from models.pipeline.fit import fit_network

Row = dict[str, Any]
WORKER = Path(__file__).parent / "ageing_worker.py"
PARAMETERS: tuple[str, ...] = ("Chen2020", "OKane2022", "Mohtat2020", "Marquis2019", "Ecker2015", "NCA_Kim2011")
NOMINAL_AH: dict[str, float] = dict(zip(PARAMETERS, (5.0, 5.0, 5.0, 0.68, 0.156, 0.43), strict=True))
KINDS = ("lithium", "negative", "positive", "resistance", "sei")
# Effect and parameter that are right, of each kind.
RIGHT = {
    "lithium": ("lithium_loss", "share_lost"),
    "negative": ("active_material_loss", "share_lost of the negative electrode"),
    "positive": ("active_material_loss", "share_lost of the positive electrode"),
    "resistance": ("resistance", ""),
    "sei": ("lithium_loss", "share_lost"),
}
RESISTANCES = ("resistance", "series_resistance", "resistance_growth")
_MOVED = {
    **{f"{name} particle radius [m]": 0.25 for name in ("Negative", "Positive")},
    **{f"{name} particle diffusivity [m2.s-1]": 0.4 for name in ("Negative", "Positive")},
    **{f"{name} electrode exchange-current density [A.m-2]": 0.4 for name in ("Negative", "Positive")},
    **{f"{name} electrode thickness [m]": 0.06 for name in ("Negative", "Positive")},
}
_DRIVE_S, _LONGEST_S = 10, 14400
_FRESH = {"lithium_lost": 0.0, "negative_lost": 0.0, "positive_lost": 0.0}
_WITHIN = 0.2
# Longer than that a simulation that goes well does not take, even on a busy machine.
_MOST_S = 900


def request_of(seed: int, number: int, kind: str) -> Row:
    """What a case is made of: cell, cycles and the states that it goes through."""
    rng = np.random.default_rng([seed, number])
    parameters = str(rng.choice(PARAMETERS))
    fresh_Ohm, film_Ohm = (rng.uniform(*mV) * 1e-3 / NOMINAL_AH[parameters] for mV in ((3.0, 8.0), (1.0, 4.0)))
    drive = bool(rng.random() < 0.4)
    whole = _amounts(kind, rng, NOMINAL_AH[parameters])
    states = []
    for share, cycles in ((0.0, 3), (0.5, 1), (1.0, 1)):
        grown = {name: share * size for name, size in whole.items()}
        grown |= {"contact_Ohm": fresh_Ohm + grown["contact_Ohm"], "film_Ohm": film_Ohm + grown["film_Ohm"]}
        if share == 0.0 or kind != "none":
            states.append({**grown, "cycles": cycles})
    return {
        "kind": kind,
        "parameters": parameters,
        "factors": {name: float(np.exp(spread * rng.uniform(-1.0, 1.0))) for name, spread in _MOVED.items()},
        "ambient_degC": float(rng.uniform(15.0, 35.0)),
        "cooling_W_per_m2_K": float(rng.uniform(5.0, 30.0)),
        "model": "DFN" if rng.random() < 0.4 else "SPMe",
        "charge_C": float(rng.choice([0.3, 0.5, 0.7, 1.0])),
        "discharge_C": float(rng.choice([0.3, 0.5, 1.0])),
        "rest_s": int(rng.choice([1200, 2400, 3600])),
        "drive_C": drive_C(rng).tolist() if drive else None,
        "states": states,
    }


def _amounts(kind: str, rng: np.random.Generator, nominal_Ah: float) -> dict[str, float]:
    out = {**_FRESH, "contact_Ohm": 0.0, "film_Ohm": 0.0}
    if kind in ("lithium", "sei"):
        out["lithium_lost"] = float(rng.uniform(0.04, 0.14))
    if kind in ("negative", "positive"):
        out[f"{kind}_lost"] = float(rng.uniform(0.08, 0.2))
    if kind == "resistance":
        out["contact_Ohm"] = float(rng.uniform(15e-3, 60e-3)) / nominal_Ah
    if kind == "sei":
        out["film_Ohm"] = float(rng.uniform(3e-3, 15e-3)) / nominal_Ah
    return out


def drive_C(rng: np.random.Generator) -> FloatArray:
    """(n,) discharging current over the capacity in each second: pulses, pauses and some that charge, then again."""
    levels = []
    while len(levels) * _DRIVE_S < _LONGEST_S:
        pulse = rng.choice([0.0, 0.4, 0.8, 1.5, -0.5], p=[0.15, 0.35, 0.3, 0.12, 0.08]) * rng.uniform(0.6, 1.2)
        levels += [pulse] * int(rng.integers(1, 6))
    return np.repeat(levels, _DRIVE_S)


def records_of(request: Row, python: Path, kept: Path) -> dict[str, FloatArray]:
    """Records of a case, made where they are not there yet."""
    if not kept.exists():
        with tempfile.TemporaryDirectory() as folder:
            asked, made = Path(folder) / "request.json", Path(folder) / "records.npz"
            asked.write_text(json.dumps(request))
            subprocess.run(
                [str(python), str(WORKER), str(asked), str(made)], check=True, stdout=sys.stderr, timeout=_MOST_S
            )
            kept.write_bytes(made.read_bytes())
    with np.load(kept) as file:
        return dict(file)


def measured(columns: FloatArray, request: Row, name: str, rng: np.random.Generator, gain: float) -> TimeSeries:
    """A record as a bench reads it."""
    time_s, current_A, voltage_V, degC = columns.T
    n, amps = len(time_s), NOMINAL_AH[request["parameters"]]

    def read(values: FloatArray, noise: float, step: float) -> FloatArray:
        return step * np.round((values + noise * rng.standard_normal(n)) / step)

    return TimeSeries(
        time_s,
        read(gain * current_A, 2e-4 * amps, 2e-5 * amps),
        read(voltage_V, 5e-4, 1e-4),
        read(degC, 0.05, 0.01),
        np.full(n, request["ambient_degC"]),
        name=name,
    )


def judged(request: Row, records: dict[str, FloatArray], seed: int, number: int, structure: str) -> Row:
    """What a trend says of a case."""
    rng = np.random.default_rng([seed, number, 7])
    gain = 1.0 + 1e-3 * rng.standard_normal()
    runs = {
        name: measured(columns, request, name, rng, gain) for name, columns in records.items() if name != "capacity_Ah"
    }
    train = [name for name in runs if name.startswith(("0_0_", "0_1_"))]
    life = [name for name in runs if name not in train]
    soc = [0.0 if name.endswith("_charge") else 1.0 for name in (*train, *life)]
    counted_Ah = float(np.mean([abs(np.trapezoid(runs[k].current_A, runs[k].time_s)) / 3600.0 for k in train]))
    given = [runs[name] for name in train]
    known = soc[: len(train)]
    network = fit_network(given, capacity_Ah=counted_Ah, initial_soc=known, structure=structure).network
    # Charge and discharge of a cycle are at one place of the life.
    places = Places([float(number) for number in np.repeat(np.arange(len(life) // 2), 2)], "state")
    judge = [runs[name] for name in life]
    found = trend(network, judge, soc[len(train) :], train=given, train_soc=known, places=places)
    said = [_said(each) for each in found.runs]
    last, whole = said[-1], request["states"][-1]
    row = {
        **{name: request[name] for name in ("kind", "parameters", "model", "charge_C", "discharge_C")},
        "drive": request["drive_C"] is not None,
        "false": [bool(each["named"]) for each, name in zip(said, life, strict=True) if name.startswith("0_")],
        "said": said,
        "first": last["named"][0] if last["named"] else last["verdict"],
    }
    return row | (beside_truth(row, last, whole, request) if request["kind"] != "none" else {})


def beside_truth(row: Row, last: Row, whole: Row, request: Row) -> Row:
    """What is named last beside the truth, and whether it is right and close."""
    kind = request["kind"]
    effect, parameter = RIGHT[kind]
    truth = whole[{"sei": "lithium_lost"}.get(kind, f"{kind}_lost")] if kind != "resistance" else None
    if kind == "resistance":
        truth = whole["contact_Ohm"] - request["states"][0]["contact_Ohm"]
        own = [v for name, v in zip(last["named"], last["values"], strict=True) if name in RESISTANCES]
        told = own[0].get("half_Ohm") if own else None
        right = row["first"] in RESISTANCES
    else:
        own = [v for name, v in zip(last["named"], last["values"], strict=True) if name == effect]
        told = own[0].get(parameter) if own else None
        right = row["first"] == effect and told is not None
    close = told is not None and truth is not None and abs(told / truth - 1.0) <= _WITHIN
    return {"truth": truth, "told": told, "right": right, "close": close}


def _said(told: RunTrend) -> Row:
    findings = told.diagnosis.findings
    return {
        "verdict": told.diagnosis.verdict,
        "named": [each.effect for each in findings],
        "values": [{name: value.value for name, value in each.parameters.items()} for each in findings],
    }


def rows_of(options: argparse.Namespace) -> Iterator[Row]:
    """Rows of all cases, those of an earlier call first."""
    there = {row["number"]: row for row in read_rows(options.rows) if row["seed"] == options.seed}
    kinds = [KINDS[k % len(KINDS)] for k in range(options.cases)] + ["none"] * options.nulls
    options.keep.mkdir(parents=True, exist_ok=True)
    for number, kind in enumerate(kinds):
        if number not in there:
            request = request_of(options.seed, number, kind)
            kept = options.keep / f"{options.seed}_{number}_{kind}.npz"
            try:
                records = records_of(request, options.pybamm_python, kept)
            except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
                print(f"{number} {kind}: the simulator found no solution; left out", file=sys.stderr)
                continue
            if options.records_only:
                continue
            row = {"seed": options.seed, "number": number}
            row |= judged(request, records, options.seed, number, options.structure)
            add_row(options.rows, row)
            there[number] = row
        if number in there:
            yield there[number]


def told(rows: list[Row]) -> Row:
    """Shares that are right, close and false, over all cases and by kind."""
    every = [row for row in rows if row["kind"] != "none"]
    out: Row = {"cases": len(every), "fresh_runs": sum(len(row["false"]) for row in rows)}
    out["false"] = sum(sum(row["false"]) for row in rows)
    groups = {"all": every} | {kind: [row for row in every if row["kind"] == kind] for kind in KINDS}
    groups |= {"drive": [row for row in every if row["drive"]]}
    groups |= {name: [row for row in every if row["parameters"] == name] for name in PARAMETERS}
    for name, group in groups.items():
        if group:
            right, close = (sum(row[key] for row in group) for key in ("right", "close"))
            out[name] = f"named first {right}, close {close} of {len(group)}"
    return out


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pybamm-python", type=Path, required=True, metavar="PATH")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--nulls", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--structure", default="bounded")
    parser.add_argument("--keep", type=Path, default=Path("ageing-records"), help="folder of the records")
    parser.add_argument("--records-only", action="store_true", help="make the records, judge nothing")
    parser.add_argument("--rows", type=Path, help="file of the rows; a second call goes on there")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args()
    rows = []
    with threadpool_limits(1):
        for row in rows_of(options):
            rows.append(row)
            brief = {name: row.get(name) for name in ("number", "kind", "parameters", "first", "truth", "told")}
            print(json.dumps(brief), file=sys.stderr, flush=True)
    found = told(rows)
    print(json.dumps(found) if options.json else "\n".join(f"{name}: {each}" for name, each in found.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
