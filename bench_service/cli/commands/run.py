"""`bench-service run`: play a profile on a bench and keep what was measured."""

from __future__ import annotations

import signal
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import fraction, positive
from bench_service.cli.command import Command
from bench_service.cli.output import Output, Report
from bench_service.cli.report_options import check_report, kind_of

if TYPE_CHECKING:
    from bench_service.cli.playable import Playable
    from bench_service.client import BenchClient

_LONGEST_DEFAULT_DT_S = 1.0
_DEFAULT_SOC = 0.5
_STOP_TIMEOUT_S = 60.0
_UNVERIFIED = ("missing", "failed", "void")


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "profile",
        type=Path,
        metavar="PROFILE.csv|PROTOCOL.json",
        help="columns time_s,current_A; or a protocol, also of aurora-unicycler; charge is positive",
    )
    parser.add_argument("--bench", required=True, metavar="NAME")
    parser.add_argument("--out", type=Path, required=True, metavar="RUN.csv", help="RUN.bdf.csv takes BDF labels")
    parser.add_argument("--report", type=Path, metavar="FILE.html|.pdf", help="also write a report of the run")
    parser.add_argument("--config", type=Path, metavar="bench.toml")
    parser.add_argument(
        "--dt",
        type=positive,
        metavar="S",
        help="sampling time; default: 1 s, or the shortest step or record time",
    )
    parser.add_argument(
        "--initial-soc", type=fraction, metavar="S", help="0..1, for the limits on state of charge; default: 0.5"
    )
    parser.add_argument(
        "--resume", metavar="RUN", help="go on with this run's protocol where it was cut off: step, cycle and counts"
    )
    parser.add_argument(
        "--on-interruption", choices=["stop", "resume"], help="whether a protocol that is cut off goes on by itself"
    )
    parser.add_argument(
        "--acknowledge", action="store_true", help="clear a fault that an earlier run has left; look at the bench first"
    )


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy, pydantic and httpx take 520 ms.
    from bench_service.cli.playable import read_playable
    from bench_service.cli.service import acknowledge, connected
    from bench_service.config import load_config
    from bench_service.exchange.atomic import check_writable, write_atomically

    profile = read_playable(options.profile)
    check_writable(options.out)
    check_report(options)
    config = load_config(options.config)
    if options.initial_soc is None:
        output.warn(f"no --initial-soc: limits on state of charge take {_DEFAULT_SOC:g} as the start")
    with _interruptible() as interrupts, connected(config, options.bench) as client:
        if options.acknowledge:
            acknowledge(client, options.bench)
        run = _play(client, profile, options, output, interrupts)
        if (hardware := run["commissioning"] or {}).get("state") in _UNVERIFIED:
            output.warn(f"the hardware of {options.bench} is not commissioned ({hardware['reason']}); the run says so")
        answer = {
            "run": run["id"],
            "file": None,
            "state": run["state"],
            "samples": run["n_samples"],
            "missed_ticks": run["missed_ticks"],
            "reason": run["reason"],
        }
        if run["n_samples"]:
            bdf = options.out.name.endswith(".bdf.csv")
            write_atomically(options.out, client.export(run["id"], "bdf" if bdf else "csv"))
            answer["file"] = str(options.out)
        if options.report is not None:
            write_atomically(options.report, client.run_report(run["id"], kind_of(options.report)))
            answer["report"] = str(options.report)
    output.result(answer, lambda console: console.print(_sentence(answer)))
    return 0 if run["state"] == "completed" else 1


def _play(
    client: BenchClient, profile: Playable, options: Namespace, output: Output, interrupts: _Interrupts
) -> dict[str, Any]:
    """Start the run and wait for its end; Ctrl-C stops it safely and waits for that."""
    # Lazy: httpx takes 200 ms.
    from bench_service.client import ENDED_RUN_STATES

    dt_s = options.dt or min(_LONGEST_DEFAULT_DT_S, profile.shortest_s)
    soc = _DEFAULT_SOC if options.initial_soc is None else options.initial_soc
    profile_id, further = profile.upload(client, options.bench)
    if options.resume is not None:
        further["continues"] = options.resume
    if options.on_interruption is not None:
        further["on_interruption"] = options.on_interruption
    further["name"] = profile.name
    # From here on somebody has to stop what has begun.
    with interrupts.kept():
        run = client.start_run(options.bench, profile_id, dt_s, soc, **further)
        try:
            with output.progress(f"Playing {profile.name} on {options.bench}") as report:

                def look(now: dict[str, Any], live: dict[str, Any] | None) -> None:
                    _tell(report, live)
                    if interrupts.asked and now["state"] not in ENDED_RUN_STATES:
                        raise KeyboardInterrupt

                return client.wait_run(run["id"], look)
        except KeyboardInterrupt:
            client.stop_run(run["id"])
            return client.wait_run(run["id"], timeout_s=_STOP_TIMEOUT_S)


def _tell(report: Report, live: dict[str, Any] | None) -> None:
    if live is None:
        return
    values = (("voltage_V", "V", 3), ("current_A", "A", 2), ("temperature_degC", "°C", 1))
    known = [f"{live[name]:.{digits}f} {unit}" for name, unit, digits in values if live[name] is not None]
    report(live["progress"] or 0.0, "  ".join(known))


def _sentence(answer: dict[str, Any]) -> str:
    reason = f" ({answer['reason']})" if answer["reason"] else ""
    where = f"; wrote {answer['file']}" if answer["file"] else ""
    return (
        f"run {answer['run']} {answer['state']}{reason}: {answer['samples'] or 0} samples, "
        f"{answer['missed_ticks'] or 0} missed ticks{where}"
    )


class _Interrupts:
    """Signals that end the command as Ctrl-C does: the run is stopped, the output switched off.

    A first one that comes while they are kept is looked at between two requests: an exception that is raised wherever
    the program happens to be can be lost there (in a destructor, in a callback), and the run would go on.

    Attributes
    ----------
    asked : whether one came while they were kept
    """

    def __init__(self) -> None:
        self.asked = self._keep = False

    def __call__(self, _number: int, _frame: object) -> None:
        if not self._keep or self.asked:
            raise KeyboardInterrupt
        self.asked = True

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep the first one; a second ends the command at once, as one does afterwards."""
        self._keep = True
        try:
            yield
        finally:
            self._keep = False


@contextmanager
def _interruptible() -> Iterator[_Interrupts]:
    interrupts = _Interrupts()
    before = {number: signal.signal(number, interrupts) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


COMMAND = Command("run", "play a current profile on a bench and keep the measurement", _arguments, _run)
