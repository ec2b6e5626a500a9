"""Bad input data, case by case: whether it is said, in the right words, and what it costs.

``python benchmarks/bad_input.py [--cell nmc] [--seed 0] [--structure bounded] [--case NAME ...] [--thin RUN... --judge
RUN... --capacity-Ah Q] [--json]``

Each case is made from records of a simulated cell: a clean one of pulses and rests, charges and discharges at constant
current, or a half of the range each. The verdict is that of `fit`, what is put right is what reading the file says.
With ``--thin`` half of the samples of measured runs are dropped at random and the error on others is held against that
of a model made from all samples.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from simulated_cells import play
from threadpoolctl import threadpool_limits

from bench_service.errors import ServiceError
from bench_service.exchange.read import read_run, read_run_file
from bench_service.exchange.write import write_results
from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.design import Profile, StepProfileRequest, step_profile
from models.observer import FuzzyObserver
from models.observer.observation import observe
from models.observer.tuning.tuning import with_tuned_observer
from models.pipeline import fit_network
from models.pipeline.fit import FitResult
from simulators.catalogue import CELLS, cell_type

REST_S, DURATION_S = 900.0, 14000.0
COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
# Losing half of the samples may cost so much of the error on other runs.
MOST_RATIO = 1.2


@dataclass(frozen=True)
class Case:
    """What is done to good records, and what is to be said of it.

    Attributes
    ----------
    make : runs from a cell and a seed
    verdicts : that are right; "refused": exit 2 with a line that says it
    says : words that the reasons or the remarks on reading hold, all of them
    clock_s : times that stand in the file, where they are no rising ones
    options : of the fit
    ratio : whether the error on a good held-out run is held against that of the whole record
    """

    make: Callable[[str, int], list[TimeSeries]]
    verdicts: tuple[str, ...]
    says: tuple[str, ...] = ()
    clock_s: Callable[[TimeSeries], np.ndarray] | None = None
    options: dict[str, Any] = field(default_factory=dict)
    ratio: bool = False


def main() -> int:
    arguments = _arguments()
    with threadpool_limits(1, user_api="blas"), tempfile.TemporaryDirectory() as folder:
        if arguments.thin:
            result: dict[str, Any] = {"thinning": thinned_runs(arguments)}
        else:
            rows = [judge(name, arguments, Path(folder)) for name in arguments.case or CASES]
            result = {"cell": arguments.cell, "seed": arguments.seed, "cases": rows}
            if not arguments.case:
                result["observer"] = observed_without_rests(arguments.cell, arguments.seed, arguments.structure)
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0


def judge(name: str, arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Make a case's files, read them, fit, and hold what is said against what should be."""
    case = CASES[name]
    remarks: list[str] = []
    held_out = good(arguments.cell, arguments.seed + 1000)
    row: dict[str, Any] = {"case": name, "rmse_mV": None}
    options = {"structure": arguments.structure} | case.options
    try:
        made = case.make(arguments.cell, arguments.seed)
        runs = [_through_a_file(run, folder, remarks, case.clock_s) for run in made]
        fitted = _fit(runs, arguments.cell, validate=[held_out], **options)
    except ModelError as error:
        row |= {"verdict": "refused", "reasons": [str(error)]}
    else:
        told = fitted.network.record.usability or {}
        row |= {"verdict": told["verdict"], "reasons": told["reasons"] + remarks}
        assert fitted.validation is not None  # a run was held out
        row["rmse_mV"] = fitted.validation["rmse_mV"]
    said = " ".join(row["reasons"])
    row["right"] = row["verdict"] in case.verdicts and all(words in said for words in case.says)
    row["missing"] = [words for words in case.says if words not in said]
    if case.ratio and row["rmse_mV"] is not None:
        whole = _fit([good(arguments.cell, arguments.seed)], arguments.cell, validate=[held_out], **options)
        assert whole.validation is not None
        row["ratio"] = row["rmse_mV"] / whole.validation["rmse_mV"]
    print(f"{name}: {row['verdict']}, {'right' if row['right'] else 'WRONG'}", file=sys.stderr)
    return row


