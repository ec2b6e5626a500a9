"""Held-out free-run error on the simulated cells against the measurement's noise and the noise-free truth.

``python benchmarks/simulated_cells.py [--cells nmc lfp nimh] [--seeds 10] [--structure full] [--json]``

Each seed makes a training and a held-out run of its own: multi-level steps over SoC 0.1..0.9, -2C..+1C, from SoC 0.5 at
rest, sampled at 1 s with the simulated sensors' noise. The model sees the training run only. Of a network also its
open-circuit and resistance tables are held against the cell's own curves, and its 95 % bands against the held-out run.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.baselines import CellModel, fit_enhanced_self_correcting, fit_equivalent_circuit
from models.comparison.figures import compare
from models.data.metrics import metrics
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.design import Profile, StepProfileRequest, step_profile
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.pipeline import STRUCTURES, fit_network
from models.readouts.ocv import DIRECTIONS
from models.readouts.tables import tables_of
from simulators.catalogue import CELLS, cell_type
from simulators.cell import Cell, CellParameters
from simulators.sensors import SensorParameters, Sensors
from simulators.settled import open_circuit_V, settled_resistance_Ohm

DT_S = 1.0
INITIAL_SOC = 0.5
SOC = (0.1, 0.9)
C_RATES = (-2.0, 1.0)

# Where the open-circuit curve rises by less than this over the whole charge it is a plateau.
PLATEAU_V = 0.12
READ_OUTS = ("ocv_rms_mV", "ocv_max_mV", "plateau_max_mV", "resistance_rms", "resistance_max")
Fit = Callable[[list[TimeSeries], float], CellModel | LocalModelNetwork]
BASELINES: dict[str, Fit] = {
    "1rc": lambda train, capacity_Ah: fit_equivalent_circuit(train, capacity_Ah=capacity_Ah, n_branches=1, dt_s=DT_S),
    "2rc": lambda train, capacity_Ah: fit_equivalent_circuit(train, capacity_Ah=capacity_Ah, n_branches=2, dt_s=DT_S),
    "esc": lambda train, capacity_Ah: fit_enhanced_self_correcting(train, capacity_Ah=capacity_Ah, dt_s=DT_S),
}


@dataclass(frozen=True)
class SimulatedRun:
    """A run with what the sensors read, and the noise-free voltage beside it."""

    series: TimeSeries
    truth_V: FloatArray
    capacity_Ah: float


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                row = judge(cell, seed, arguments.structure, arguments.duration_s, arguments.ambient_degC)
                rows.append(row)
                if not arguments.json:
                    print(
                        f"{cell} seed {seed}: {row['held_out_rmse_mV']:.2f} mV, {row['over_noise']:.2f} x noise, "
                        f"{row['held_out_against_truth_mV']:.2f} mV against the truth, {row['seconds']:.1f} s",
                        file=sys.stderr,
                    )
    result = {"structure": arguments.structure, "runs": rows, "cells": [_summary(c, rows) for c in arguments.cells]}
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0


def judge(cell: str, seed: int, structure: str, duration_s: float, ambient_degC: float) -> dict[str, Any]:
    """Fit one model to a training run and simulate a held-out one."""
    train, held_out = (simulated_run(cell, seed, number, duration_s, ambient_degC) for number in (0, 1))
    began = time.perf_counter()
    model = _fit(structure)([train.series], train.capacity_Ah)
    seconds = time.perf_counter() - began
    run = to_grid(held_out.series, DT_S)
    simulated_V = free_run_V(model, run, INITIAL_SOC)
    figures = metrics(run.voltage_V, simulated_V)
    noise_mV = 1e3 * noise_V()
    return {
        "cell": cell,
        "seed": seed,
        "held_out_rmse_mV": figures["rmse_mV"],
        "held_out_max_mV": figures["max_mV"],
        "noise_mV": noise_mV,
        "over_noise": figures["rmse_mV"] / noise_mV,
        "held_out_against_truth_mV": metrics(held_out.truth_V, simulated_V)["rmse_mV"],
        "seconds": seconds,
        **(_what_it_says(model, cell, held_out) if isinstance(model, LocalModelNetwork) else {}),
    }


def _what_it_says(network: LocalModelNetwork, cell: str, held_out: SimulatedRun) -> dict[str, Any]:
    """Errors of the read-outs against the truth, and how well the bands hold on the held-out run."""
    compared = compare(network, [held_out.series], [INITIAL_SOC])
    band, temperature = compared["band"], compared["temperature"]
    assert band is not None  # a fitted network says what it does not know
    return {
        "band_holds": band["coverage_95"],
        "temperature_rmse_K": None if temperature is None else temperature["rmse_K"],
        **table_errors(network, cell_type(cell).parameters),
    }


def simulated_run(
    cell: str, seed: int, number: int, duration_s: float = 14000.0, ambient_degC: float = 25.0
) -> SimulatedRun:
    """Play a profile to a rested cell; the same seed and number give the same run."""
    parameters = cell_type(cell).parameters
    capacity_Ah = parameters.capacity_Ah
    profile = step_profile(
        StepProfileRequest(
            capacity_Ah=capacity_Ah,
            current_A=(C_RATES[0] * capacity_Ah, C_RATES[1] * capacity_Ah),
            soc=SOC,
            initial_soc=INITIAL_SOC,
            duration_s=duration_s,
            dt_s=DT_S,
        ),
        np.random.default_rng([seed, number]),
    )
    return play(cell, profile, (seed, number), ambient_degC)


def play(cell: str, profile: Profile, seed: tuple[int, ...], ambient_degC: float = 25.0) -> SimulatedRun:
    """Play a profile to a rested cell and read its sensors; the same seed gives the same noise."""
    parameters = cell_type(cell).parameters
    grid_s = np.arange(round(profile.duration_s / DT_S) + 1) * DT_S
    # A profile's value holds forward from its time, a sample's current is the one that flowed until then.
    held_A = profile.current_A[np.searchsorted(profile.time_s, grid_s[:-1] + 0.5 * DT_S, side="right") - 1]
    simulated = Cell(parameters, INITIAL_SOC, ambient_degC)
    sensors = Sensors(SensorParameters(), np.random.default_rng([*seed, 1]))
    truth = [simulated.step(0.0, 0.0), *(simulated.step(float(current_A), DT_S) for current_A in held_A)]
    read = [
        sensors.measure(output, current_A, ambient_degC)
        for output, current_A in zip(truth, [0.0, *held_A.tolist()], strict=True)
    ]
    voltage_V, current_A, temperature_degC, ambient = (np.array(column) for column in zip(*read, strict=True))
    known_at_start = np.where(grid_s == 0.0, INITIAL_SOC, np.nan)
    name = f"{cell} {'.'.join(map(str, seed))}"
    series = TimeSeries(grid_s, current_A, voltage_V, temperature_degC, ambient, known_at_start, name)
    return SimulatedRun(series, np.array([output.voltage_V for output in truth]), parameters.capacity_Ah)


def noise_V() -> float:
    """Standard deviation of the voltage's noise and its quantisation in V."""
    sensors = SensorParameters()
    return float(np.hypot(sensors.voltage_noise_V, sensors.voltage_resolution_V / np.sqrt(12.0)))


