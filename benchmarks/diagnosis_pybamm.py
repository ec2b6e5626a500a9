"""Change mode on pairs of records of an electrochemical simulator: the same cell without and with one effect.

``python benchmarks/diagnosis_pybamm.py FOLDER [--models FOLDER] [--structure auto] [--json]``

FOLDER holds one folder for each pair with `base_ident*`, `base_valid*`, `hidden_ident*`, `hidden_valid*` (CSV) and
`meta.json`. For each, a network is fitted to `base_ident*` (or read from `--models` as CASE.json, and kept there), and
`hidden_*` is diagnosed in change mode with `base_ident*` as training runs. The first `soc_ref` starts each run.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run_file
from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.network.local_model_network import LocalModelNetwork
from models.pipeline import STRUCTURES, fit_network

# Names that are right; a set of two as the first two findings of an ambiguous verdict.
RIGHT: dict[str, set[str]] = {
    "capacity_fade": {"capacity", "lithium_loss"},
    "contact_resistance": {"series_resistance"},
    "current_offset": {"current_offset", "self_discharge"},
    "entropic_effect": {"entropic_voltage"},
    "hysteresis": {"hysteresis"},
    "hysteresis_composite": {"hysteresis"},
    "nonlinear_kinetics": {"charge_transfer"},
    "null": {"nothing_missing"},
    "sei_growth": {"resistance_growth", "capacity", "lithium_loss"},  # a film grows of lithium
    "self_discharge": {"current_offset", "self_discharge"},
    "slow_diffusion": {"relaxation"},
    "soc_dependent_resistance": {"soc_dependence"},
    "temperature_kinetics": {"temperature_dependence"},
    "temperature_sensor": {"temperature_sensor"},
    "thermal_contact": {"heat_transfer"},
}
ALSO_RIGHT_AMBIGUOUS = {"capacity_fade": {"capacity"}, "hysteresis_composite": {"hysteresis", "relaxation"}}
TOLD_TOGETHER = {"current_offset", "self_discharge"}
SURE = 0.9


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for folder in sorted(path for path in arguments.folder.iterdir() if (path / "meta.json").exists()):
            rows.append(judge(folder, arguments.models, arguments.structure))
    right = sum(row["right"] for row in rows)
    result = {
        "right": right,
        "pairs": len(rows),
        "wrong_and_sure": [row["case"] for row in rows if not row["right"] and row["confidence"] > SURE],
        "rows": rows,
    }
    if arguments.json:
        print(json.dumps(result))
    else:
        show(result)
    return 0


def judge(folder: Path, models: Path | None, structure: str) -> dict[str, Any]:
    """Diagnose one pair."""
    meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))
    runs = {path.name.split(".")[0]: read_run_file(path, None).series for path in sorted(folder.glob("*.csv*"))}
    train = [run for name, run in runs.items() if name.startswith("base_ident")]
    hidden = [run for name, run in runs.items() if name.startswith("hidden")]
    network = _network(folder.name, meta["capacity_Ah"], train, models, structure)
    began = time.perf_counter()
    answer = diagnose(
        network,
        hidden,
        [start_soc(run) for run in hidden],
        train=train,
        train_soc=[start_soc(run) for run in train],
        mode="change",
    )
    names = [each.effect for each in answer.findings]
    first = answer.findings[0] if answer.findings else None
    return {
        "case": folder.name,
        "truth": meta["true_size"],
        "verdict": answer.verdict,
        "findings": names,
        "confidence": first.confidence if first else 0.0,
        "confounded_with": list(first.confounded_with) if first else [],
        "parameters": first.to_json()["parameters"] if first else {},
        "shows": shown(runs),
        "power": [each._asdict() for each in answer.power if each.effect in RIGHT[folder.name]],
        "error_before_mV": first.error_before_mV if first else answer.unexplained_mV,
        "error_after_mV": first.error_after_mV if first else answer.unexplained_mV,
        "right": is_right(folder.name, answer.verdict, names, first.confounded_with if first else ()),
        "samples": sum(len(run) for run in hidden),
        "seconds": time.perf_counter() - began,
    }


def shown(runs: dict[str, TimeSeries]) -> dict[str, float] | None:
    """RMS by which the logs differ, in mV and K, noise and all; None where they are of different length."""
    pairs = [(run, runs[name.replace("hidden", "base")]) for name, run in runs.items() if name.startswith("hidden")]
    if any(len(one) != len(other) for one, other in pairs):
        return None
    apart_V = np.concatenate([one.voltage_V - other.voltage_V for one, other in pairs])
    apart_K = np.concatenate([one.temperature_degC - other.temperature_degC for one, other in pairs])
    return {"mV": 1e3 * float(np.sqrt(np.mean(apart_V**2))), "K": float(np.sqrt(np.mean(apart_K**2)))}


def is_right(case: str, verdict: str, names: list[str], confounded: tuple[str, ...]) -> bool:
    """Whether an answer counts as right."""
    wanted = RIGHT[case]
    if verdict in wanted:
        return True
    if not names:
        return False
    if wanted == TOLD_TOGETHER:
        return names[0] in wanted and bool((wanted - {names[0]}) & set(confounded))
    also = ALSO_RIGHT_AMBIGUOUS.get(case, set())
    together = bool(also) and verdict == "ambiguous" and also <= set(names[: max(2, len(also))])
    return names[0] in wanted or together


def _network(
    case: str, capacity_Ah: float, train: list[TimeSeries], models: Path | None, structure: str
) -> LocalModelNetwork:
    kept = None if models is None else models / f"{case}_{structure}.json"
    if kept is not None and kept.exists():
        return LocalModelNetwork.from_json(json.loads(kept.read_text(encoding="utf-8")))
    network = fit_network(train, capacity_Ah=capacity_Ah, structure=structure).network
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(network.to_json()), encoding="utf-8")
    return network


def show(result: dict[str, Any]) -> None:
    """Print one line for each pair."""
    table = Table(title=f"{result['right']} of {result['pairs']} right")
    for heading in (
        "pair",
        "verdict",
        "named",
        "sure",
        "rivals",
        "parameter",
        "mV before",
        "after",
        "shows",
        "seen from",
        "",
        "s",
    ):
        table.add_column(heading)
    for row in result["rows"]:
        name, value = next(iter(row["parameters"].items()), ("", {"value": 0.0, "unit": ""}))
        table.add_row(
            row["case"],
            row["verdict"],
            row["findings"][0] if row["findings"] else "",
            f"{row['confidence']:.2f}",
            ", ".join(row["confounded_with"]),
            f"{name} {value['value']:.4g} {value['unit']}" if name else "",
            f"{row['error_before_mV']:.1f}",
            f"{row['error_after_mV']:.1f}",
            "" if row["shows"] is None else f"{row['shows']['mV']:.1f} mV, {row['shows']['K']:.1f} K",
            ", ".join(_seen_from(each) for each in row["power"]),
            "right" if row["right"] else "WRONG",
            f"{row['seconds']:.1f}",
        )
    Console(width=180).print(table)
    print(f"wrong with confidence above {SURE}: {', '.join(result['wrong_and_sure']) or 'none'}")


def _seen_from(power: dict[str, Any]) -> str:
    """The smallest effect that such logs would have shown, in words."""
    parts = [
        f"{power[name]:.1f} {unit}" for name, unit in (("rms_mV", "mV"), ("rms_K", "K")) if power[name] is not None
    ]
    return ", ".join(parts) or "no size"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--models", type=Path, help="folder in which fitted networks are kept")
    parser.add_argument("--structure", choices=STRUCTURES, default="auto")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
