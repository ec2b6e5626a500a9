"""Own models and those of others on the same files: held-out free-run error, fit time, speed.

``python benchmarks/peers.py --train RUN... --validate RUN... --capacity-Ah Q [--peers-python PYTHON] [--json]``
``python benchmarks/peers.py --simulated nmc --seed 0 [--peers-python PYTHON] [--json]``

The peers are no part of the project's environment. Install them in one of their own and name its interpreter:

    python3 -m venv peers && peers/bin/pip install pybatteryid==3.0.2 sysidentpy==0.9.0
    python benchmarks/peers.py ... --peers-python peers/bin/python

All get the same samples on the same even grid, with one BLAS thread, and choose their settings on the training runs
alone. pybatteryid needs the open-circuit voltage beforehand: it gets that of the fitted 2RC circuit. Neither peer takes
missing samples: theirs are interpolated, and do not count in any error. A peer's run begins from 4 measured voltages.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from simulated_cells import DT_S, simulated_run
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run
from models.baselines import (
    CellModel,
    EquivalentCircuit,
    fit_enhanced_self_correcting,
    fit_equivalent_circuit,
)
from models.data.errors import ModelError
from models.data.metrics import metrics
from models.data.resampling import GridRun, to_grid, typical_interval_s
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.network.free_run import free_run_V
from models.network.signals import soc_by_counting
from models.pipeline import STRUCTURES, fit_network

PEERS = ("pybatteryid", "sysidentpy")
INSTALL = "python3 -m venv peers && peers/bin/pip install pybatteryid==3.0.2 sysidentpy==0.9.0, then --peers-python"
WORKER = Path(__file__).with_name("peer_worker.py")
_WARM_UP_SAMPLES = 3000
# Beyond any battery: such a run has no error worth a figure.
_DIVERGED_V = 1e4


@dataclass(frozen=True)
class Data:
    """The runs of one comparison, and the same on the grid."""

    train: list[TimeSeries]
    validate: list[TimeSeries]
    capacity_Ah: float
    dt_s: float

    def grid(self, runs: list[TimeSeries]) -> list[GridRun]:
        """Put runs on the comparison's grid."""
        return [to_grid(run, self.dt_s) for run in runs]


def main() -> int:
    arguments = _arguments()
    data = _data(arguments)
    say = Console(stderr=True)
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1, user_api="blas"):
        emf_from: EquivalentCircuit | None = None
        for name, fit in _own(data, arguments.structure).items():
            say.print(f"fitting {name} ...")
            row, model = judge_own(name, fit, data)
            rows.append(row)
            emf_from = model if isinstance(model, EquivalentCircuit) and name == "2RC circuit" else emf_from
    for peer in PEERS:
        say.print(f"fitting {peer} ...")
        rows.append(judge_peer(peer, data, emf_from, arguments.peers_python, arguments.peer_limit_s))
    result = {
        "train": [run.name for run in data.train],
        "validate": [run.name for run in data.validate],
        "capacity_Ah": data.capacity_Ah,
        "dt_s": data.dt_s,
        "n_train_samples": sum(len(run) for run in data.grid(data.train)),
        "models": rows,
    }
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0


def judge_own(
    name: str, fit: Callable[[list[TimeSeries]], CellModel], data: Data
) -> tuple[dict[str, Any], CellModel | None]:
    """Fit one of this project's models and simulate the held-out runs; a refusal is a row with its reason."""
    _warm_up(fit, data)
    try:
        began = time.perf_counter()
        model = fit(data.train)
        fit_s = time.perf_counter() - began
        grid, soc = data.grid(data.validate), [start_soc(run) for run in data.validate]
        free_run_V(model, grid[0], soc[0])
        began = time.perf_counter()
        simulated = [free_run_V(model, run, s) for run, s in zip(grid, soc, strict=True)]
        run_s = time.perf_counter() - began
    except ModelError as error:
        return _failed(name, str(error)), None
    speed = sum(len(run) for run in grid) / run_s
    return _row(name, None, grid, simulated, fit_s, speed), model