def thinned_runs(arguments: argparse.Namespace) -> dict[str, Any]:
    """Error on other runs of models from all samples, and from half of them."""
    train, others = ([read_run(path) for path in paths] for paths in (arguments.thin, arguments.judge))
    errors = []
    for runs in (train, [half(run, arguments.seed + k) for k, run in enumerate(train)]):
        fitted = fit_network(runs, capacity_Ah=arguments.capacity_Ah, structure=arguments.structure, validate=others)
        assert fitted.validation is not None
        errors.append(fitted.validation["rmse_mV"])
    return {"all_mV": errors[0], "half_mV": errors[1], "ratio": errors[1] / errors[0]}


def observed_without_rests(cell: str, seed: int, structure: str) -> list[dict[str, Any]]:
    """Offset that an observer tells of a record with its rests cut out, time kept or counted anew; the truth is 0."""
    train = [good(cell, seed)]
    fitted = _fit(train, cell, structure=structure)
    observer = FuzzyObserver(with_tuned_observer(fitted.network, train, fitted.initial_soc))
    whole = good(cell, seed + 1000)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, run in (
            ("whole", whole),
            ("rests cut, time kept", without_rests(whole)),
            ("rests cut, time anew", without_rests(whole, anew=True)),
        ):
            told = observe(observer, _through_a_file(run, Path(folder), []), 0.5, 0.02).sensors["current_offset_A"]
            within = told is None or abs(told["value"]) <= 1.96 * told["std"]
            rows.append({"record": name, "offset": told, "within_its_band": within})
    return rows


def good(cell: str, seed: int, soc: tuple[float, float] = (0.1, 0.9)) -> TimeSeries:
    """A rest, then pulses and rests over the range."""
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    request = StepProfileRequest(
        capacity_Ah=capacity_Ah,
        current_A=(-2.0 * capacity_Ah, capacity_Ah),
        soc=soc,
        initial_soc=0.5,
        duration_s=DURATION_S,
        dt_s=1.0,
    )
    profile = step_profile(request, np.random.default_rng([seed, 7]))
    return _played(cell, profile.time_s, profile.current_A, seed)


def cc_cv(cell: str, seed: int, charge_only: bool = False) -> TimeSeries:
    """Charges that taper off, with a discharge at constant current between them unless only charges are asked for."""
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    levels: list[tuple[float, float]] = [(REST_S, 0.0)]
    taper = [(60.0, 0.5 * float(np.exp(-k / 8.0))) for k in range(30)]
    if charge_only:
        for rate in (0.1, 0.3, 0.5, 0.2, 0.4, 0.1, 0.5, 0.3):
            levels += [(360.0, rate), (180.0, 0.0)]
    else:
        for _ in range(2):
            levels += [(2400.0, 0.5), *taper, (600.0, 0.0), (3600.0, -0.5), (600.0, 0.0)]
    seconds, rates = (np.array(column) for column in zip(*levels, strict=True))
    time_s = np.concatenate([[0.0], np.cumsum(seconds)])
    return _played(cell, time_s, np.append(rates, 0.0) * capacity_Ah, seed, rest=False)


def _played(cell: str, time_s: np.ndarray, current_A: np.ndarray, seed: int, rest: bool = True) -> TimeSeries:
    shift_s = REST_S if rest else 0.0
    times = np.concatenate([[0.0], time_s + shift_s]) if rest else time_s
    currents = np.concatenate([[0.0], current_A]) if rest else current_A
    return play(cell, Profile(times, currents), (seed, 3)).series


def part(run: TimeSeries, kept: np.ndarray) -> TimeSeries:
    """Some of a run's samples."""
    values = {name: getattr(run, name) for name in COLUMNS}
    return replace(run, **{name: value if value is None else value[kept] for name, value in values.items()})


def half(run: TimeSeries, seed: int) -> TimeSeries:
    """Every sample dropped with a chance of one half, the first kept."""
    kept = np.random.default_rng([seed, 11]).random(len(run)) < 0.5
    kept[0] = True
    return part(run, kept)


def without_rests(run: TimeSeries, anew: bool = False) -> TimeSeries:
    """Samples at rest cut out, but for the rest at the start; the time counted anew without them if asked for."""
    loaded = np.abs(run.current_A) > 0.02 * float(np.abs(run.current_A).max())
    kept = loaded | (run.time_s < REST_S)
    cut = part(run, kept)
    return replace(cut, time_s=np.arange(len(cut)) * 1.0) if anew else cut


