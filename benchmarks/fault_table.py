"""Every kind of fault at random moments of a run, over TCP, RTU and CAN: how each ends, how soon, with which reason.

    python -m benchmarks.fault_table --moments 10 --seed 1 [--rows fault_table.rows] [--kinds nan.voltage,silence]

Each case is one run of the bench's own loop with the real driver against a simulated cycler; faults of messages by the
wall clock, those of values and of device and cell in simulated time, which is what their bounds are in. What is wrong
with a case: the output on afterwards or off later than the bound of its kind, more current than allowed, no reason or
one that is not of its kind, a wrong sample stored as good. With `--rows` a case that was played is not played again.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import multiprocessing
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bench_service.bench.plausibility.warmth import STUCK_REPEATS
from benchmarks.row_file import Row, add_row, read_rows
from tests.protocol.fault_runs import DT_S, LIMITS, TIMEOUT_S, WALL_DT_S, WATCHDOG_S, play

TRANSPORTS = ("modbus-tcp", "modbus-rtu", "can-udp")
TICKS = 60  # 3 s of pulses, a new set-point every quarter second
MOMENTS_S = (0.3, 2.3)
# Until a bench has rest after the last good message: what a sample may be old, then the device's own watchdog.
LINK_BOUND_S = 2 * WALL_DT_S + TIMEOUT_S + 0.1 + WATCHDOG_S + 0.3
NEXT_SAMPLE_S = 0.3  # a jump is judged one sample late
NEXT_STEP_S = 1.0  # two set-points
HEAT_S = 20.0
PATIENT_S = 10.0
# What is told of a link that fails: the request, a device that has gone off by itself meanwhile, values that got old.
LINK_CODES = ("cycler", "connect", "stale_readings", "reading_too_old", "device_alarm", "output_off")
VOLTAGE_CODES = ("voltage_limit", "voltage_jump", "voltage_stuck", "resistance_low", "reversed_current")
CURRENT_CODES = ("current_limit", "current_mismatch", "voltage_jump", "reversed_current")
TEMPERATURE_CODES = ("temperature_limit", "temperature_jump", "temperature_rate", "temperature_stuck")


@dataclass(frozen=True)
class Kind:
    """A kind of fault as it is played.

    Attributes
    ----------
    script : str
        Of `simulators.fault_script`, without its moment.
    bound_s : float
        From its beginning to the output off.
    lasting : str
        How long it lasts, behind the moment.
    harmless : bool
        Whether the run may go on.
    lock_step : bool
        Played in simulated time, which the bound is in then.
    ticks : int
        Length of the run.
    moments_s : tuple of float
        It begins between these, in the time of the simulated device, which begins with the connection.
    codes : tuple of str
        What may end the run: each of them names this kind, or what it does to the bench.
    """

    script: str
    bound_s: float
    lasting: str = ""
    harmless: bool = False
    lock_step: bool = False
    ticks: int = TICKS
    moments_s: tuple[float, float] = MOMENTS_S
    codes: tuple[str, ...] = LINK_CODES

    @property
    def name(self) -> str:
        """Key of its rows."""
        return self.script + (" for good" if self.lasting.startswith("x") else "")


def kinds() -> Iterator[Kind]:
    """All kinds that a simulated bench can show."""
    late = f"={2.5 * TIMEOUT_S:g}"
    for script in ("silence", "lost_reply", "drop", "wrong_id", "corrupt", "exception=4", "bus_off", "echo"):
        yield Kind(script, LINK_BOUND_S, harmless=True)
        yield Kind(script, LINK_BOUND_S, lasting="x100000")
    yield Kind("delay=0.02", LINK_BOUND_S, harmless=True)
    yield Kind(f"late{late}", LINK_BOUND_S, harmless=True)
    yield Kind(f"late{late}", LINK_BOUND_S, lasting="x100000")
    yield Kind(f"slow{late}", LINK_BOUND_S)
    for what, size, codes in (
        ("voltage", 2, VOLTAGE_CODES),
        ("current", 30, CURRENT_CODES),
        ("temperature", 30, TEMPERATURE_CODES),
    ):
        yield _inside(f"nan.{what}", NEXT_SAMPLE_S, codes)
        yield _inside(f"sentinel.{what}", NEXT_SAMPLE_S, codes)
        yield _inside(f"jump.{what}={size}", NEXT_SAMPLE_S, codes)
        yield _inside(f"jump.{what}=-{size}", NEXT_SAMPLE_S, codes)
        # A current of nothing cannot be reversed: it takes another set-point.
        yield _inside(f"reversed.{what}", 3 * NEXT_STEP_S if what == "current" else NEXT_STEP_S, codes)
    # A fading current may hold a voltage to the last bit: only steps away from rest tell.
    yield replace(_inside("stuck.voltage", 5 * NEXT_STEP_S, VOLTAGE_CODES), ticks=120)
    yield _inside("stuck.current", 3 * NEXT_STEP_S, CURRENT_CODES)  # when another set-point is drawn
    # A noisy sensor that has been seen for twenty samples and repeats itself forty times; one that stands still from
    # the start shows by the heat of a full load alone, in minutes or not at all.
    stuck = _inside("stuck.temperature", STUCK_REPEATS * DT_S + NEXT_SAMPLE_S, TEMPERATURE_CODES)
    yield replace(stuck, ticks=120, moments_s=(2.2, 6.2))
    yield _inside("frozen", NEXT_STEP_S, ("stale_readings", "current_mismatch"))
    yield _inside("restart", NEXT_SAMPLE_S, LINK_CODES)
    yield _inside("watchdog", NEXT_SAMPLE_S, LINK_CODES)
    yield _inside("refused", NEXT_STEP_S, LINK_CODES)
    yield _inside("over_temperature=5", 3.0, TEMPERATURE_CODES)
    # By its jump at once or, where it comes with a step of the current and may be a resistance, by its heat.
    short = _inside("short=0.1", HEAT_S, ("voltage_jump", "voltage_limit", "reversed_current", "temperature_rate"))
    yield replace(short, ticks=300)


def _inside(script: str, bound_s: float, codes: tuple[str, ...]) -> Kind:
    """A fault of a value, of the device or of the cell."""
    return Kind(script, bound_s, lock_step=True, codes=codes)


def case(kind: Kind, transport: str, number: int, seed: int) -> Row:
    """Play one case; its row."""
    logging.disable(logging.CRITICAL)
    draw = random.Random(f"{kind.name} {transport} {number} {seed}")
    at_s = draw.uniform(*kind.moments_s)
    script = f"{kind.script}@t:{at_s:.3f}{kind.lasting}"
    run_seed = draw.randrange(2**31)
    limits = replace(LIMITS, duration_s=kind.ticks * DT_S + 10.0)
    outcome = asyncio.run(
        play(
            script,
            transport,
            lock_step=kind.lock_step,
            seed=run_seed,
            timeout_s=PATIENT_S if kind.lock_step else TIMEOUT_S,
            ticks=kind.ticks,
            limits=limits,
        )
    )
    wrong = list(outcome.complaints)
    if not outcome.begun:
        wrong.append("it has not begun")
    elif outcome.end.state == "completed" and not kind.harmless:
        wrong.append("the run went on to its end")
    elif outcome.end.state == "fault" and (outcome.off_after_s or 0.0) > kind.bound_s:  # None: it was not on yet
        wrong.append(f"output off after {outcome.off_after_s} s, bound {kind.bound_s:.2f} s")
    if outcome.end.state == "fault" and outcome.end.code not in kind.codes:
        wrong.append(f"told as {outcome.end.code}: {outcome.end.reason}")
    return {
        "kind": kind.name,
        "transport": transport,
        "number": number,
        "seed": seed,
        "at_s": round(at_s, 3),
        "end": outcome.end.code if outcome.end.state == "fault" else outcome.end.state,
        "off_after_s": None if outcome.off_after_s is None else round(outcome.off_after_s, 3),
        "wrong": wrong[:3],
    }


def main() -> int:
    """Play what is missing, print the table; the exit code says whether nothing is wrong."""
    options = _arguments()
    chosen = [kind for kind in kinds() if not options.kinds or kind.name in options.kinds]
    rows = [row for row in read_rows(options.rows) if row["seed"] == options.seed]
    known = {(row["kind"], row["transport"], row["number"]) for row in rows}
    missing = [
        (kind, transport, number)
        for kind in chosen
        for transport in TRANSPORTS
        for number in range(options.moments)
        if (kind.name, transport, number) not in known
    ]
    began_s = time.monotonic()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, mp_context=context) as pool:
        played = [pool.submit(case, *which, options.seed) for which in missing]
        for count, future in enumerate(played, 1):
            add_row(options.rows, future.result())
            rows.append(future.result())
            if count % 50 == 0:
                print(f"{count} of {len(played)} cases, {time.monotonic() - began_s:.0f} s", file=sys.stderr)  # noqa: T201
    _show(chosen, rows, options.markdown)
    return int(any(row["wrong"] for row in rows))


def _show(chosen: list[Kind], rows: list[Row], markdown: bool) -> None:
    table = Table("kind", "cases", "bound, s", "latest off, s", "ends", "wrong")
    for kind in chosen:
        mine = [row for row in rows if row["kind"] == kind.name]
        latest_s = max((row["off_after_s"] or 0.0 for row in mine if row["end"] != "completed"), default=0.0)
        ends = ", ".join(f"{end} {count}" for end, count in Counter(row["end"] for row in mine).most_common())
        wrong = sum(bool(row["wrong"]) for row in mine)
        cells = (kind.name, str(len(mine)), f"{kind.bound_s:.2f}", f"{latest_s:.2f}", ends, str(wrong))
        table.add_row(*cells)
        if markdown:
            print(f"| {' | '.join(cells)} |")  # noqa: T201
    if not markdown:
        Console().print(table)
    for row in rows:
        if row["wrong"]:
            print(json.dumps(row))  # noqa: T201
    print(json.dumps({"cases": len(rows), "wrong": sum(bool(row["wrong"]) for row in rows)}))  # noqa: T201


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=10, help="random moments of each kind over each transport")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--kinds", type=lambda text: text.split(","), help="some of them")
    parser.add_argument("--workers", type=int, default=3, help="cases side by side")
    parser.add_argument("--markdown", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