def judge_peer(
    peer: str, data: Data, emf_from: EquivalentCircuit | None, python: str, limit_s: float
) -> dict[str, Any]:
    """Fit a peer in its own environment; one that is not installed is a row that says how to install it."""
    found = subprocess.run([python, "-c", f"import {peer}"], capture_output=True, check=False)
    if found.returncode != 0:
        return _failed(peer, f"not installed in {python}: {INSTALL}")
    if peer == "pybatteryid" and emf_from is None:
        return _failed(peer, "needs an open-circuit voltage, and the 2RC circuit could not be fitted")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _write_request(folder, data, emf_from, limit_s)
        try:
            done = subprocess.run(
                [python, str(WORKER), peer, scratch],
                capture_output=True,
                text=True,
                check=False,
                timeout=5.0 * limit_s,
                env=os.environ | {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")},
            )
        except subprocess.TimeoutExpired:
            return _failed(peer, f"not done after {5.0 * limit_s:g} s")
        if done.returncode != 0:
            return _failed(peer, (done.stderr.strip() or "failed without a word").splitlines()[-1])
        answer = json.loads((folder / "answer.json").read_text())
        simulated = [np.load(folder / f"simulated_validate{i}.npy") for i in range(len(data.validate))]
    grid = data.grid(data.validate)
    name = f"{peer} {answer['version']}"
    row = _row(name, answer["setting"], grid, simulated, answer["fit_seconds"], answer["samples_per_second"])
    return row | {"tried": answer["tried"], "final_fit_seconds": answer["final_fit_seconds"]}


def _own(data: Data, structure: str) -> dict[str, Callable[[list[TimeSeries]], CellModel]]:
    capacity_Ah, dt_s = data.capacity_Ah, data.dt_s
    return {
        f"network ({structure})": lambda train: (
            fit_network(train, capacity_Ah=capacity_Ah, structure=structure, dt_s=dt_s).network
        ),
        "1RC circuit": lambda train: fit_equivalent_circuit(train, capacity_Ah=capacity_Ah, n_branches=1, dt_s=dt_s),
        "2RC circuit": lambda train: fit_equivalent_circuit(train, capacity_Ah=capacity_Ah, n_branches=2, dt_s=dt_s),
        "ESC 3RC (Plett)": lambda train: fit_enhanced_self_correcting(train, capacity_Ah=capacity_Ah, dt_s=dt_s),
    }


def _warm_up(fit: Callable[[list[TimeSeries]], CellModel], data: Data) -> None:
    """Compile what is compiled at the first call; whether the short piece can be fitted does not matter."""
    run = data.train[0]
    piece = slice(0, min(_WARM_UP_SAMPLES, len(run)))
    columns = {
        key: None if getattr(run, key) is None else getattr(run, key)[piece]
        for key in ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    }
    try:
        fit([replace(run, **columns)])
    except ModelError:
        return


def _write_request(folder: Path, data: Data, emf_from: EquivalentCircuit | None, limit_s: float) -> None:
    named = {"train": data.train, "validate": data.validate}
    temperature = True
    for role, runs in named.items():
        for i, (run, series) in enumerate(zip(data.grid(runs), runs, strict=True)):
            known = np.flatnonzero(run.measured)
            degC = run.temperature_degC
            temperature &= not bool(np.isnan(degC).any())
            np.savez(
                folder / f"{role}{i}.npz",
                current_A=run.current_A,
                voltage_V=np.interp(np.arange(len(run)), known, run.voltage_V[known]),
                temperature_degC=np.nan_to_num(degC, nan=25.0),
                soc=soc_by_counting(run.charge_Ah, start_soc(series), data.capacity_Ah),
            )
    request = {
        **{role: [f"{role}{i}" for i in range(len(runs))] for role, runs in named.items()},
        "capacity_Ah": data.capacity_Ah,
        "dt_s": data.dt_s,
        "temperature": temperature,
        "emf": None if emf_from is None else _emf(emf_from),
        "limit_s": limit_s,
    }
    (folder / "request.json").write_text(json.dumps(request))


def _emf(circuit: EquivalentCircuit) -> dict[str, Any]:
    """Open-circuit voltage of a circuit in pybatteryid's terms: a curve and its slope over temperature."""
    table = circuit.ocv_V
    degC = table.temperature_degC
    # The counted charge of a held-out run may end beyond the training runs: the curve goes on as a straight line.
    soc = np.concatenate([[2.0 * table.soc[0] - table.soc[1]], table.soc, [2.0 * table.soc[-1] - table.soc[-2]]])
    values = np.vstack(
        [2.0 * table.values[0] - table.values[1], table.values, 2.0 * table.values[-1] - table.values[-2]]
    )
    middle = float(degC.mean())
    slope = ((degC - middle) @ values.T) / max(float(((degC - middle) ** 2).sum()), 1e-9)
    dependent = len(degC) > 1
    return {
        "soc_values": soc.tolist(),
        "voltage_values": values.mean(axis=1).tolist(),
        "dVdT_values": slope.tolist() if dependent else None,
        "reference_temperature_value": middle if dependent else None,
    }


def _row(
    name: str, setting: str | None, grid: list[GridRun], simulated: list[FloatArray], fit_s: float, speed: float
) -> dict[str, Any]:
    runs = []
    for run, voltage_V in zip(grid, simulated, strict=True):
        diverged = not bool(np.isfinite(voltage_V).all()) or float(np.abs(voltage_V).max()) > _DIVERGED_V
        runs.append({"run": run.name, "diverged": diverged} | ({} if diverged else metrics(run.voltage_V, voltage_V)))
    overall = None
    if not any(run["diverged"] for run in runs):
        overall = metrics(np.concatenate([run.voltage_V for run in grid]), np.concatenate(simulated))
    return {
        "model": name,
        "setting": setting,
        "overall": overall,
        "runs": runs,
        "fit_seconds": fit_s,
        "samples_per_second": speed,
        "failure": None,
    }


def _failed(name: str, reason: str) -> dict[str, Any]:
    return {
        "model": name,
        "setting": None,
        "overall": None,
        "runs": [],
        "fit_seconds": None,
        "samples_per_second": None,
        "failure": reason,
    }


def _print(result: dict[str, Any]) -> None:
    table = Table(title=f"Held-out free run, {result['n_train_samples']} training samples at {result['dt_s']:g} s")
    for heading in ("model", "setting", "RMSE / mV", "MAE", "p95", "max", "fit / s", "samples / s"):
        table.add_column(heading, justify="left" if heading in ("model", "setting") else "right")
    each = Table(title="RMSE / mV of each held-out run")
    each.add_column("run")
    for row in result["models"]:
        each.add_column(row["model"], justify="right")
        if row["failure"]:
            table.add_row(row["model"], row["failure"])
            continue
        overall = row["overall"]
        figures = [f"{overall[key]:.2f}" for key in ("rmse_mV", "mae_mV", "p95_mV", "max_mV")] if overall else None
        speed = f"{row['samples_per_second']:.3g}"
        table.add_row(
            row["model"],
            row["setting"] or "",
            *(figures or ["diverges", "", "", ""]),
            f"{row['fit_seconds']:.1f}",
            speed,
        )
    for i, name in enumerate(result["validate"]):
        each.add_row(name, *(_one(row, i) for row in result["models"]))
    console = Console()
    console.print(table)
    console.print(each)


def _one(row: dict[str, Any], i: int) -> str:
    if row["failure"]:
        return "-"
    run = row["runs"][i]
    return "diverges" if run["diverged"] else f"{run['rmse_mV']:.1f}"


def _data(arguments: argparse.Namespace) -> Data:
    if arguments.simulated:
        runs = [simulated_run(arguments.simulated, arguments.seed, number) for number in (0, 1)]
        return Data([runs[0].series], [runs[1].series], runs[0].capacity_Ah, arguments.dt_s or DT_S)
    train, validate = ([read_run(path) for path in paths] for paths in (arguments.train, arguments.validate))
    return Data(train, validate, arguments.capacity_Ah, arguments.dt_s or typical_interval_s(train))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--train", nargs="+", metavar="RUN", help="files that the models are made from")
    parser.add_argument("--validate", nargs="+", metavar="RUN", help="files that only judge")
    parser.add_argument("--capacity-Ah", dest="capacity_Ah", type=float)
    parser.add_argument(
        "--simulated", choices=("nmc", "lfp", "nimh"), help="runs of a simulated cell in place of files"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the simulated runs")
    parser.add_argument("--dt-s", dest="dt_s", type=float, help="grid step; by default the typical interval")
    parser.add_argument("--structure", choices=STRUCTURES, default=STRUCTURES[0], help="of the network")
    parser.add_argument("--peers-python", default=sys.executable, help="interpreter that has the peers")
    parser.add_argument("--peer-limit-s", type=float, default=300.0, help="after this a peer tries no further setting")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    arguments = parser.parse_args()
    if not arguments.simulated and not (arguments.train and arguments.validate and arguments.capacity_Ah):
        parser.error("give --train, --validate and --capacity-Ah, or --simulated")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
