"""A bench that learns: runs in lock-step on a simulated cell that ages by 1 % each, through the service.

``python benchmarks/learning_bench.py [--runs 10] [--structure auto] [--json]``

A model is fitted to a first run of the new cell. Before each further run the cell has lost 1 % of its capacity and has
1 % more resistance; the run is started with `learn`, so that the newest version is used and the next one is made from
it. A second bench with a cell as old plays another profile, which nobody learns from: by it each version, and the
first model, are judged. Bar: every version within 1.2 x the noise of the sensor.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from simulated_cells import DT_S, INITIAL_SOC, noise_V

from bench_service.client import BenchClient
from models.design import StepProfileRequest, step_profile
from simulators.catalogue import cell_type

CELL, AGEING, BAR = "nmc", 0.01, 1.2
NEW, LATER = ((0.1, 0.9), 14000.0), ((0.2, 0.8), 10500.0)
_PARAMETERS = cell_type(CELL).parameters


def main() -> int:
    arguments = _arguments()
    with tempfile.TemporaryDirectory() as folder:
        rows = learned(Path(folder), arguments.runs, arguments.structure)
    answer = {"bar": BAR, "noise_mV": 1e3 * noise_V(), "kept": all(row["version"] <= BAR for row in rows), "runs": rows}
    if arguments.json:
        print(json.dumps(answer))
    else:
        _print(answer)
    return 0 if answer["kept"] else 1


def learned(folder: Path, runs: int, structure: str) -> list[dict[str, Any]]:
    """One row for each age of the cell; errors in multiples of the sensor's noise."""
    rows, first = [], ""
    for age in range(runs + 1):
        with served(folder, age) as client:
            played, judge = play(client, age, first)
            if not first:
                first = client.fit("new cell", [played], _PARAMETERS.capacity_Ah, structure=structure)["id"]
            newest = _newest(client, first, played) if age else first
            rows.append({"age": age, "model": newest["id"] if age else first, **_judged(client, first, newest, judge)})
            print(f"run {age}: {rows[-1]}", file=sys.stderr, flush=True)
    return rows


def play(client: BenchClient, age: int, first: str) -> tuple[str, str]:
    """Play one profile on the cell and another on that which judges, at the same time."""
    ids = []
    for number, bench in enumerate(("cell", "judge")):
        (soc, duration_s) = LATER if age or number else NEW
        profile = step_profile(
            StepProfileRequest(
                capacity_Ah=_PARAMETERS.capacity_Ah,
                current_A=(-2.0 * _PARAMETERS.capacity_Ah, _PARAMETERS.capacity_Ah),
                soc=soc,
                initial_soc=INITIAL_SOC,
                duration_s=duration_s,
                dt_s=DT_S,
            ),
            np.random.default_rng([age, number]),
        )
        stored = client.upload_profile(f"{bench} {age}", profile.time_s.tolist(), profile.current_A.tolist())
        learns = {"model_id": first, "learn": True} if first and bench == "cell" else {}
        ids.append(client.start_run(bench, stored["id"], DT_S, INITIAL_SOC, **learns)["id"])  # pyright: ignore
    for run_id in ids:
        ended = client.wait_run(run_id)
        assert ended["state"] == "completed", ended["reason"]
    return ids[0], ids[1]


def _newest(client: BenchClient, first: str, run_id: str) -> dict[str, Any]:
    """Record of the version that was made from a run, as soon as it is there."""
    for _ in range(600):
        for model in client.models():
            if (model["metrics"] or {}).get("learned_from") == run_id:
                return model
        time.sleep(0.2)
    raise TimeoutError(f"nothing was learned from run {run_id}, a descendant of {first}")


def _judged(client: BenchClient, first: str, newest: Any, judge: str) -> dict[str, Any]:
    def error(model_id: str) -> float:
        found = client.compare(model_id, [judge], INITIAL_SOC)["result"]["overall"]["rmse_mV"]
        return float(found / (1e3 * noise_V()))

    old = error(first)
    if isinstance(newest, str):
        return {"version": old, "old": old, "unseen": None, "capacity_Ah": _PARAMETERS.capacity_Ah}
    unseen = newest["metrics"]["error_before_mV"] / (1e3 * noise_V())
    return {"version": error(newest["id"]), "old": old, "unseen": unseen, "capacity_Ah": newest["capacity_Ah"]}


@contextmanager
def served(folder: Path, age: int) -> Iterator[BenchClient]:
    """A service whose two benches have a cell of some age; what is stored stays from age to age."""
    more, nominal = (1.0 + AGEING) ** age, _PARAMETERS
    beside_Ohm = (more - 1.0) * (nominal.ohmic_Ohm + nominal.fast_1.resistance_Ohm + nominal.fast_2.resistance_Ohm)
    effects = {
        "series_resistance": beside_Ohm,
        "soc_dependence": more * nominal.ohmic_at_empty_Ohm,
        "relaxation": more * nominal.slow.resistance_Ohm,
        "charge_transfer": more * nominal.charge_transfer_V,
    }
    told = ", ".join(f"{name} = {value!r}" for name, value in effects.items())
    lines = ['data_dir = "data"']
    for seed, bench in enumerate(("cell", "judge")):
        lines += [f"[bench.{bench}]", f"capacity_Ah = {nominal.capacity_Ah}", f"[bench.{bench}.simulate]"]
        lines += [f'cell = "{CELL}"', f"capacity_Ah = {nominal.capacity_Ah * (1.0 - AGEING) ** age!r}"]
        lines += [f"seed = {2 * age + seed + 1}", f"initial_soc = {INITIAL_SOC}", f"effects = {{ {told} }}"]
    (folder / "bench.toml").write_text("\n".join(lines))
    command = [sys.executable, "-m", "bench_service.cli", "serve", "--config", "bench.toml", "--port", "0"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as service:
        try:
            assert service.stdout is not None
            address = next(line.split()[1].rstrip(",") for line in service.stdout if line.startswith("serving"))
            with BenchClient(address, timeout_s=120.0) as client:
                while any(bench["state"] == "offline" for bench in client.benches()):
                    time.sleep(0.2)
                yield client
        finally:
            service.terminate()
            service.wait(60.0)


def _print(answer: dict[str, Any]) -> None:
    table = Table(title=f"Held-out error in multiples of the noise ({answer['noise_mV']:.2f} mV), bar {answer['bar']}")
    for heading in ("run", "newest version", "the run before it was seen", "first model", "capacity / Ah", "true"):
        table.add_column(heading, justify="right")
    for row in answer["runs"]:
        table.add_row(
            str(row["age"]),
            f"{row['version']:.2f}",
            "" if row["unseen"] is None else f"{row['unseen']:.2f}",
            f"{row['old']:.2f}",
            f"{row['capacity_Ah']:.4f}",
            f"{_PARAMETERS.capacity_Ah * (1.0 - AGEING) ** row['age']:.4f}",
        )
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--structure", default="auto")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
