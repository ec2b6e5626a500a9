"""Kills everything at random while campaigns of five runs are played: they complete by themselves, nothing is lost.

    python -m benchmarks.campaign_kills --campaigns 1 --kills 10 --seed 1

Kills (SIGKILL) the service, the control process, the recorder or a worker; a service that was killed is started again
on the same data. Prints one line a kill, then for each campaign how it ended and what became of every run.
"""

import argparse
import os
import random
import signal
import tempfile
import time
from pathlib import Path
from typing import Any

from bench_service.client import ClientError
from benchmarks.bench_rig import ServiceProcess, children, command_of

CAMPAIGN = {"bench": "sim", "duration_s": 2000.0, "dt_s": 0.5, "soc": [0.45, 0.55], "structure": "minimal"}
DECLARED = CAMPAIGN | {"rounds": 4, "on_interruption": "resume", "retries": 3}
KINDS = {"control": "bench_service.bench ", "recorder": "bench_service.recorder", "worker": "spawn_main"}
PAUSE_S = (3.0, 12.0)
PATIENCE_S = 1800.0


class Service(ServiceProcess):
    """A service that is started again where it was killed."""

    def kill_one(self, kind: str) -> bool:
        """Kill the service or a child of it; return whether there was one."""
        if kind == "service":
            self.kill()
            self.start()
            return True
        for pid in children(self.process.pid):
            if KINDS[kind] in command_of(pid):
                os.kill(pid, signal.SIGKILL)
                return True
        return False


def play(service: Service, kills: int, rng: random.Random) -> dict[str, Any]:
    """Play one campaign while things are killed; give its record at the end."""
    campaign = service.client.start_campaign(DECLARED | {"name": f"kills {rng.random():.6f}"})
    end_s, next_s = time.monotonic() + PATIENCE_S, time.monotonic() + rng.uniform(*PAUSE_S)
    while time.monotonic() < end_s:
        try:
            campaign = service.client.campaign(campaign["id"])
        except ClientError:
            time.sleep(0.5)
            continue
        if campaign["state"] not in ("running", "queued", "interrupted"):
            break
        if kills and time.monotonic() > next_s:
            kind = rng.choice(["service", *KINDS])
            if service.kill_one(kind):
                kills -= 1
                print(f"  killed {kind} in stage {campaign['stage']}", flush=True)
            next_s = time.monotonic() + rng.uniform(*PAUSE_S)
        time.sleep(0.2)
    return campaign


def main() -> None:
    """Run the campaigns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=1)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="campaign-kills-") as directory:
        with Service(Path(directory), "[bench.sim]\nsimulate = { seed = 3 }\n") as service:
            for number in range(options.campaigns):
                campaign = play(service, options.kills, rng)
                runs = service.client.runs(campaign_id=campaign["id"], limit=1000)
                damaged = [run["id"] for run in runs if run["damage"]]
                states = sorted(run["state"] for run in runs)
                print(f"campaign {number}: {campaign['state']} ({campaign['message']}); runs {states}; {damaged=}")


if __name__ == "__main__":
    main()
