"""Requests generated from the OpenAPI document, single and in sequences, at a service that holds one of everything.

    python -m benchmarks.openapi_cases --schemathesis PATH/bin/schemathesis --cases 20 [--seed 1] [--log FILE]

schemathesis (MIT) is installed in an environment of its own: `python -m venv PATH; PATH/bin/pip install schemathesis`.
Four fifths of the ids in addresses and bodies are real: a run, its campaign, model, comparison, diagnosis, trend, cell,
protocol, import. Wrong: an answer 5xx; afterwards a service that is not well, a bench that cannot be made idle, a run
or campaign that does not end when it is told to, a store that is not whole.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import httpx

from benchmarks.bench_rig import ServiceProcess

BENCH = "[bench.sim]\nsimulate = { seed = 3 }\n"
CAMPAIGN = {"bench": "sim", "duration_s": 2000.0, "dt_s": 1.0, "soc": [0.45, 0.55], "structure": "minimal"}
API = "/api/v1"
PHASES = "examples,coverage,fuzzing,stateful"
PATIENCE_S = 120.0
RUNNING = ("queued", "claimed", "running", "paused", "resumed")


def main() -> int:
    """Fill a service, send the requests, look at what is left; the exit code says whether nothing was wrong."""
    options = _arguments()
    with tempfile.TemporaryDirectory(prefix="openapi-") as folder:
        with ServiceProcess(Path(folder), BENCH) as service:
            ids = _fill(service)
            sent = _send(service, ids, options)
            left = _left(service)
        command = [sys.executable, "-m", "bench_service.cli", "verify", "--config", str(service.config)]
        verified = subprocess.run(command, capture_output=True, text=True)
    if verified.returncode:
        left.append(verified.stdout)
    print(json.dumps(sent | {"left": left}))  # noqa: T201
    return int(bool(left or sent["failures"] or not sent["generated"]))


def _fill(service: ServiceProcess) -> dict[str, list[str]]:
    """Store one of everything; ids by the names of the parameters."""
    client = service.client
    service.until(lambda: service.idle("sim"), "idle")
    cell = client.add_cell(id="C1", label="first", owner="laboratory")
    campaign = client.wait_campaign(client.start_campaign(CAMPAIGN | {"name": "filling"})["id"])
    runs = [run["id"] for run in client.runs()]
    client.describe_run(runs[0], cell_id=cell["id"])
    model = client.models()[0]["id"]
    diagnosis = client.diagnose(model, runs[:1])
    protocol = client.add_standard_test("capacity", bench="sim")
    opened = httpx.post(f"{service.address}{API}/imports", json={"name": "log.csv"}, timeout=PATIENCE_S).json()
    design = httpx.post(
        f"{service.address}{API}/trends", json={"model_id": model, "run_ids": runs[:1]}, timeout=PATIENCE_S
    ).json()
    return {
        "name": ["sim"],
        "cell_id": [cell["id"]],
        "campaign_id": [campaign["id"]],
        "run_id": runs,
        "model_id": [model],
        "profile_id": [profile["id"] for profile in client.profiles()],
        "comparison_id": [comparison["id"] for comparison in client.comparisons()],
        "diagnosis_id": [diagnosis["id"]],
        "protocol_id": [protocol["id"]],
        "import_id": [opened["id"]],
        "job_id": [design["id"]],
    }


def _send(service: ServiceProcess, ids: dict[str, list[str]], options: argparse.Namespace) -> dict[str, Any]:
    command = [str(options.schemathesis), "run", f"{service.address}{API}/openapi.json", "--no-color"]
    command += ["--checks", "not_a_server_error", "--phases", options.phases, "-n", str(options.cases)]
    command += ["--seed", str(options.seed), "--request-timeout", str(PATIENCE_S), "--continue-on-failure"]
    environment = os.environ | {
        "BENCH_IDS": json.dumps(ids),
        "BENCH_SEED": str(options.seed),
        "SCHEMATHESIS_HOOKS": "benchmarks.openapi_hooks",
        "PYTHONPATH": str(Path(__file__).parents[1]),
        "PYTHONWARNINGS": "ignore",
    }
    told = subprocess.run(command, env=environment, capture_output=True, text=True)
    if options.log is not None:
        options.log.write_text(told.stdout + told.stderr, encoding="utf-8")
    generated = re.search(r"(\d+) generated", told.stdout)
    failures = re.findall(r"curl -X .*", told.stdout)
    return {"generated": int(generated[1]) if generated else 0, "failures": failures, "status": told.returncode}


def _left(service: ServiceProcess) -> list[str]:
    """What is not as it should be after all those requests."""
    client, left = service.client, list[str]()
    if (health := client.health())["recorder"] != "running" or health["storage"]["state"] != "ok":
        left.append(f"health {health}")
    for campaign in client.campaigns():
        if campaign["state"] in RUNNING:
            client.stop_campaign(campaign["id"])
    client.stop_bench("sim")
    for what, condition in (
        ("campaigns that end", lambda: all(each["state"] not in RUNNING for each in client.campaigns())),
        ("runs that end", lambda: all(each["state"] not in RUNNING for each in client.runs(limit=1000))),
        ("bench idle", lambda: service.idle("sim")),
    ):
        try:
            service.until(condition, what, PATIENCE_S)
        except RuntimeError as error:
            left.append(str(error))
    return left


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schemathesis", type=Path, required=True, metavar="PROGRAM")
    parser.add_argument("--cases", type=int, default=20, help="generated for each operation, and sequences of them")
    parser.add_argument("--phases", default=PHASES)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, help="keeps what schemathesis prints")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
