"""How long a series of many cycles takes to follow, and where the time goes.

``python benchmarks/trend_speed.py --data FOLDER [--cell A] [--cycles 600] [--profile] [--json]``

FOLDER holds `samsung30q` and `nasa` as for `trend_measured.py`. The cell's later records are taken again and again, two
for each cycle, until there are as many cycles as are wanted, each time with other noise of 0.1 mV: a series takes no
record twice. Told is processor time of one core: of what is learned of the fresh cell, once, and of the series; then
the time by the wall of the same series in this process alone, and over as many processes as there are processors, as
`bench-service trend` and the service's jobs do it, with their start.
"""

import argparse
import cProfile
import json
import pstats
import sys
import time
from dataclasses import replace
from functools import partial
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits
from trend_measured import Aged, lives

from bench_service.jobs.beside import spread
from models.data.resampling import to_grid
from models.diagnosis.diagnosis import known_of
from models.diagnosis.reference.record import make_record
from models.diagnosis.trend.life import Places
from models.diagnosis.trend.trend import trend
from models.effects.input_correction import as_read
from models.pipeline.fit import fit_network

_FRESH, _NOISE_V = 4, 1e-4


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with samsung30q and nasa")
    parser.add_argument("--cell", default="A")
    parser.add_argument("--cycles", type=int, default=600)
    parser.add_argument("--profile", action="store_true", help="also print what takes longest")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args()
    records = lives(options.data)[options.cell]
    train, later = records[:_FRESH], records[_FRESH:]
    soc = [each.begins for each in train]
    capacity_Ah = float(np.mean([each.counted_Ah for each in train if each.counted_Ah]))
    profile = cProfile.Profile()
    with threadpool_limits(1):
        runs = [each.run for each in train]
        network = fit_network(runs, capacity_Ah=capacity_Ah, initial_soc=soc, structure="bounded").network
        began = time.process_time()
        grid = [to_grid(as_read(network.record, run), network.structure.dt_s) for run in runs]
        memory = known_of(network, make_record(network, runs, soc), grid, soc)
        learned_s = time.process_time() - began
        rng = np.random.default_rng(0)
        series = [_noisy(each, rng) for each in islice(cycle(later), 2 * options.cycles)]
        places = Places(np.repeat(np.arange(1.0, options.cycles + 1.0), 2).tolist(), "cycle")
        follow = partial(
            trend,
            network,
            [each.run for each in series],
            [each.begins for each in series],
            memory=memory,
            places=places,
        )
        began, wall = time.process_time(), time.perf_counter()
        if options.profile:
            profile.enable()
        follow()
        profile.disable()
        followed_s, alone_s = time.process_time() - began, time.perf_counter() - wall
        wall = time.perf_counter()
        follow(spread=spread)
        beside_s = time.perf_counter() - wall
    out = {"cycles": options.cycles, "runs": len(series), "learned_s": learned_s, "followed_s": followed_s}
    out |= {"alone_s": alone_s, "side_by_side_s": beside_s}
    print(json.dumps(out) if options.json else "\n".join(f"{name}: {each:.4g}" for name, each in out.items()))
    if options.profile:
        pstats.Stats(profile, stream=sys.stderr).sort_stats("tottime").print_stats(25)
    return 0


def _noisy(record: Aged, rng: np.random.Generator) -> Aged:
    noise_V = _NOISE_V * rng.standard_normal(len(record.run))
    return replace(record, run=replace(record.run, voltage_V=record.run.voltage_V + noise_V))


if __name__ == "__main__":
    sys.exit(main())
