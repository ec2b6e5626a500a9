"""A cell's life from ordinary CC-CV cycles of cells outside of the models' class: what is named, and how often falsely.

``python benchmarks/trend_cases.py [--families particle,spread] [--cells 6] [--seed 0] [--two-stage] [--json]``

Of each cell (all constants random, see `foreign_cells`) two fresh cycles make what is known of it; then a life of
seven cycles is followed as one series, each cycle as two files, a charge and a discharge: two fresh ones, three with
one kind of change that grows, or both, or none. Full is the end of a charge that held its voltage, empty the end of a
discharge, whatever has changed. With `--two-stage` a charge goes on with less current from some voltage below the end
on, and holds the end's voltage last.
"""

import argparse
import json
import sys
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from foreign_cells import TRUTHS, Rig, changed, random_rig
from threadpoolctl import threadpool_limits

from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.likelihood.learning import know
from models.diagnosis.trend.alarms import claimed
from models.diagnosis.trend.estimate import seen, weighed
from models.diagnosis.trend.series import agreed, likeliest_set, smoothed, together
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weights.weighing import Chances
from models.effects import effects
from models.identification.bounded.variants import Variant

_RATE, _TAPER, _REST_S, _LONGEST_S = 1.0, 0.05, 60, 9000
# The second stage of a charge: from so far below its end on, and its current over that of the first.
_STAGE_V, _STAGE = 0.08, 0.4
# Change of each of the seven cycles, in units where 1 is large.
_GROWS = (0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.3)
LIVES = {
    "none": (),
    "capacity": ("capacity",),
    "resistance": ("series_resistance",),
    "both": ("capacity", "series_resistance"),
}
# A series resistance of 1 is 30 mV at 1C; what grows in a life is twice that.
_SIZE = {"capacity": 1.0, "series_resistance": 2.0}


@dataclass(frozen=True)
class Window:
    """How a cell is cycled, as it ages, too.

    Attributes
    ----------
    low_V, high_V : at which discharge and charge end
    most_A : largest current
    stage_V : from which on a charge goes on with the current of its second stage; infinite: there is none
    """

    low_V: float
    high_V: float
    most_A: float
    stage_V: float = np.inf


def window_of(rig: Rig, two_stage: bool = False) -> Window:
    """Voltages of the fresh cell at rest, nearly empty and nearly full, with room for the load."""
    low, high = (
        TRUTHS[rig.family].make(rig.constants, soc, rig.ambient_degC).step(0.0, 0.0)[0] for soc in (0.04, 0.985)
    )
    stage_V = float(high) - _STAGE_V if two_stage else np.inf
    return Window(float(low) - 0.1, float(high), _RATE * rig.constants.capacity_Ah, stage_V)


def cycle(rig: Rig, window: Window, seed: int) -> list[TimeSeries]:
    """A charge from empty and a discharge from full, as two files."""
    cell = TRUTHS[rig.family].make(rig.constants, 0.5, rig.ambient_degC)
    rng = np.random.default_rng([seed, 5])
    _discharged(cell, window)
    rest = _rested(cell, 1200)
    charge = _charged(cell, window)
    between = _rested(cell, 1200)
    discharge = _discharged(cell, window)
    after = _rested(cell, _REST_S)
    files = ([rest[-10:], charge, between[:_REST_S]], [between[-10:], discharge, after])
    return [_read(rig, np.concatenate(parts), rng, f"{seed}.{k}") for k, parts in enumerate(files)]


def _rested(cell: Any, seconds: int) -> FloatArray:
    return np.array([[0.0, *cell.step(0.0, 1.0)[:2]] for _ in range(seconds)])


def _charged(cell: Any, window: Window) -> FloatArray:
    rows, most_A = [], window.most_A
    current_A, slope_Ohm = most_A, 0.06 / most_A
    for _ in range(_LONGEST_S):
        volts, degC = cell.step(current_A, 1.0)[:2]
        rows.append([current_A, volts, degC])
        if volts >= window.stage_V and most_A == window.most_A:
            most_A = current_A = _STAGE * window.most_A
        elif volts >= window.high_V - 1e-3 or current_A < most_A:
            current_A = float(np.clip(current_A + 0.3 * (window.high_V - volts) / slope_Ohm, 0.0, most_A))
            if current_A < _TAPER * window.most_A:
                break
    return np.array(rows)


def _discharged(cell: Any, window: Window) -> FloatArray:
    rows, current_A = [], -window.most_A
    for _ in range(_LONGEST_S):
        volts, degC = cell.step(current_A, 1.0)[:2]
        rows.append([current_A, volts, degC])
        if volts <= window.low_V:
            break
    return np.array(rows)