def on_change(run: TimeSeries) -> TimeSeries:
    """A row where the current or the voltage has changed since the last row, and one every ten minutes."""
    kept, last = [0], 0
    moved_A = 0.01 * float(np.abs(run.current_A).max())
    for k in range(1, len(run)):
        changed = abs(run.current_A[k] - run.current_A[last]) > moved_A
        if changed or abs(run.voltage_V[k] - run.voltage_V[last]) > 4e-3 or run.time_s[k] - run.time_s[last] >= 600.0:
            kept.append(k)
            last = k
    return part(run, np.array(kept))


def _every(run: TimeSeries, seconds: int) -> TimeSeries:
    return part(run, np.arange(len(run)) % seconds == 0)


def _rounded(run: TimeSeries, volts: float, amperes: float) -> TimeSeries:
    return replace(
        run,
        voltage_V=volts * np.round(run.voltage_V / volts),
        current_A=amperes * np.round(run.current_A / amperes),
    )


def _without_temperature(run: TimeSeries) -> TimeSeries:
    return replace(run, temperature_degC=np.full(len(run), np.nan), ambient_degC=None)


def _gap(cell: str, seed: int) -> list[TimeSeries]:
    """Two records that leave the same part of the charge out: only voltages outside of it were kept."""
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    runs = []
    for number in (0, 1):
        run = replace(good(cell, seed + number), name=f"half {number}")
        soc = 0.5 + np.concatenate([[0.0], np.cumsum(run.current_A[1:])]) / 3600.0 / capacity_Ah
        runs.append(replace(run, voltage_V=np.where((soc > 0.55) & (soc < 0.7), np.nan, run.voltage_V)))
    return runs


def _jittered(run: TimeSeries, seed: int) -> TimeSeries:
    return replace(run, time_s=run.time_s + np.random.default_rng([seed, 13]).uniform(-0.3, 0.3, len(run)) + 0.3)


