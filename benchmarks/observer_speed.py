"""Time of a live step and of a replayed step of the observer, and whether it needs more memory as it goes on.

``python benchmarks/observer_speed.py [MODEL.json] [--steps 10000000] [--json]``

Without a model one of a simulated NMC cell is identified (structure full, one run). The live step is what the bench
does each sample: observer and watch. Times are CPU times, the best of several rounds.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
from observer_cells import DT_S, random_case, training_runs
from threadpoolctl import threadpool_limits

from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.health import Watcher
from models.pipeline.fit import fit_network
from simulators.catalogue import cell_type

_ROUNDS, _LIVE_STEPS = 15, 3000


def main() -> int:
    arguments = _arguments()
    with threadpool_limits(1, user_api="blas"):
        network = _network(arguments.model)
        run = random_case("nmc", 1).series
        result = {
            "n_local_models": network.n_models,
            **_times(FuzzyObserver(network), run),
            **_memory(FuzzyObserver(network), run, arguments.steps),
        }
    print(json.dumps(result) if arguments.json else "\n".join(f"{key}: {value}" for key, value in result.items()))
    return 0


def _network(file: Path | None) -> LocalModelNetwork:
    if file is not None:
        return LocalModelNetwork.from_json(json.loads(file.read_text()))
    capacity_Ah = cell_type("nmc").parameters.capacity_Ah
    return fit_network(training_runs("nmc")[:1], capacity_Ah=capacity_Ah, structure="full", dt_s=DT_S).network


def _times(observer: FuzzyObserver, run: TimeSeries) -> dict[str, float]:
    arrays = (run.current_A, run.voltage_V, run.temperature_degC)
    known, unknown = observer.initial(0.5, 0.01), observer.initial(0.5)
    observer.replay(known, *(values[:2] for values in arrays))

    def replayed_us(state: Any) -> float:
        began = time.process_time()
        observer.replay(state, *arrays)
        return 1e6 * (time.process_time() - began) / len(run)

    samples = list(zip(*(values[:_LIVE_STEPS].tolist() for values in arrays), strict=True))

    def live_us() -> float:
        state, watcher = known, Watcher()
        began = time.process_time()
        for sample in samples:
            state, out = observer.step(state, *sample)
            watcher.step(out, sample[1])
        return 1e6 * (time.process_time() - began) / len(samples)

    live_us()
    return {
        "replay_us_per_step": min(replayed_us(known) for _ in range(_ROUNDS)),
        "replay_from_anywhere_us_per_step": min(replayed_us(unknown) for _ in range(_ROUNDS)),
        "live_us_per_step": min(live_us() for _ in range(_ROUNDS)),
    }


def _memory(observer: FuzzyObserver, run: TimeSeries, steps: int) -> dict[str, float]:
    """Growth of the process' largest memory over many replayed steps, after the first tenth."""
    arrays = (run.current_A, run.voltage_V, run.temperature_degC)
    state, done, after_tenth = observer.initial(0.5), 0, 0
    while done < steps:
        state, _ = observer.replay(state, *arrays)
        done += len(run)
        if not after_tenth and done >= steps // 10:
            after_tenth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - after_tenth
    return {
        "steps": float(done),
        "memory_growth_kB": float(grown),
        "state_bytes": float(np.asarray(state.memory).nbytes),
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, nargs="?", help="MODEL.json; by default one is identified")
    parser.add_argument("--steps", type=int, default=10_000_000)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