def _read(rig: Rig, columns: FloatArray, rng: np.random.Generator, name: str) -> TimeSeries:
    current_A, volts, degC = columns.T

    def read(values: FloatArray, sensor: tuple[float, float, float, float]) -> FloatArray:
        offset, gain, noise, step = sensor
        return step * np.round((gain * values + offset + noise * rng.standard_normal(len(values))) / step)

    time_s = np.arange(len(volts), dtype=np.float64)
    ambient = np.full(len(volts), rig.ambient_degC)
    return TimeSeries(
        time_s, read(current_A, rig.amperes), read(volts, rig.volts), read(degC, rig.kelvins), ambient, name=name
    )


def known_of(rig: Rig, window: Window, seed: int) -> tuple[KnownRuns, float]:
    """What two fresh cycles tell, and the capacity that they show."""
    runs = [to_grid(each, 1.0) for k in range(2) for each in cycle(rig, window, 100 * seed + k)]
    capacity_Ah = float(np.mean([np.ptp(run.charge_Ah) for run in runs]))
    return know(runs, [0.0, 1.0] * 2, capacity_Ah, list(effects().values()), Variant()), capacity_Ah


def follow(known: KnownRuns, rig: Rig, window: Window, life: str, seed: int) -> list[dict[str, Any]]:
    """What is said of each run of a life, beside the truth."""
    rows: list[dict[str, Any]] = []
    told: list[Chances] = []
    for number, grown in enumerate(_GROWS):
        now = rig
        for name in LIVES[life]:
            now = changed(now, name, grown * _SIZE[name])
        grids = [to_grid(run, 1.0) for run in cycle(now, window, 1000 * seed + 10 * number + 3)]
        looked = [seen(known, grid, soc, 0.005) for grid, soc in zip(grids, (0.0, 1.0), strict=True)]
        groups = together(known.cell, np.zeros(2), np.array([grid.charge_Ah[-1] for grid in grids]))
        for group in groups:
            own = [weighed(looked[k], looked[1 - k] if len(group) > 1 else None) for k in group]
            told.append(agreed([each.chances for each in own]))
            for k, each in zip(group, own, strict=True):
                off = each.state.capacity_Ah / float(np.ptp(grids[k].charge_Ah)) - 1.0
                rows.append({"life": life, "grown": grown, "capacity_off": off, "told": len(told) - 1})
    which = [row.pop("told") for row in rows]
    by_set = smoothed(told)[which]
    said = claimed(np.array([each.nothing for each in told]), SETTINGS.nothing, SETTINGS.alarms)[which]
    for row, chance, claim in zip(rows, by_set, said, strict=True):
        row["named"] = list(likeliest_set(chance)) if claim else []
    return rows


def told(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares that are right and false, by life."""
    fresh = [row for row in rows if row["grown"] == 0.0 or row["life"] == "none"]
    out: dict[str, Any] = {"false_alarms": _share([bool(row["named"]) for row in fresh]), "fresh_runs": len(fresh)}
    wanted = {"capacity": {"capacity"}, "resistance": {"resistance"}, "both": {"capacity", "resistance"}}
    for life, names in wanted.items():
        aged = [row for row in rows if row["life"] == life and row["grown"] >= 1.0]
        out[life] = {
            "runs": len(aged),
            "exactly": _share([set(row["named"]) == names for row in aged]),
            "among": _share([names <= set(row["named"]) for row in aged]),
            "named": {" + ".join(each) or "nothing": n for each, n in Counter(tuple(r["named"]) for r in aged).items()},
        }
    out["capacity_within_2_percent"] = _share([abs(row["capacity_off"]) <= 0.02 for row in rows])
    return out


def _share(values: list[bool]) -> float:
    return float(np.mean(values)) if values else float("nan")


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", default="particle,spread")
    parser.add_argument("--cells", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--two-stage", action="store_true", help="charges of two currents")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    out = {}
    with threadpool_limits(1):
        for family in options.families.split(","):
            rows = []
            for number in range(options.cells):
                seed = options.seed + number
                rig = replace(random_rig(family, np.random.default_rng([seed, len(family)])), swing_K=0.0)
                window = window_of(rig, options.two_stage)
                known, _ = known_of(rig, window, seed)
                for life in LIVES:
                    rows += follow(known, rig, window, life, seed)
                print(family, number, json.dumps(told(rows)), file=sys.stderr, flush=True)
            out[family] = told(rows)
    print(json.dumps(out) if options.json else "\n".join(f"{name}: {each}" for name, each in out.items()))


if __name__ == "__main__":
    main()
