"""The sealed game, over and over: what is hidden is named, added, and worth what the truth would have been.

    python -m benchmarks.sealed_game --games 30 --seed 7301 [--modes change] [--rows game.rows] [--keep FOLDER]

Each game is one `bench-service demo --hidden-effect random` in a process of its own, over the real protocol; modes and
chemistries take turns from seed to seed. Where the truth was not named, it is put into the same model by the same refit
afterwards, and judged on the same run. With `--rows` a game that has been played is not played again; `--keep` keeps
the data of each. Bars: every game completes with its seal open, 9 of 10 named, an effect that was named is added,
the held-out error at most 1.15 of that with the truth.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bench_service.campaign.plan import CHANGED, CHANGED_VALIDATE, TRAIN, VALIDATE
from bench_service.cli.service import connected_to_store
from bench_service.client import ClientError
from bench_service.config import ServiceConfig
from benchmarks.row_file import Row, add_row, read_rows

CELLS, MODES = ("nmc", "lfp", "nimh"), ("structure", "change")
RIGHT, WORTH = 0.9, 1.15
PATIENCE_S = 1800.0


def main() -> int:
    """Play, print a table or one JSON object; the exit code says whether the bars are held."""
    options = _arguments()
    rows = {(row["mode"], row["cell"], row["seed"]): row for row in read_rows(options.rows)}
    played = list[Row]()
    for number in range(options.games):
        key = turn(number, options.seed, options.modes)
        if key not in rows:
            rows[key] = play(*key, options.keep)
            add_row(options.rows, rows[key])
            print(json.dumps(rows[key]), file=sys.stderr, flush=True)
        played.append(rows[key])
    found = summary(played)
    if options.json:
        print(json.dumps(found))
    else:
        _show(played, found)
    return int(not found["held"])


def turn(number: int, seed: int, modes: list[str]) -> tuple[str, str, int]:
    """Mode, chemistry and seed of a game: each mode meets each chemistry."""
    return modes[number % len(modes)], CELLS[number // len(modes) % len(CELLS)], seed + number


def play(mode: str, cell: str, seed: int, keep: Path | None) -> Row:
    """Play one game, and look what the truth would have been worth."""
    with tempfile.TemporaryDirectory(prefix="sealed-game-") as own:
        data = Path(own) if keep is None else keep / f"{mode}-{cell}-{seed}"
        game = ("--hidden-effect", "random", "--mode", mode, "--cell", cell, "--seed", str(seed))
        command = [sys.executable, "-m", "bench_service.cli", "demo", "--exit", "--json", *game]
        row: Row = {"mode": mode, "cell": cell, "seed": seed}
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=PATIENCE_S,
                env=os.environ | {"BENCH_DATA_DIR": str(data)},
            )
        except subprocess.TimeoutExpired:
            return row | {"state": f"not within {PATIENCE_S:g} s"}
        if not done.stdout.strip():
            return row | {"state": f"status {done.returncode}: {done.stderr.strip()[-300:]}"}
        return row | _told(json.loads(done.stdout), data, mode)


def _told(answer: dict[str, Any], data: Path, mode: str) -> Row:
    """What came of a game; `truth_mV` is the held-out error with the truth in the model."""
    seal, chain = answer["seal"], answer["model_chain"]
    truth, named = answer["hidden_effect"], answer["diagnosed_effect"]
    row: Row = {
        "state": answer["state"],
        "opened": seal["sha256"] == hashlib.sha256(seal["contents"].encode()).hexdigest(),
        "truth": truth,
        "size": answer["hidden_size"]["value"],
        "verdict": answer["verdict"],
        "named": named,
        "before_mV": chain[0]["validation_rmse_mV"] if chain else None,
        "after_mV": chain[-1]["validation_rmse_mV"] if chain else None,
        "seconds": round(answer["seconds"], 1),
    }
    added = [version for version in chain if version["effect"] is not None]
    row |= {"parameters": {name: each["value"] for version in added for name, each in version["parameters"].items()}}
    with connected_to_store(ServiceConfig(data_dir=data, worker_nice=0)) as client:
        result = client.campaigns()[0]["result"] or {}
        findings = (result.get("diagnosis") or {}).get("findings") or [{}]
        row |= {"confidence": findings[0].get("confidence"), "rivals": findings[0].get("confounded_with")}
        if not chain or named == truth:
            return row | {"truth_mV": row["after_mV"]}
        learn, judge = (TRAIN, VALIDATE) if mode == "structure" else (CHANGED, CHANGED_VALIDATE)
        train, validate = ([run["run_id"] for run in result["runs"] if run["role"] == role] for role in (learn, judge))
        try:
            made = client.add_effect(chain[0]["model"], truth, train_run_ids=train, validate_run_ids=validate)
        except ClientError as error:
            return row | {"truth_mV": None, "refused": str(error)}
    return row | {"truth_mV": made["error_after_mV"]}


def summary(rows: list[Row]) -> dict[str, Any]:
    """Shares of the games by their bars."""
    ended = [row for row in rows if row["state"] == "completed" and row["opened"]]
    right = [row for row in ended if row["named"] == row["truth"]]
    named = [row for row in ended if row["named"] is not None]
    added = [row for row in named if row["parameters"]]
    worth = [row for row in ended if row["truth_mV"] is not None and row["after_mV"] <= WORTH * row["truth_mV"]]
    found = {"games": len(rows), "completed": len(ended), "right": len(right), "named": len(named), "added": len(added)}
    held = len(ended) == len(rows) and len(right) >= RIGHT * len(rows) and len(added) == len(named)
    return found | {"worth": len(worth), "held": held and len(worth) == len(rows)}


def _show(rows: list[Row], found: dict[str, Any]) -> None:
    heads = ("mode", "cell", "seed", "state", "truth", "named", "confidence", "before_mV", "after_mV", "truth_mV")
    table = Table(*heads)
    for row in rows:
        table.add_row(*(f"{row.get(head, '')}" for head in heads))
    console = Console()
    console.print(table)
    console.print(found)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--games", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1, help="of the first game; the next ones follow")
    parser.add_argument("--modes", type=lambda text: text.split(","), default=list(MODES), metavar="MODE,...")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="go on where an earlier call with it was stopped")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the data of each game here")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
