"""Every standard test on simulated cells and a module, over real protocols, and whether it did what it says.

``python benchmarks/standard_tests.py [--cells nmc lfp module] [--tests NAME ...] [--dt 10] [--json]``

Each test is made short by its own parameters and played by ``bench-service run``: all of them over Modbus TCP in
lock-step, three (`--wall`) also over a paced serial line and over CAN by the wall clock. Then the stored samples are
judged with nothing but numpy: each step ended with the first sample that met its end; a held voltage overshot and
settled so far; charge and energy of each cycle equal the samples' own integral. Ends with 1 where one did not.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bench_service.bench.limits import Limits
from bench_service.campaign.ordering import program_for
from bench_service.campaign.run_counters import cycles_of, steps_of
from bench_service.config import load_config
from bench_service.protocol.program import Play
from bench_service.store.metadata import MetadataStore
from bench_service.store.samples import SampleReader

# Parameters that leave a test what it is, and make it last hours of simulated time instead of weeks.
SHORT: dict[str, tuple[str, ...]] = {
    "ageing": ("blocks=1", "cycles=1"),
    "capacity": ("rounds=1",),
    "cc_cv_cycling": ("cycles=2",),
    "designed_sequence": ("lower_soc=0.3", "upper_soc=0.7", "duration_s=14400"),
    "drive_cycle": ("repeats=4",),
    "formation": ("first_C=0.2", "then_C=0.4", "first_cycles=1", "then_cycles=1", "soak_s=600"),
    "gitt": ("pulse_C=0.5", "pulses=4", "relax_s=900"),
    "hppc": ("levels=3", "relax_s=600"),
    "pseudo_ocv": ("slow_C=0.2",),
    "pulse_resistance": (),
    "rate_test": ("rates_C=[0.5, 1.0]",),
    "self_discharge": ("long_rest_s=7200",),
}
# Their pulses last ten seconds.
FINE, FINEST_S = ("hppc", "pulse_resistance"), 1.0
WALL = ("pulse_resistance", "manual_charge", "short_hold")
# Three that end by time, voltage and current within a minute of the wall clock.
OWN: dict[str, list[dict[str, Any]]] = {
    "manual_charge": [
        {"step": "constant_current", "rate_C": 0.5, "until": {"time_s": 20}},
        {"step": "rest", "until": {"time_s": 5}},
    ],
    "short_hold": [
        {"step": "cc_cv", "rate_C": 1.0, "voltage_V": 3.78, "until": {"time_s": 30}},
        {"step": "constant_current", "rate_C": -1.0, "until": {"voltage_V": 3.68, "time_s": 20}},
    ],
}
MAPS = {"modbus-tcp": "generic", "modbus-rtu": "generic", "can": "generic_can"}
CELLS = {"nmc": "cell = 'nmc'", "lfp": "cell = 'lfp'", "module": "cell = 'nmc'\nmodule = '4x2'"}
_MOST_OVERSHOOT_V, _MOST_SETTLED_V = 0.010, 0.002
_SETTLED_AFTER = 5  # samples


@dataclass(frozen=True)
class Judged:
    """One test as it was played.

    Attributes
    ----------
    late_ends : steps that did not end with the first sample that met their end
    overshoot_V, settled_V : of held voltages; None where nothing was held
    counters : largest difference between the cycles' counters and the samples' integral, as a share
    """

    cell: str
    protocol: str
    test: str
    state: str
    samples: int
    steps: int
    missed: int
    late_ends: int
    overshoot_V: float | None
    settled_V: float | None
    counters: float
    seconds: float

    @property
    def good(self) -> bool:
        """Whether it did what it says."""
        held = (self.overshoot_V or 0.0) <= _MOST_OVERSHOOT_V and (self.settled_V or 0.0) <= _MOST_SETTLED_V
        return self.state == "completed" and not self.late_ends and not self.missed and held and self.counters < 1e-9


def main() -> int:
    """Play and judge."""
    arguments = _arguments()
    console = Console(stderr=True)
    found = []
    orders = [
        (cell, "modbus-tcp", test, min(arguments.dt, FINEST_S if test in FINE else arguments.dt), True)
        for cell in arguments.cells
        for test in arguments.tests
    ]
    if arguments.wall:
        orders += [("nmc", protocol, test, 0.2, False) for protocol in ("modbus-rtu", "can") for test in WALL]
    for order in orders:
        with tempfile.TemporaryDirectory() as folder:
            found.append(play(Path(folder), *order))
        console.print(found[-1], highlight=False)
    if arguments.json:
        print(json.dumps({"tests": [asdict(each) | {"good": each.good} for each in found]}))
    else:
        _show(found)
    return int(not all(each.good for each in found))


def play(folder: Path, cell: str, protocol: str, test: str, dt_s: float, lock_step: bool) -> Judged:
    """Play one test in a folder of its own and judge what was stored."""
    lock = "lock_step = true" if lock_step else "lock_step = false"
    (folder / "bench.toml").write_text(
        f"[bench.sim]\nmap = '{MAPS[protocol]}'\n[bench.sim.simulate]\nprotocol = '{protocol}'\n{CELLS[cell]}\n{lock}\n"
        "baud = 115200\nseed = 3\n"
    )
    config = load_config(folder / "bench.toml").bench["sim"]
    document = _document(folder, test, dt_s)
    (folder / "protocol.json").write_text(json.dumps(document))
    began = time.monotonic()
    answer = _command(folder, "run", "protocol.json", "--out", "run.csv", "--dt", str(dt_s), "--initial-soc", "0.5")
    seconds = time.monotonic() - began
    samples = np.genfromtxt(folder / "run.csv", delimiter=",", names=True)
    with SampleReader(folder / "bench-data") as reader:
        store = MetadataStore.look(folder / "bench-data")
        steps, cycles = (each(store, reader, str(answer["run"])) for each in (steps_of, cycles_of))
        store.close()
    limits = Limits.from_json(config.limits.model_dump())
    _, _, program = program_for(document, limits, config.capacity_Ah)
    plays = {each.number: each for each in program.instructions if isinstance(each, Play)}
    overshoot_V, settled_V = _held(samples, steps, plays)
    return Judged(
        cell,
        protocol,
        test,
        str(answer["state"]),
        len(samples),
        len(steps),
        int(answer["missed_ticks"]),
        sum(not _ended_in_time(samples, step, plays[step["step_index"]], dt_s) for step in steps),
        overshoot_V,
        settled_V,
        max((float(_difference(samples, cycle)) for cycle in cycles), default=0.0),
        seconds,
    )


def _document(folder: Path, test: str, dt_s: float) -> dict[str, Any]:
    if test in OWN:
        document: dict[str, Any] = {"schema": "bench-protocol-1", "name": test, "steps": OWN[test]}
    else:
        short = [part for value in SHORT[test] for part in ("--set", value)]
        _command(folder, "protocol", "convert", test, *short, "--out", "made.json")
        document = json.loads((folder / "made.json").read_text())
    return _each_tick(document, dt_s)


def _each_tick(node: Any, dt_s: float) -> Any:
    """Store every sample, also one that comes somewhat early: what is judged must be there."""
    if isinstance(node, list):
        return [_each_tick(each, dt_s) for each in node]
    if not isinstance(node, dict):
        return node
    every = {"record": {"time_s": 0.5 * dt_s}}
    return {key: _each_tick(each, dt_s) for key, each in node.items()} | (every if "record" in node else {})


def _command(folder: Path, *words: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "bench_service.cli", *words, "--config", "bench.toml", "--bench", "sim", "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: {done.stderr}")
    return json.loads(done.stdout)


def _ended_in_time(samples: np.ndarray, step: dict[str, Any], play: Play, dt_s: float) -> bool:
    """Whether the last sample of a step meets what ended it, and the one before does not yet."""
    here = samples[samples["step_count"] == step["step_count"]]
    by = {"voltage": "voltage_V", "current": "current_A", "time": "time_s"}.get(step["ended_by"])
    ends = [end for end in play.ends if end.quantity == by]
    if len(here) < 2 or not ends:
        return True
    if by == "time_s":
        return abs(step["duration_s"] - ends[0].value) <= dt_s + 1e-6
    values = here[by] if by == "voltage_V" else np.abs(here[by])
    # The first sample of a step was taken before its current flowed, and a current ends a hold only once it holds.
    met = [(values[-1] >= end.value, values[-2] >= end.value, end.above) for end in ends]
    return any(last == above and (before != above or by == "current_A") for last, before, above in met)


def _held(
    samples: np.ndarray, steps: list[dict[str, Any]], plays: dict[int, Play]
) -> tuple[float | None, float | None]:
    over, settled = [], []
    for step in steps:
        play = plays[step["step_index"]]
        here = samples[samples["step_count"] == step["step_count"]]
        if play.law not in ("cc_cv", "voltage") or len(here) < 2:
            continue
        sign = 1.0 if play.level >= 0.0 else -1.0
        beyond_V = sign * (here["voltage_V"] - play.voltage_V)
        over.append(float(beyond_V.max()))
        reached = np.flatnonzero(beyond_V >= -_MOST_SETTLED_V)
        rest = beyond_V[reached[0] + _SETTLED_AFTER :] if len(reached) else beyond_V[:0]
        if len(rest) > _SETTLED_AFTER:
            settled.append(float(np.sqrt(np.mean(rest**2))))
    return max(over, default=None), max(settled, default=None)


def _difference(samples: np.ndarray, cycle: dict[str, Any]) -> float:
    moved_Ah = np.append(0.0, np.diff(samples["time_s"])) * samples["current_A"] / 3600.0
    here = samples["cycle_count"] == cycle["cycle_count"]
    charge, energy = moved_Ah[here], moved_Ah[here] * samples["voltage_V"][here]
    own = {
        "charged_Ah": charge[charge > 0.0].sum(),
        "discharged_Ah": -charge[charge < 0.0].sum(),
        "charged_Wh": energy[energy > 0.0].sum(),
        "discharged_Wh": -energy[energy < 0.0].sum(),
    }
    return max(abs(cycle[name] - value) / max(abs(value), 1.0) for name, value in own.items())


def _show(found: list[Judged]) -> None:
    table = Table("cell", "protocol", "test", "state", "samples", "steps", "missed", "late ends", "overshoot / mV")
    for name in ("settled / mV", "counters", "s", ""):
        table.add_column(name)
    for each in found:
        held = ("-" if value is None else f"{1e3 * value:.2f}" for value in (each.overshoot_V, each.settled_V))
        head = (each.cell, each.protocol, each.test, each.state)
        counts = (str(count) for count in (each.samples, each.steps, each.missed, each.late_ends))
        table.add_row(*head, *counts, *held, f"{each.counters:.0e}", f"{each.seconds:.0f}", "" if each.good else "BAD")
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cells", nargs="*", choices=CELLS, default=list(CELLS))
    parser.add_argument("--tests", nargs="+", choices=SHORT, default=list(SHORT))
    parser.add_argument("--dt", type=float, default=10.0, help="sample period in lock-step, in s")
    parser.add_argument("--wall", action="store_true", help="also the short ones over RTU and CAN by the wall clock")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