def clock_put_back_s(run: TimeSeries) -> np.ndarray:
    """Times of a clock that goes back by an hour while a load flows."""
    largest = float(np.abs(run.current_A).max())
    even = np.flatnonzero((np.abs(run.current_A[:-1]) > 0.2 * largest) & (np.abs(np.diff(run.current_A)) < 0.01))
    at = int(even[len(even) // 2]) + 1
    return np.where(np.arange(len(run)) < at, run.time_s, run.time_s - 3600.0)


def _steps_in_part(cell: str, seed: int) -> list[TimeSeries]:
    """Pulses below the middle, constant current above it."""
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    request = StepProfileRequest(
        capacity_Ah=capacity_Ah,
        current_A=(-2.0 * capacity_Ah, capacity_Ah),
        soc=(0.1, 0.45),
        initial_soc=0.45,
        duration_s=9000.0,
        dt_s=1.0,
    )
    low = step_profile(request, np.random.default_rng([seed, 17]))
    down_s = 0.05 * 3600.0 / 0.5
    up_s = 0.45 * 3600.0 / 0.5
    times = np.concatenate([[0.0, up_s, 2.0 * up_s], 2.0 * up_s + down_s + low.time_s])
    currents = np.concatenate([np.array([0.5, -0.5, -0.5]) * capacity_Ah, low.current_A])
    return [_played(cell, times, currents, seed)]


def _through_a_file(
    run: TimeSeries,
    folder: Path,
    remarks: list[str],
    clock_s: Callable[[TimeSeries], np.ndarray] | None = None,
) -> TimeSeries:
    """Write a run as it would be handed in, and read it back with what is said of it."""
    path = folder / f"{run.name.replace(' ', '_')}.csv"
    columns = {name: getattr(run, name) for name in COLUMNS if getattr(run, name) is not None}
    if clock_s is not None:
        columns["time_s"] = clock_s(run)
    write_results(path, columns)
    try:
        read = read_run_file(path, "charge-positive")
    except ServiceError as error:
        raise ModelError(str(error)) from error
    remarks.extend(read.warnings)
    return replace(read.series, name=run.name)


def _fit(runs: list[TimeSeries], cell: str, **options: Any) -> FitResult:
    return fit_network(runs, capacity_Ah=cell_type(cell).parameters.capacity_Ah, **options)


LIMITED = ("limited",)
CASES: dict[str, Case] = {
    "clean": Case(lambda cell, seed: [good(cell, seed)], ("usable",)),
    "charge only": Case(lambda cell, seed: [cc_cv(cell, seed, charge_only=True)], LIMITED, ("charge only",)),
    "CC-CV only": Case(lambda cell, seed: [cc_cv(cell, seed)], LIMITED, ("CC-CV",)),
    "resistance unknown": Case(_steps_in_part, LIMITED, ("resistance is not known at",)),
    "SoC on trust": Case(
        lambda cell, seed: [part(good(cell, seed), np.arange(int(REST_S) + 1, int(DURATION_S)))],
        LIMITED,
        ("on trust",),
        options={"initial_soc": [0.5]},
    ),
    "logged every 60 s": Case(
        lambda cell, seed: [_every(good(cell, seed), 60)], ("limited", "unusable"), ("one sample every 60 s",)
    ),
    "coarse steps": Case(
        lambda cell, seed: [_rounded(good(cell, seed), 0.02, 0.5)], LIMITED, ("steps of 20 mV", "steps of 0.5 A")
    ),
    "no temperature": Case(
        lambda cell, seed: [_without_temperature(good(cell, seed))], LIMITED, ("no run has a temperature",)
    ),
    "no temperature, full asked": Case(
        lambda cell, seed: [_without_temperature(good(cell, seed))],
        ("refused",),
        ("--structure minimal",),
        options={"structure": "full"},
    ),
    "shared gap": Case(_gap, LIMITED, ("no run measured anything",)),
    "current offset": Case(
        lambda cell, seed: [replace(run := good(cell, seed), current_A=run.current_A + 0.02)],
        LIMITED,
        ("seems to have an offset",),
    ),
    "half dropped": Case(lambda cell, seed: [half(good(cell, seed), seed)], ("usable", "limited"), ratio=True),
    "jitter": Case(lambda cell, seed: [_jittered(good(cell, seed), seed)], ("usable",), ratio=True),
    "written on change": Case(
        lambda cell, seed: [on_change(good(cell, seed))], ("usable", "limited"), ("written on change",), ratio=True
    ),
    "rests cut out": Case(
        lambda cell, seed: [without_rests(good(cell, seed))],
        ("usable", "limited"),
        ("rest(s) are missing from the log",),
        ratio=True,
    ),
    "rests cut out, time anew": Case(
        lambda cell, seed: [without_rests(good(cell, seed), anew=True)], LIMITED, ("no rest between loads",)
    ),
    "clock put back": Case(
        lambda cell, seed: [good(cell, seed)],
        ("usable",),
        ("the clock jumps by an hour",),
        clock_s=clock_put_back_s,
        ratio=True,
    ),
    "a file twice": Case(
        lambda cell, seed: [run := good(cell, seed), replace(run, name="copy")],
        ("usable",),
        ("is the same record as",),
        ratio=True,
    ),
}


def _print(result: dict[str, Any]) -> None:
    console = Console()
    if "thinning" in result:
        console.print_json(data=result["thinning"])
        return
    table = Table(title=f"Bad input, {result['cell']}, seed {result['seed']}")
    for heading in ("case", "verdict", "right", "held-out / mV", "ratio", "what is said"):
        table.add_column(heading, overflow="fold")
    for row in result["cases"]:
        error = "-" if row["rmse_mV"] is None else f"{row['rmse_mV']:.2f}"
        ratio = f"{row['ratio']:.2f}" if "ratio" in row else ""
        table.add_row(
            row["case"], row["verdict"], "yes" if row["right"] else "NO", error, ratio, "\n".join(row["reasons"])
        )
    console.print(table)
    for row in result.get("observer", []):
        told = row["offset"]
        text = "not told" if told is None else f"{1e3 * told['value']:+.1f} +- {1e3 * told['std']:.1f} mA"
        console.print(f"observer, {row['record']}: offset {text}, {'within' if row['within_its_band'] else 'BEYOND'}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", choices=list(CELLS), default="nmc")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--structure", default="bounded")
    parser.add_argument("--case", nargs="+", choices=list(CASES), help="only these")
    parser.add_argument("--thin", type=Path, nargs="+", default=[], metavar="RUN", help="measured runs to thin")
    parser.add_argument("--judge", type=Path, nargs="+", default=[], metavar="RUN", help="measured runs that judge")
    parser.add_argument("--capacity-Ah", dest="capacity_Ah", type=float, default=1.0, help="of the measured cell")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
