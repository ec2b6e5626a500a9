"""Randomised fault sequences in the middle of a run, over every transport: how many end unsafely (bar: none of 500).

    python -m benchmarks.fault_sequences --cases 500 --seed 1

Each case is one run of the bench's own loop with the real driver against a simulated cycler that fails by a script of
one to three random faults. Unsafe: the output on after the device's watchdog time, more current than the limit, a
defect in place of a reason, or a wrong sample stored as good. Cases that hypothesis draws, so a failure is shrunk.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import time
from collections import Counter

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.protocol.fault_runs import Outcome, play_case, random_case


def main() -> int:
    """Play the cases and print one JSON object; the exit code says whether all ended safely."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)
    started_s, played = time.monotonic(), list[Outcome]()

    @seed(options.seed)
    @settings(
        max_examples=options.cases,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(case=st.integers(0, 2**32 - 1))
    def play(case: int) -> None:
        outcome = asyncio.run(play_case(case))
        played.append(outcome)
        if outcome.complaints:
            print(json.dumps({"case": case, "what": random_case(case), "complaints": outcome.complaints[:3]}))  # noqa: T201

    play()
    unsafe = sum(bool(outcome.complaints) for outcome in played)
    answer = {
        "cases": len(played),
        "unsafe": unsafe,
        "faults_begun": sum(len(outcome.begun) for outcome in played),
        "kinds": len({kind for outcome in played for kind in outcome.begun}),
        "ends": dict(Counter(outcome.end.code for outcome in played).most_common()),
        "transports": dict(Counter(outcome.transport for outcome in played)),
        "seconds": round(time.monotonic() - started_s, 1),
    }
    print(json.dumps(answer))  # noqa: T201
    return 1 if unsafe else 0


if __name__ == "__main__":
    raise SystemExit(main())
