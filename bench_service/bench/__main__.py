"""The control process: ``python -m bench_service.bench --fd N --samples-fd M --settings JSON``."""

import argparse
import asyncio
import logging
import signal
import socket
import sys

from bench_service.bench.control import BenchControl
from bench_service.bench.settings import BenchSettings


def main() -> int:
    """Run the control process; return its exit code."""
    # Ctrl-C reaches the whole process group; what it means for a run is the API's decision.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    arguments = _arguments()
    settings = BenchSettings.from_json(arguments.settings)
    logging.basicConfig(format=f"control {settings.name}: %(levelname)s %(message)s")
    # pymodbus logs what the driver raises; one clear event is enough.
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    asyncio.run(_serve(settings, arguments.fd, arguments.samples_fd, arguments.stop_fd))
    return 0


async def _serve(settings: BenchSettings, command_fd: int, samples_fd: int, stop_fd: int | None) -> None:
    stop_sock = None if stop_fd is None else socket.socket(fileno=stop_fd)
    control = BenchControl(settings, socket.socket(fileno=command_fd), socket.socket(fileno=samples_fd), stop_sock)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(
            number, control.quit, "interrupted", f"the control process was told to end ({number.name})"
        )
    await control.serve()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench_service.bench", description="Controls one bench; see the API.")
    parser.add_argument("--fd", type=int, required=True, help="inherited end of the command link")
    parser.add_argument("--samples-fd", type=int, required=True, help="inherited end of the sample link")
    parser.add_argument("--stop-fd", type=int, help="inherited socket that listens for stop and acknowledge")
    parser.add_argument("--settings", required=True, help="the bench's settings as JSON")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
