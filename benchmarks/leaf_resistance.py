"""Pulse resistances of a Leaf cell: read from the record, and from a network fitted to the same record.

``python benchmarks/leaf_resistance.py --data FOLDER [--structures two-activations auto full] [--dt-s 1] [--json]``

`FOLDER` holds `hppc_10degC.csv.gz`, `hppc_25degC.csv.gz` and `hppc_40degC.csv.gz` of the cell (Wiggins, Allu, Wang,
doi:10.5281/zenodo.2580327): per 10 % of charge a 30 s pulse at -30 A, 40 s of rest and a 10 s
pulse at 22.5 A. The log is adaptive (0.1 to 60 s), each current holding backward from its time stamp; it is put on the
model's even grid here, from the full charge on, where the state of charge is known. One network is fitted to all three
temperatures together, without being told where the pulses lie; its resistance is its step response at the pulse's own
length, from where the pulse began, with the charge that the pulse moves. A pulse that was cut short is left out.

`two-activations` is a structure without past outputs, whose resistances are the sum of a part that does not depend on
temperature and two that do, with activation temperatures apart from each other (2500 and 7500 K): with three weights a
resistance can take any value at three temperatures. Its open-circuit voltage moves with temperature. Time constants and
the sharpness along the state of charge are chosen by the free-run error on held-out blocks of the training runs.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run
from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.identification.search.search import Search
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import CellContext
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline import STRUCTURES, fit_network
from models.readouts.step_response import CurrentStep, step_response

CAPACITY_AH = 30.6
TEMPERATURES_DEGC = (10, 25, 40)
# Current in A and length in s of the two pulses.
PULSES = {"discharge": (-30.0, 30.0), "charge": (22.5, 10.0)}
BAR = 0.10
TWO_ACTIVATIONS = "two-activations"
_REST_A = 0.5
# Each set spans from a few samples of 1 s to the hour of the rests.
_TIME_CONSTANTS_S = (
    (3.0, 20.0, 100.0, 600.0, 3000.0),
    (4.0, 40.0, 400.0, 2000.0),
    (2.0, 8.0, 30.0, 120.0, 500.0, 2000.0),
)
_ACTIVATION_K = (2500.0, 7500.0)
_SOC_K_SIGMA = (0.7, 1.0, 1.4)


@dataclass(frozen=True)
class Pulse:
    """One pulse as the record shows it."""

    kind: str
    temperature_degC: float
    soc: float
    current_A: float
    length_s: float
    direction_before: float
    resistance_Ohm: float


def main() -> int:
    arguments = _arguments()
    runs = [from_full(read_run(arguments.data / f"hppc_{degC}degC.csv.gz")) for degC in TEMPERATURES_DEGC]
    pulses = [pulse for run in runs for pulse in find_pulses(run)]
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for structure in arguments.structures:
            print(f"fitting {structure} ...", file=sys.stderr, flush=True)
            rows.append(judge(structure, runs, pulses, arguments.dt_s))
    if arguments.json:
        print(json.dumps({"bar": BAR, "structures": rows}))
    else:
        _print(rows)
    return 0


def from_full(run: TimeSeries) -> TimeSeries:
    """Cut a run to where its state of charge is known."""
    if run.soc_ref is None:
        raise ModelError(f"{run.name}: it has no reference state of charge")
    first = int(np.flatnonzero(~np.isnan(run.soc_ref))[0])
    columns = {
        key: None if getattr(run, key) is None else getattr(run, key)[first:]
        for key in ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    }
    return replace(run, **columns)


def find_pulses(run: TimeSeries) -> list[Pulse]:
    """Read every whole pulse of the two kinds from a record, with the voltage's change from just before it."""
    if run.soc_ref is None:
        raise ModelError(f"{run.name}: it has no reference state of charge")
    found = []
    current = run.current_A
    direction = np.sign(np.where(np.abs(current) > _REST_A, current, 0.0))
    # With backward hold the sample before the first one of a step is the last of what was before.
    edges = np.flatnonzero(np.diff(direction) != 0.0) + 1
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        if direction[begin - 1] != 0.0:
            continue
        time_s, held_A = run.time_s[begin - 1 : end], current[begin:end]
        length_s, charge_As = float(time_s[-1] - time_s[0]), float(held_A @ np.diff(time_s))
        kind = next((k for k, (size_A, whole_s) in PULSES.items() if _is(held_A, length_s, size_A, whole_s)), None)
        # The cycler takes about half a second to reach a charging current; a pulse at its voltage limit falls short.
        if kind is None or abs(charge_As / (PULSES[kind][0] * length_s) - 1.0) > 0.05:
            continue
        earlier = direction[:begin][direction[:begin] != 0.0]
        found.append(
            Pulse(
                kind=kind,
                temperature_degC=float(run.temperature_degC[begin]),
                soc=float(run.soc_ref[begin - 1]),
                current_A=float(held_A[-1]),
                length_s=round(length_s, 3),
                # The runs begin at full charge.
                direction_before=float(earlier[-1]) if len(earlier) else 1.0,
                resistance_Ohm=float(run.voltage_V[end - 1] - run.voltage_V[begin - 1]) / float(held_A[-1]),
            )
        )
    return found


