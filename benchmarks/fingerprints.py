"""Fingerprints of what the program answers, to show that a change of its inside leaves every answer as it was.

``python benchmarks/fingerprints.py FOLDER --data DATA [--against FORMER] [--only fit,diagnose] [--tolerance 0]``

Writes the answers of the tree it is run in to FOLDER: models of six fits, ten diagnoses, three designs, an observer's
replay, a comparison, a simulation that warms itself and the models of a module, on simulated cells and on the
measurements in DATA. With ``--against`` every number is held against the folder that another tree wrote, and the models
that the other tree wrote are read by this one. Exits 1 where something differs by more than the tolerance, relative to
the largest number of the same list.
"""

import argparse
import concurrent.futures
import contextlib
import csv
import gzip
import json
import math
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from models.network.free_run import free_run_V

# What a clock, a folder or a commit moves.
VOLATILE = ("seconds", "code_version", "us_per_step", "model", "profile", "file", "report", "parent")
CELLS = ("nmc", "lfp", "nimh")
DIAGNOSED = (
    ("simulated_nmc", "structure", "simulated_nmc_hidden"),
    ("simulated_nmc", "change", "simulated_nmc_hidden"),
    ("simulated_lfp", "change", "simulated_lfp_drift"),
    ("simulated_lfp", "structure", "simulated_lfp_valid"),
    ("simulated_nimh", "structure", "simulated_nimh_valid"),
    ("null", "change", "null_hidden"),
    ("null", "structure", "null_valid"),
    ("null", "change", "contact_resistance_hidden"),
    ("null", "change", "slow_diffusion_hidden"),
    ("panasonic", "change", "panasonic_valid"),
)
HIDDEN = {
    "simulated_nmc_hidden": {"series_resistance": 0.004, "hysteresis": 0.012},
    "simulated_lfp_drift": {"self_discharge": 0.02},
}


def main() -> int:
    arguments = _arguments()
    folder = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    runs = _runs(folder, arguments.data.resolve())
    stages = [_fits(folder, runs), _answers(folder, runs)]
    asked = arguments.only.split(",") if arguments.only else None
    with concurrent.futures.ThreadPoolExecutor(arguments.workers) as pool:
        for stage in stages:
            jobs = [(name, command) for name, command in stage.items() if asked is None or name.split("_")[0] in asked]
            for name, seconds in pool.map(_run, jobs):
                print(f"{name}: {seconds:.1f} s", file=sys.stderr, flush=True)
    if arguments.against is None:
        return 0
    return _compare(arguments.against.resolve(), folder, arguments.tolerance)


def _runs(folder: Path, data: Path) -> dict[str, list[Path]]:
    """Files of each set of runs; simulated ones are written once."""
    pybamm, panasonic, a123 = data / "pybamm", data / "panasonic_18650pf", data / "a123_esc"
    runs = {
        "null_train": [pybamm / "null/base_ident.csv.gz"],
        "null_valid": [pybamm / "null/base_valid.csv.gz"],
        "null_hidden": [pybamm / "null/hidden_ident.csv.gz"],
        "contact_resistance_hidden": [pybamm / "contact_resistance/hidden_ident.csv.gz"],
        "slow_diffusion_hidden": [pybamm / "slow_diffusion/hidden_ident.csv.gz"],
        "panasonic_train": [panasonic / f"drive_{t}degC_Cycle_1.csv.gz" for t in ("25", "10", "0")],
        "panasonic_valid": [panasonic / f"drive_{t}degC_US06.csv.gz" for t in ("25", "10")],
        "a123_train": [a123 / "dyn_P25.csv.gz"],
        "a123_valid": [a123 / "dyn_P25_recharge25.csv.gz"],
    }
    for cell in CELLS:
        for seed, part in enumerate(("train", "valid", "hidden", "drift")):
            name = f"simulated_{cell}_{part}"
            path = folder / f"{name}.csv.gz"
            if not path.exists():
                _simulate(path, cell, seed, HIDDEN.get(name, {}))
            runs[name] = [path]
    return runs