def _fit(structure: str) -> Fit:
    if structure in BASELINES:
        return BASELINES[structure]
    return lambda train, capacity_Ah: (
        fit_network(train, capacity_Ah=capacity_Ah, structure=structure, dt_s=DT_S).network
    )


def _summary(cell: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    own = [row for row in rows if row["cell"] == cell]

    def column(key: str) -> FloatArray:
        return np.array([row[key] for row in own])

    return {
        "cell": cell,
        "seeds": len(own),
        "held_out_rmse_mV": float(column("held_out_rmse_mV").mean()),
        "over_noise_mean": float(column("over_noise").mean()),
        "over_noise_max": float(column("over_noise").max()),
        "held_out_against_truth_mV": float(column("held_out_against_truth_mV").mean()),
        "held_out_max_mV": float(column("held_out_max_mV").max()),
        "seconds": float(column("seconds").mean()),
        **({name: _worst(column(name)) for name in READ_OUTS} if "ocv_rms_mV" in own[0] else {}),
        **(
            {"band_holds": [float(f(column("band_holds"))) for f in (np.min, np.max)]} if "band_holds" in own[0] else {}
        ),
    }


def table_errors(network: LocalModelNetwork, parameters: CellParameters) -> dict[str, Any]:
    """Errors of a network's tables over the trained domain, which is where they are read out.

    Returns
    -------
    dict
        `ocv_rms_mV`, `ocv_max_mV` of the voltages after charge and after discharge; `plateau_max_mV` of their mean
        where the curve is flat (None: nowhere); `resistance_rms`, `resistance_max` relative; `ocv_band_holds`,
        `resistance_band_holds`: share of points of each table whose 95 % band holds the truth.
    """
    ocv, resistance = tables_of(network)
    degC, side = ocv.temperature_degC[:, None], np.array(DIRECTIONS)[:, None, None]
    off_V = ocv.voltage_V - open_circuit_V(parameters, ocv.soc, degC, side)
    current, degC = resistance.current_A[:, None, None], resistance.temperature_degC[:, None]
    true_Ohm = settled_resistance_Ohm(parameters, resistance.soc, current, degC)
    off_Ohm = resistance.resistance_Ohm - true_Ohm
    flat = np.array([parameters.open_circuit.slope_at_V(float(soc)) < PLATEAU_V for soc in ocv.soc])
    return {
        "ocv_rms_mV": 1e3 * float(np.sqrt(np.mean(off_V**2))),
        "ocv_max_mV": 1e3 * float(np.abs(off_V).max()),
        "plateau_max_mV": 1e3 * float(np.abs(off_V.mean(axis=0)[:, flat]).max()) if flat.any() else None,
        "resistance_rms": float(np.sqrt(np.mean((off_Ohm / true_Ohm) ** 2))),
        "resistance_max": float(np.abs(off_Ohm / true_Ohm).max()),
        "ocv_band_holds": _held(off_V, ocv.std_V),
        "resistance_band_holds": _held(off_Ohm, resistance.std_Ohm),
    }


def _held(off: FloatArray, std: FloatArray | None) -> float | None:
    return None if std is None else float((np.abs(off) <= 1.96 * std).mean())


def _worst(values: FloatArray) -> float | None:
    known = [value for value in values if value is not None]
    return max(known) if known else None


def _print(result: dict[str, Any]) -> None:
    table = Table(title=f"Held-out free run on simulated cells, structure {result['structure']}")
    for heading in ("cell", "seeds", "RMSE / mV", "x noise", "worst", "against truth / mV", "largest / mV", "fit / s"):
        table.add_column(heading, justify="right")
    for row in result["cells"]:
        table.add_row(
            row["cell"],
            str(row["seeds"]),
            f"{row['held_out_rmse_mV']:.2f}",
            f"{row['over_noise_mean']:.2f}",
            f"{row['over_noise_max']:.2f}",
            f"{row['held_out_against_truth_mV']:.2f}",
            f"{row['held_out_max_mV']:.1f}",
            f"{row['seconds']:.1f}",
        )
    Console().print(table)
    if "band_holds" in result["cells"][0]:
        _print_read_outs(result)


def _print_read_outs(result: dict[str, Any]) -> None:
    table = Table(title="Read-outs against the truth inside the trained domain, worst of all seeds")
    for heading in (
        "cell",
        "OCV rms / mV",
        "largest / mV",
        "plateau / mV",
        "R rms / %",
        "largest / %",
        "95 % band holds",
    ):
        table.add_column(heading, justify="right")
    for row in result["cells"]:
        plateau = row["plateau_max_mV"]
        table.add_row(
            row["cell"],
            f"{row['ocv_rms_mV']:.2f}",
            f"{row['ocv_max_mV']:.1f}",
            "" if plateau is None else f"{plateau:.2f}",
            f"{100 * row['resistance_rms']:.1f}",
            f"{100 * row['resistance_max']:.1f}",
            " to ".join(f"{100 * share:.1f} %" for share in row["band_holds"]),
        )
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=list(CELLS), default=list(CELLS))
    parser.add_argument("--seeds", type=int, default=10, help="number of seeds")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--structure", choices=[*STRUCTURES, *BASELINES], default=STRUCTURES[0])
    parser.add_argument("--duration-s", type=float, default=14000.0)
    parser.add_argument("--ambient-degC", dest="ambient_degC", type=float, default=25.0)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
