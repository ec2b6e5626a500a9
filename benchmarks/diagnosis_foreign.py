"""Change mode on cells outside of the models' class: how often it is right, misled, and wrong and sure of it.

``python benchmarks/diagnosis_foreign.py [--families particle,spread,strands,measured,pybamm,left_out] [--cases 10]
[--nulls 10] [--seed 0] [--effects NAME,...] [--data FOLDER] [--keep FOLDER] [--rows FILE] [--json]``

Families: `particle`, `spread` and `strands` are simulated, see `foreign_cells`; `measured`, `pybamm` and `left_out`
(only where it is asked for) need `--data`, see `foreign_measured`. A bounded network is fitted to the training runs of
each base (kept in `--keep`), then logs without and with one effect are diagnosed beside the training runs. Sizes of
simulated effects are fixed beforehand: the voltage of the judged log changes by 3, 6 or 12 mV (RMS at the same
current), the temperature by 0.5, 1 or 2 K. Every case follows from (family, seed, number); its row goes to `--rows` as
soon as it is judged, and a second call goes on there.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from diagnosis_cases import Row, answered, same, stated_power
from foreign_cells import (
    KINDS,
    TRAIN_S,
    Plan,
    Rig,
    changed,
    effects_of,
    logged,
    make_plan,
    random_rig,
    stated_soc,
    true_columns,
    true_size,
)
from foreign_measured import Records, left_out_records, measured_records, pybamm_records
from foreign_summary import THERMAL, show, summary
from row_file import add_row, read_rows
from threadpoolctl import threadpool_limits

from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.diagnosis.answer.findings import Diagnosis
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network

SIMULATED, RECORDED = ("particle", "spread", "strands"), ("measured", "pybamm", "left_out")
BASES, TRAIN_RUNS = 5, 3
TARGETS_MV, TARGETS_K = (3.0, 6.0, 12.0), (0.5, 1.0, 2.0)
_EITHER_WAY = ("entropic_voltage", "voltage_offset", "current_gain", "voltage_gain")
# Whose numbers cases follow from: a new family comes last.
_NUMBER_OF = {
    name: number for number, name in enumerate(("particle", "spread", "measured", "pybamm", "left_out", "strands"))
}
_STRIDE = 7
_ROUNDS, _CLOSE, _LARGEST = 4, 0.05, 2.0


@dataclass(frozen=True)
class Base:
    """A cell as it was: its network, and the runs that this was made from."""

    network: LocalModelNetwork
    train: list[TimeSeries]
    train_soc: list[float]


class NotShownError(Exception):
    """None of the effects that are asked for can be made to show in a log."""


def main() -> int:
    arguments = _arguments()
    done = _known(arguments.rows)
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for family in arguments.families:
            judged = _simulated(family, arguments, done) if family in SIMULATED else _recorded(family, arguments, done)
            for row in judged:
                rows.append(row)
    result = summary(rows)
    if arguments.json:
        print(json.dumps(result))
    else:
        show(result)
    return 0


def _simulated(family: str, arguments: argparse.Namespace, done: dict[str, Row]) -> Iterator[Row]:
    """Nulls and cases of a simulated family, in turn."""
    for null, count in ((True, arguments.nulls), (False, arguments.cases)):
        for number in range(count):
            asked = () if null else arguments.effects
            key = f"{family} {arguments.seed} {'null' if null else '|'.join(('case', *asked))} {number}"
            if key not in done:
                try:
                    row = _judge_simulated(family, arguments.seed, number, null, arguments.keep, asked)
                except NotShownError as not_shown:
                    print(not_shown, file=sys.stderr)
                    continue
                _keep(arguments.rows, done, key, row)
            yield done[key]


def _judge_simulated(family: str, seed: int, number: int, null: bool, keep: Path | None, asked: tuple[str, ...]) -> Row:
    rng = np.random.default_rng([_NUMBER_OF[family], seed, number, int(null)])
    before = _rig(family, seed, number % BASES)
    base = _base(family, seed, number % BASES, keep)
    plan = make_plan(str(rng.choice(KINDS)), before.constants.capacity_Ah, rng)
    after, truth, shows = (
        (before, None, 0.0) if null else _with_effect(before, plan, number, rng, effects_of(family, asked))
    )
    columns = true_columns(after, plan)
    own_seed = int(rng.integers(2**31))
    run, soc = logged(after, plan, columns, own_seed), stated_soc(after, columns[3], own_seed)
    size = None if truth is None else true_size(truth, before, after, columns[3])
    return _row(base, run, soc, family, truth, size) | {"shows": shows}


def _with_effect(
    before: Rig, plan: Plan, number: int, rng: np.random.Generator, names: list[str]
) -> tuple[Rig, str, float]:
    """An effect whose change has the size that its number asks for; the next one where this cannot be had."""
    for k in range(len(names)):
        # Numbers go through all effects before one comes again, and then with another size.
        name = names[(number * _STRIDE + k) % len(names)]
        target = (TARGETS_K if name in THERMAL else TARGETS_MV)[(number + number // len(names)) % 3]
        shown = 0.0
        x = 0.3 * float(rng.choice([-1.0, 1.0]) if name in _EITHER_WAY else 1.0)
        for _ in range(_ROUNDS):
            shown = _shown(before, changed(before, name, x), plan, name in THERMAL)
            if abs(shown - target) <= _CLOSE * target:
                break
            x *= float(np.clip(target / max(shown, 1e-9), 0.1, 10.0))
            if abs(x) > _LARGEST:
                break
        if abs(x) <= _LARGEST and 0.6 * target <= shown <= 1.6 * target:
            return changed(before, name, x), name, shown
    raise NotShownError(f"{before.family}: no effect that is asked for can be made to show in case {number}; left out")


def _shown(before: Rig, after: Rig, plan: Plan, thermal: bool) -> float:
    """RMS change of the log at the same true current, in mV or K, with what a wrong count of charge makes of it."""
    was, now = (logged(rig, plan, _columns(rig, plan), 1) for rig in (before, after))
    if thermal:
        return float(np.sqrt(np.mean((now.temperature_degC - was.temperature_degC) ** 2)))
    moved_V = now.voltage_V - was.voltage_V
    soc = after.soc_off - before.soc_off
    offset_A = after.amperes[0] - before.amperes[0]
    gained = after.amperes[1] - before.amperes[1]
    if soc or offset_A or gained:
        # What the model is told instead of the truth: as if the cell stood elsewhere, by the slope of its curve.
        extra_As = offset_A * np.arange(len(moved_V)) + gained * np.cumsum(plan.logged_A)
        counted = soc + extra_As / (3600.0 * before.constants.capacity_Ah)
        moved_V = moved_V + counted * _slope_V(before, plan)
    return 1e3 * float(np.sqrt(np.mean(moved_V**2)))


def _slope_V(rig: Rig, plan: Plan) -> float:
    """Typical slope of the voltage over the state of charge in a log."""
    voltage = _columns(rig, plan)[0]
    soc = np.cumsum(plan.logged_A) / (3600.0 * rig.constants.capacity_Ah)
    return float(np.ptp(np.percentile(voltage, [10, 90])) / max(np.ptp(np.percentile(soc, [10, 90])), 1e-3))


_columns = lru_cache(maxsize=8)(true_columns)


@cache
def _rig(family: str, seed: int, number: int) -> Rig:
    return random_rig(family, np.random.default_rng([_NUMBER_OF[family], seed, number, 5]))


@cache
def _base(family: str, seed: int, number: int, keep: Path | None) -> Base:
    rig, rng = _rig(family, seed, number), np.random.default_rng([_NUMBER_OF[family], seed, number, 6])
    train, soc = [], []
    for kind in rng.choice(KINDS, size=TRAIN_RUNS, replace=False):
        plan = make_plan(str(kind), rig.constants.capacity_Ah, rng, TRAIN_S)
        own_seed, columns = int(rng.integers(2**31)), true_columns(rig, plan)
        train.append(logged(rig, plan, columns, own_seed))
        soc.append(stated_soc(rig, columns[3], own_seed))
    return Base(_network(f"{family}-{seed}-{number}", train, soc, rig.constants.capacity_Ah, keep), train, soc)


def _recorded(family: str, arguments: argparse.Namespace, done: dict[str, Row]) -> Iterator[Row]:
    """Records as they are, in turn over the bases, and those with a fault."""
    if arguments.data is None:
        print(f"{family}: left out, name the folder of the records with --data", file=sys.stderr)
        return
    asked = arguments.effects if family == "measured" else ()
    if family == "measured":
        bases = measured_records(arguments.data, asked)
    else:
        bases = {"pybamm": pybamm_records, "left_out": left_out_records}[family](arguments.data)
    bases_of: dict[str, Base] = {}
    for null, count in ((True, arguments.nulls), (False, arguments.cases)):
        for records, number in _in_turn(bases, null)[:count]:
            key = f"{records.name} {'null' if null else '|'.join(('case', *asked))} {number}"
            if key not in done:
                base = bases_of.setdefault(records.name, _base_of(records, arguments.keep))
                truth, size, run, soc = _log(records, number, null)
                _keep(arguments.rows, done, key, _row(base, run, soc, family, truth, size) | {"shows": 0.0})
            yield done[key]


def _in_turn(bases: list[Records], null: bool) -> list[tuple[Records, int]]:
    counted = [(len(each.nulls if null else each.cases), each) for each in bases]
    most = max(n for n, _ in counted)
    return [(each, number) for number in range(most) for n, each in counted if number < n]


def _log(records: Records, number: int, null: bool) -> tuple[str | None, float | None, TimeSeries, float]:
    if null:
        return None, None, records.nulls[number], start_soc(records.nulls[number])
    return records.cases[number]


def _base_of(records: Records, keep: Path | None) -> Base:
    soc = [start_soc(run) for run in records.train]
    return Base(
        _network(records.name.replace(" ", "-"), records.train, soc, records.capacity_Ah, keep), records.train, soc
    )


def _network(
    name: str, train: list[TimeSeries], soc: list[float], capacity_Ah: float, keep: Path | None
) -> LocalModelNetwork:
    kept = None if keep is None else keep / f"{name}.json"
    if kept is not None and kept.exists():
        return LocalModelNetwork.from_json(json.loads(kept.read_text(encoding="utf-8")))
    network = fit_network(train, capacity_Ah=capacity_Ah, structure="bounded", initial_soc=soc, dt_s=1.0).network
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(network.to_json()), encoding="utf-8")
    return network


def _row(base: Base, run: TimeSeries, soc: float, family: str, truth: str | None, size: float | None) -> Row:
    answer = diagnose(base.network, [run], [soc], train=base.train, train_soc=base.train_soc, mode="change")
    names = truth.split("|") if truth else []
    row = answered(answer, names)
    return row | {
        "family": family,
        "change": None if size is None else size - _unchanged(base, soc, names),
        "size": _sized(answer, names, size),
        "power": stated_power(answer, names),
    }


def _unchanged(base: Base, soc: float, truth: list[str]) -> float:
    """What the first parameter of the effect would be without it."""
    return base.network.cell.capacity_Ah if "capacity" in truth else soc if "initial_soc" in truth else 0.0


def _sized(answer: Diagnosis, truth: list[str], size: float | None) -> dict[str, Any] | None:
    """True and stated size of the effect where it is named first and has one."""
    first = answer.findings[0] if answer.findings else None
    if first is None or size is None or not any(same(first.effect, each) for each in truth) or not first.parameters:
        return None
    value = next(iter(first.parameters.values()))
    return None if value.std is None else {"true": size, "value": value.value, "std": value.std}


def _known(path: Path | None) -> dict[str, Row]:
    return {row["key"]: row for row in read_rows(path)}


def _keep(path: Path | None, done: dict[str, Row], key: str, row: Row) -> None:
    done[key] = {"key": key} | row
    add_row(path, done[key])
    sure = " ".join(f"{each:.2f}" for each in row["confidence"])
    print(
        f"{key:34s} {'|'.join(row['truth']) or 'none':24s} {row['shows']:5.1f} -> {row['verdict']:15s} "
        f"{'+'.join(row['named']):34s} {'ok' if row['right'] else 'WRONG':5s} sure {sure} {row['diagnosis_s']:.1f} s",
        file=sys.stderr,
        flush=True,
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = (*SIMULATED, *RECORDED)
    usual = list(known[:-1])
    parser.add_argument("--families", type=lambda text: text.split(","), default=usual, metavar="NAME,...")
    parser.add_argument("--cases", type=int, default=10, help="with an effect, of each family")
    parser.add_argument("--nulls", type=int, default=10, help="without one, of each family")
    parser.add_argument("--seed", type=int, default=0, help="of the simulated families")
    parser.add_argument(
        "--effects",
        type=lambda text: tuple(text.split(",")),
        default=(),
        metavar="NAME,...",
        help="that simulated cases and measured logs have, in turn; default: all that the published figures are about",
    )
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="of measured records")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="in which fitted networks are kept")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="one JSON line for each case; go on where it ends")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    arguments = parser.parse_args()
    if unknown := set(arguments.families) - set(known):
        parser.error(f"no family {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