def _simulate(path: Path, cell: str, seed: int, effects: dict[str, float]) -> None:
    """Play multi-level steps to a simulated cell; its own equations, so that they are the same in every tree."""
    from simulators.catalogue import cell_type
    from simulators.cell import Cell
    from simulators.effects import apply_effects
    from simulators.sensors import SensorParameters, Sensors

    kind, rng = cell_type(cell), np.random.default_rng([7, CELLS.index(cell), seed])
    parameters, sensor_parameters = apply_effects(kind.parameters, SensorParameters(), effects)
    truth, sensors = Cell(parameters, 0.5, 25.0), Sensors(sensor_parameters, rng)
    soc, level, rows = 0.5, 0.0, []
    for k in range(6000):
        if k % 40 == 0:
            low, high = (-2.0 if soc > 0.15 else 0.0), (1.0 if soc < 0.85 else 0.0)
            level = 0.0 if (k // 40) % 3 == 0 else float(rng.uniform(low, high)) * parameters.capacity_Ah
        out = truth.step(level if k else 0.0, 1.0 if k else 0.0)
        soc += level / 3600.0 / parameters.capacity_Ah if k else 0.0
        read = sensors.measure(out, level if k else 0.0, 25.0)
        rows.append((float(k), read.current_A, read.voltage_V, read.temperature_degC, 25.0, 0.5 if k == 0 else ""))
    with gzip.open(path, "wt", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref"])
        writer.writerows(rows)


def _capacity(name: str) -> float:
    if name.startswith("simulated_"):
        from simulators.catalogue import cell_type

        return cell_type(name.split("_")[1]).parameters.capacity_Ah
    return {"null": 5.1099, "panasonic": 2.968, "a123": 2.06}[name]


def _fits(folder: Path, runs: dict[str, list[Path]]) -> dict[str, list[str]]:
    structures = {
        "simulated_nmc": "full",
        "simulated_lfp": "auto",
        "simulated_nimh": "minimal",
        "null": "auto",
        "panasonic": "full",
        "a123": "auto",
    }
    jobs = {}
    for name, structure in structures.items():
        valid = runs.get(f"{name}_valid", [])
        jobs[f"fit_{name}"] = [
            "fit",
            *map(str, runs[f"{name}_train"]),
            *(["--validate", *map(str, valid)] if valid else []),
            *("--capacity-Ah", str(_capacity(name)), "--structure", structure),
            *("--out", str(folder / f"model_{name}.json")),
        ]
    return jobs


def _answers(folder: Path, runs: dict[str, list[Path]]) -> dict[str, list[str]]:
    jobs = {}
    for number, (name, mode, judged) in enumerate(DIAGNOSED):
        model, train = str(folder / f"model_{name}.json"), map(str, runs[f"{name}_train"])
        files = list(map(str, runs[judged]))
        jobs[f"diagnose_{number}"] = ["diagnose", model, *files, "--train", *train, "--mode", mode]
    for number, request in enumerate(_requests()):
        path = folder / f"request_{number}.toml"
        path.write_text(request, encoding="utf-8")
        tomllib.loads(request)
        jobs[f"design_{number}"] = ["design", str(path), "--out", str(folder / f"profile_{number}.csv")]
    lfp, valid = str(folder / "model_simulated_lfp.json"), [str(p) for p in runs["simulated_lfp_valid"]]
    jobs["observe_lfp"] = ["observe", lfp, *valid, "--initial-soc", "0.7", "--out", str(folder / "soc_lfp.csv")]
    nmc, hidden = str(folder / "model_simulated_nmc.json"), [str(p) for p in runs["simulated_nmc_hidden"]]
    jobs["observe_nmc"] = ["observe", nmc, *hidden, "--initial-soc", "0.4", "--out", str(folder / "soc_nmc.csv")]
    jobs["compare_panasonic"] = ["compare", str(folder / "model_panasonic.json"), *map(str, runs["panasonic_valid"])]
    minimal, train = str(folder / "model_simulated_nimh.json"), [str(p) for p in runs["simulated_nimh_train"]]
    jobs["effect_nimh"] = [
        *("add-effect", minimal, "hysteresis", "--train", *train),
        *("--validate", *map(str, runs["simulated_nimh_valid"])),
        *("--out", str(folder / "model_nimh_hysteresis.json")),
    ]
    jobs["warm"] = ["warm", str(folder)]
    jobs["module"] = ["module", str(folder)]
    return jobs


def _requests() -> list[str]:
    limits = "[limits]\ncurrent_A = [-{i}, {j}]\nsoc = [0.15, 0.85]\n"
    nmc, lfp = _capacity("simulated_nmc"), _capacity("simulated_lfp")
    head = 'model = "model_{name}.json"\ninitial_soc = 0.5\nduration_s = {t}\nseed = 3\n'
    return [
        head.format(name="simulated_nmc", t=3600.0) + limits.format(i=2 * nmc, j=nmc),
        head.format(name="simulated_lfp", t=2400.0) + 'signal = "aprbs"\n' + limits.format(i=2 * lfp, j=lfp),
        head.format(name="simulated_nmc", t=1200.0)
        + 'criterion = "discriminate"\nruns = ["simulated_nmc_train.csv.gz"]\n'
        + 'rivals = ["hysteresis", "relaxation"]\n'
        + limits.format(i=2 * nmc, j=nmc),
    ]


def _run(job: tuple[str, list[str]]) -> tuple[str, float]:
    """Answer one question in a process of its own, and keep what it says."""
    import time

    name, words = job
    answer = Path(words[-1] if words[0] in ("warm", "module") else _folder_of(words)) / f"answer_{name}.json"
    began = time.perf_counter()
    own = words[0] in ("warm", "module")
    program = [str(Path(__file__).resolve()), f"--{words[0]}"] if own else ["-m", "bench_service.cli"]
    command = [sys.executable, *program, *(words[1:] if own else [*words, "--json"])]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    found = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    # A refusal is an answer too.
    text = found.stdout if found.returncode == 0 else json.dumps({"refused": found.returncode, "why": found.stderr})
    answer.write_text(text, encoding="utf-8")
    return name + ("" if found.returncode == 0 else f" REFUSED {found.stderr[-300:]}"), time.perf_counter() - began


def _folder_of(words: list[str]) -> Path:
    own = [Path(w) for w in words if Path(w).name.startswith(("model_", "request_"))]
    return own[0].parent


def _warm(folder: Path) -> dict[str, Any]:
    """Simulate voltage and temperature together, without measured temperature."""
    from models.network.local_model_network import LocalModelNetwork
    from models.thermal.cell_temperature import thermal_of
    from models.thermal.closed_loop import simulate_closed

    network = LocalModelNetwork.from_json(json.loads((folder / "model_simulated_nmc.json").read_text()))
    thermal = thermal_of(network)
    assert thermal is not None, "the simulated cell's fit has no thermal model"
    rng = np.random.default_rng(5)
    current_A = np.repeat(rng.uniform(-4.0, 3.0, 60), 50)
    found = simulate_closed(network, *thermal, current_A, 25.0, initial_soc=0.6)
    return {"voltage_V": found.voltage_V.tolist(), "temperature_degC": found.temperature_degC.tolist()}


def _module(folder: Path) -> dict[str, Any]:
    """Models S1 to S4 of a simulated module."""
    from module_models import LAYOUTS, judge

    from models.data.resampling import to_grid
    from models.network.local_model_network import LocalModelNetwork

    network = LocalModelNetwork.from_json(json.loads((folder / "model_simulated_nmc.json").read_text()))
    found = judge("nmc", LAYOUTS[1], lambda run: free_run_V(network, to_grid(run, 1.0), 0.5))
    return {key: value for key, value in found.items() if key != "layout"}


def _compare(former: Path, folder: Path, tolerance: float) -> int:
    table = Table(title=f"{folder} against {former}")
    for heading in ("answer", "numbers", "largest difference", "where", ""):
        table.add_column(heading)
    failed = 0
    for path in sorted([*former.glob("answer_*.json"), *former.glob("model_*.json"), *former.glob("*.csv")]):
        other = folder / path.name
        if not other.exists():
            table.add_row(path.name, "", "", "not written here", "FAILED")
            failed += 1
            continue
        largest, where, count = 0.0, "", 0
        for place, difference in _differences(_read(path), _read(other), ""):
            count += 1
            if difference > largest:
                largest, where = difference, place
        bad = largest > tolerance
        failed += bad
        table.add_row(path.name, str(count), f"{largest:.2g}", where, "FAILED" if bad else "equal")
    failed += _unread(former)
    Console(width=160).print(table)
    return 1 if failed else 0


def _unread(former: Path) -> int:
    """Count models of the former tree that this one does not read, or reads as something else."""
    from models.network.local_model_network import LocalModelNetwork

    failed = 0
    for path in sorted(former.glob("model_*.json")):
        document = json.loads(path.read_text(encoding="utf-8"))
        again = json.loads(json.dumps(LocalModelNetwork.from_json(document).to_json()))
        if max((d for _, d in _differences(document, again, "")), default=0.0) > 0.0:
            print(f"{path.name}: read, but not written as it was", file=sys.stderr)
            failed += 1
    return failed


def _read(path: Path) -> Any:
    if path.suffix == ".csv":
        with path.open(newline="") as file:
            columns = list(zip(*csv.reader(file), strict=True))
        return {column[0]: [_plain(cell) for cell in column[1:]] for column in columns}
    return json.loads(path.read_text(encoding="utf-8"))


def _plain(cell: str) -> Any:
    with contextlib.suppress(ValueError):
        return float(cell)
    return cell


def _differences(one: Any, other: Any, place: str) -> Iterator[tuple[str, float]]:
    """Place and relative difference of every value; of a list of numbers the largest over its largest number."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in sorted({*one, *other} - set(VOLATILE)):
            if key not in one or key not in other:
                yield f"{place}.{key}", math.inf
            else:
                yield from _differences(one[key], other[key], f"{place}.{key}")
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield place, math.inf
        elif one and all(type(x) in (int, float) for x in [*one, *other]):
            a, b = np.array(one, dtype=np.float64), np.array(other, dtype=np.float64)
            differ = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b))
            yield place, float(differ.max() / (np.nanmax(np.abs(a)) or 1.0))
        else:
            for i, (x, y) in enumerate(zip(one, other, strict=True)):
                yield from _differences(x, y, f"{place}[{i}]")
    elif isinstance(one, int | float) and isinstance(other, int | float):
        same = one == other or (math.isnan(one) and math.isnan(other))
        yield place, 0.0 if same else abs(one - other) / (abs(one) or 1.0)
    elif isinstance(one, str) and isinstance(other, str) and ("/" in one or len(one) == 64):
        # Paths, and hashes of documents with a path or a clock in them.
        yield place, 0.0
    else:
        yield place, 0.0 if one == other else math.inf


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder with the measurements")
    parser.add_argument("--against", type=Path, metavar="FORMER", help="folder that another tree wrote")
    parser.add_argument("--only", metavar="KIND,...", help="fit, diagnose, design, observe, compare, effect, ...")
    parser.add_argument("--tolerance", type=float, default=0.0)
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args()


if __name__ == "__main__":
    if sys.argv[1] in ("--warm", "--module"):
        print(json.dumps((_warm if sys.argv[1] == "--warm" else _module)(Path(sys.argv[2]))))
        sys.exit(0)
    sys.exit(main())
