"""The recorder process: ``python -m bench_service.recorder --fd N --data DIR``; started by the API process."""

import argparse
import logging
import os
import signal
import socket
import sys
from pathlib import Path

from bench_service.errors import StoreError
from bench_service.framing import send_frame
from bench_service.recorder.service import EXIT_DONE, Recorder
from bench_service.store.sample_writer import SampleWriter

EXIT_NOT_OPENED = 2


def main() -> int:
    """Run the recorder; return its exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.basicConfig(format="recorder: %(levelname)s %(message)s")
    arguments = _arguments()
    lifeline = socket.socket(fileno=arguments.fd)
    try:
        writer = SampleWriter.open(arguments.data, arguments.lock_timeout_s)
    except StoreError as error:
        send_frame(lifeline, {"op": "error", "reason": error.message})
        return EXIT_NOT_OPENED
    code = Recorder(lifeline, writer, arguments.commit_period_s).run()
    if code != EXIT_DONE:
        # No clean-up: closing the database would write to a disk that has just failed.
        sys.stderr.flush()
        os._exit(code)
    return code


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench_service.recorder", description="Writes samples; see the API.")
    parser.add_argument("--fd", type=int, required=True, help="inherited end of the lifeline's socket pair")
    parser.add_argument("--data", type=Path, required=True, help="data directory")
    parser.add_argument("--commit-period-s", type=float, default=1.0, help="wall time between commits")
    parser.add_argument(
        "--lock-timeout-s", type=float, default=0.0, help="how long to wait for an earlier recorder to finish"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
