"""Pairs of records of electrochemical cells, without and with one effect; run by an environment that has PyBaMM.

``python pybamm_pairs.py FOLDER [--seed 0] [--cases NAME,...]``, which needs PyBaMM and numpy (PyBaMM 26.10 was used).

Written is, for each case, FOLDER/CASE with `base_ident`, `base_valid`, `hidden_ident`, `hidden_valid` (CSV, one sample
a second, positive currents charge) and `meta.json`, as `diagnosis_pybamm.py` reads them. Parameter set, constants,
sizes, window, profiles and sensors are drawn anew for each case; case and seed tell all of them. What is there is not
made again.
"""

import argparse
import gzip
import json
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from pybamm_pair_cells import driven
from pybamm_pair_effects import CASES, Case, Sensors

_COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")


def main() -> int:
    arguments = _arguments()
    left_out = []
    for name in arguments.cases:
        folder = arguments.folder / name
        if not (folder / "meta.json").exists():
            number = zlib.crc32(name.encode())
            case = CASES[name](np.random.default_rng([arguments.seed, number]))
            if not written(folder, name, arguments.seed, case, number):
                left_out.append(name)
    if left_out:
        print(f"left out, their cells follow no profile: {', '.join(left_out)}", file=sys.stderr)
    return int(bool(left_out))


def written(folder: Path, name: str, seed: int, case: Case, number: int) -> bool:
    """Drive both cells of a case and write what the sensors read; less deeply where one of them cannot follow.

    False where one follows nowhere, and nothing is written.
    """
    rng = np.random.default_rng([seed, number, 1])
    while (runs := _driven(case, name, rng)) is None:
        low, high = case.window
        if low + 0.1 > high - 0.2:
            return False
        case = replace(case, window=(low + 0.1, high))
    folder.mkdir(parents=True, exist_ok=True)
    for run, columns in runs.items():
        _write(folder / f"{run}.csv.gz", columns)
    meta = {"case": name, "true_size": case.truth, "capacity_Ah": case.base.capacity_Ah, "seed": seed}
    meta |= {"parameter_set": case.base.parameters, "model": case.base.model, "window": case.window}
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))
    return True


def _driven(case: Case, name: str, rng: np.random.Generator) -> dict[str, np.ndarray] | None:
    """Logs of a pair; None where a cell reaches an end of what it can do."""
    still, out = {"": case.base.ambient_degC[0]}, {}
    for kind in ("ident",) if name == "sei_growth" else ("ident", "valid"):
        for suffix, ambient in case.runs.get(kind, still).items():
            rates = (ident_C if kind == "ident" else valid_C)(case, rng)
            pair = zip(("base", "hidden"), (case.base, case.hidden), case.sensors, strict=True)
            for role, cell, sensors in pair:
                there = replace(cell, ambient_degC=(ambient, cell.ambient_degC[1]))
                columns = driven(there, rates * case.base.capacity_Ah, case.window[1])
                run = "_".join(each for each in (role, kind, suffix) if each)
                print(f"{name} {run}: {len(rates)} s", file=sys.stderr, flush=True)
                if not np.isfinite(columns).all():
                    return None
                out[run] = logged(columns, sensors, rng)
    return out


def logged(columns: np.ndarray, sensors: Sensors, rng: np.random.Generator) -> np.ndarray:
    """What the sensors read."""
    seconds, current, volts, degC, ambient, soc = columns.T
    warm = ambient + sensors.temperature_share * (degC - ambient)
    return np.column_stack(
        [
            seconds,
            np.round(current + sensors.current_offset_A, 4),
            np.round(volts + sensors.volts * rng.standard_normal(len(volts)), 3),
            np.round(warm + sensors.kelvins * rng.standard_normal(len(volts)), 2),
            np.round(ambient, 2),
            np.round(soc, 5),
        ]
    )


def _write(path: Path, columns: np.ndarray) -> None:
    with gzip.open(path, "wt", encoding="utf-8") as file:
        np.savetxt(file, columns, fmt="%g", delimiter=",", header=",".join(_COLUMNS), comments="")


def ident_C(case: Case, rng: np.random.Generator) -> np.ndarray:
    """(n,) rates: pulses and rests at levels of charge down the window, loads between them, and back up."""
    low, high = case.window
    parts, soc = [np.zeros(600)], high
    for sign in (-1.0, 1.0):
        end = low if sign < 0.0 else high
        while sign * (end - soc) > 0.02:
            parts.append(_pulses(case.peak_C, rng))
            step = min(0.1, sign * (end - soc))
            part = _load(sign, step, 0.6 * case.peak_C if sign < 0.0 else 0.3, rng)
            parts += [part, np.zeros(int(rng.choice([0.2, 0.4, 1.0]) * case.rest_s))]
            soc += float(part.sum()) / 3600.0
    return np.concatenate([*parts, np.zeros(int(case.rest_s))])


def valid_C(case: Case, rng: np.random.Generator) -> np.ndarray:
    """(n,) rates of a drive down to the middle of the window, with a long rest now and then."""
    low, high = case.window
    parts, soc = [np.zeros(300)], high
    while soc > 0.5 * (low + high) - 0.1:
        n = int(rng.integers(200, 700))
        noise = np.convolve(rng.standard_normal(n + 10), np.ones(6) / 2.5, mode="same")[:n]
        part = np.clip(-0.45 + 0.6 * noise, -case.peak_C, 0.35)
        if rng.random() < 0.3:
            part = np.zeros(int(rng.integers(60, 600)))
        parts.append(part)
        soc += float(part.sum()) / 3600.0
    return np.concatenate([*parts, np.zeros(1200)])


def _pulses(peak_C: float, rng: np.random.Generator) -> np.ndarray:
    parts = []
    for rate in peak_C * np.array([0.25, 0.5, 1.0]):
        back = float(rng.choice([0.15, 0.4])) * rate
        parts += [np.full(10, -rate), np.zeros(60), np.full(round(10 * rate / back), back), np.zeros(60)]
    return np.concatenate(parts)


def _load(sign: float, step: float, most_C: float, rng: np.random.Generator) -> np.ndarray:
    parts, moved = [], 0.0
    while moved < step:
        rate, n = rng.uniform(0.15, most_C), int(rng.integers(30, 300))
        n = max(1, min(n, int(3600.0 * (step - moved) / rate) + 1))
        parts += [np.full(n, sign * rate), np.zeros(int(rng.integers(40, 90))) if rng.random() < 0.3 else np.zeros(0)]
        moved += n * rate / 3600.0
    return np.concatenate(parts)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=lambda text: text.split(","), default=list(CASES), metavar="NAME,...")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
