"""A ten-hour profile at 1 Hz in lock-step through the whole service: how long it takes, and whether two runs are equal.

    python -m benchmarks.ten_hours [--protocol modbus-tcp|modbus-rtu|can] [--hours 10]

Bar: 60 s over Modbus TCP on a quiet machine; two runs of one seed equal to the bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STEP_S = 60
MAPS = {"modbus-tcp": "generic", "modbus-rtu": "generic", "can": "generic_can"}


def _profile(hours: float) -> str:
    """Steps of a minute that keep the charge between a fifth and four fifths."""
    draw, soc, lines = random.Random(1), 0.5, ["time_s,current_A"]
    for index in range(round(hours * 3600 / STEP_S)):
        current_A = draw.choice([-1.0, -0.5, 0.0, 0.5, 1.0])
        current_A = -abs(current_A) if soc > 0.8 else abs(current_A) if soc < 0.2 else current_A
        lines.append(f"{index * STEP_S},{current_A}")
        soc += current_A * STEP_S / 3600.0 / 2.5
    return "\n".join([*lines, f"{round(hours * 3600)},0", ""])


def _run(folder: Path, protocol: str, hours: float) -> tuple[float, str, dict[str, object]]:
    folder.mkdir()
    (folder / "profile.csv").write_text(_profile(hours))
    config = f'[bench.sim]\nmap = "{MAPS[protocol]}"\n[bench.sim.simulate]\nprotocol = "{protocol}"\nbaud = 921600\n'
    (folder / "bench.toml").write_text(config)
    command = [
        "run",
        "profile.csv",
        "--bench",
        "sim",
        "--out",
        "run.csv",
        "--initial-soc",
        "0.5",
        "--dt",
        "1",
        "--json",
    ]
    started_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "bench_service.cli", *command, "--config", "bench.toml", "--dt", "1", "--json"],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    seconds = time.monotonic() - started_s
    digest = hashlib.sha256((folder / "run.csv").read_bytes()).hexdigest()
    return seconds, digest, json.loads(done.stdout)


def main() -> int:
    """Run twice and print one JSON object; the exit code says whether the runs are equal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--protocol", choices=tuple(MAPS), default="modbus-tcp")
    parser.add_argument("--hours", type=float, default=10.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runs = [_run(Path(folder) / name, options.protocol, options.hours) for name in ("first", "second")]
    equal = runs[0][1] == runs[1][1]
    answer = {
        "protocol": options.protocol,
        "seconds": [round(seconds, 1) for seconds, _, _ in runs],
        "samples": runs[0][2]["samples"],
        "state": runs[0][2]["state"],
        "equal_to_the_bit": equal,
        "load_average": round(os.getloadavg()[0], 1),
    }
    print(json.dumps(answer))  # noqa: T201
    return 0 if equal else 1


if __name__ == "__main__":
    raise SystemExit(main())