def _is(held_A: FloatArray, length_s: float, size_A: float, whole_s: float) -> bool:
    return abs(float(held_A[-1]) - size_A) < _REST_A and abs(length_s - whole_s) < 0.5


def two_activations(constants_s: tuple[float, ...], soc_k_sigma: float, dt_s: float) -> Structure:
    """Low-passes of the current, each without and with two scalings by temperature."""
    inputs = [InputChannel("soc", delay=1), InputChannel("current")]
    inputs += [InputChannel(f"low_pass:{tau:g}") for tau in constants_s if tau >= 1.5 * dt_s]
    for kelvin in _ACTIVATION_K:
        inputs += [InputChannel(f"scaled_current:{kelvin:g}")]
        inputs += [InputChannel(f"low_pass:{tau:g}/{kelvin:g}") for tau in constants_s if tau >= 1.5 * dt_s]
    inputs += [InputChannel("temperature")]
    return Structure(0, tuple(inputs), (PartitionAxis("soc", k_sigma=soc_k_sigma),), dt_s, name=TWO_ACTIVATIONS)


def chosen_two_activations(runs: list[TimeSeries], dt_s: float) -> Structure:
    """Return the structure with the least held-out free-run error."""
    soc = [start_soc(run) for run in runs]
    search = Search([to_grid(run, dt_s) for run in runs], soc, CellContext(CAPACITY_AH), lambda share, text: None)

    def held_out_V(structure: Structure) -> float:
        return search.fitted(search.best_within(structure)).held_out_rmse_V

    return min((two_activations(taus, k, dt_s) for taus in _TIME_CONSTANTS_S for k in _SOC_K_SIGMA), key=held_out_V)


def judge(structure: str, runs: list[TimeSeries], pulses: list[Pulse], dt_s: float) -> dict[str, Any]:
    """Fit one structure and compare its step responses with the pulses."""
    began = time.perf_counter()
    asked = chosen_two_activations(runs, dt_s) if structure == TWO_ACTIVATIONS else structure
    fitted = fit_network(runs, capacity_Ah=CAPACITY_AH, structure=asked, dt_s=dt_s)
    seconds = time.perf_counter() - began
    each = [_beside(fitted.network, pulse) for pulse in pulses]
    error = np.array([row["relative_error"] for row in each])
    return {
        "structure": structure,
        "train_rmse_mV": fitted.train["rmse_mV"],
        "n_models": fitted.network.n_models,
        "fit_seconds": seconds,
        "choices": fitted.network.record.choices,
        "signals": list(fitted.network.structure.signals),
        "n_pulses": len(each),
        "within_bar": int((np.abs(error) <= BAR).sum()),
        "largest": float(np.abs(error).max()),
        "rms": float(np.sqrt(np.mean(error**2))),
        "pulses": each,
    }


def _beside(network: LocalModelNetwork, pulse: Pulse) -> dict[str, Any]:
    response = step_response(
        network,
        CurrentStep(
            soc=pulse.soc,
            to_A=pulse.current_A,
            temperature_degC=pulse.temperature_degC,
            direction_before=pulse.direction_before,
            soc_moves=True,
        ),
        duration_s=np.ceil(pulse.length_s / network.structure.dt_s) * network.structure.dt_s,
    )
    modelled = response.at(pulse.length_s)
    return {
        "kind": pulse.kind,
        "temperature_degC": pulse.temperature_degC,
        "soc": pulse.soc,
        "length_s": pulse.length_s,
        "direct_Ohm": pulse.resistance_Ohm,
        "model_Ohm": modelled,
        "relative_error": modelled / pulse.resistance_Ohm - 1.0,
    }


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title=f"Pulse resistance from the model against the record, bar {100 * BAR:.0f} %")
    for heading in ("structure", "training / mV", "local models", "fit / s", "within", "rms / %", "largest / %"):
        table.add_column(heading, justify="left" if heading == "structure" else "right")
    for row in rows:
        table.add_row(
            row["structure"],
            f"{row['train_rmse_mV']:.2f}",
            str(row["n_models"]),
            f"{row['fit_seconds']:.0f}",
            f"{row['within_bar']} of {row['n_pulses']}",
            f"{100 * row['rms']:.1f}",
            f"{100 * row['largest']:.1f}",
        )
    each = Table(title="Each pulse, mOhm")
    for heading in ("pulse", "degC", "SoC", "direct", *(row["structure"] for row in rows)):
        each.add_column(heading, justify="right")
    for i, first in enumerate(rows[0]["pulses"]):
        models = [row["pulses"][i] for row in rows]
        each.add_row(
            f"{first['length_s']:.0f} s {first['kind']}",
            f"{first['temperature_degC']:.0f}",
            f"{first['soc']:.2f}",
            f"{1e3 * first['direct_Ohm']:.3f}",
            *(f"{1e3 * m['model_Ohm']:.3f} ({100 * m['relative_error']:+.1f} %)" for m in models),
        )
    Console().print(table)
    Console().print(each)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with the cell's three pulse records")
    parser.add_argument("--structures", nargs="+", choices=[*STRUCTURES, TWO_ACTIVATIONS], default=[TWO_ACTIVATIONS])
    parser.add_argument("--dt-s", dest="dt_s", type=float, default=1.0, help="sampling time of the model")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
