"""The control process as an operating system sees it: started with its two links, seen off at its end."""

import asyncio
import socket
import subprocess
import sys
import time

from bench_service.bench.settings import BenchSettings

_END_S = 5.0


def start_control(
    settings: BenchSettings, samples: socket.socket, stop: socket.socket | None = None
) -> tuple["subprocess.Popen[bytes]", socket.socket]:
    """Start the control process of a bench.

    Parameters
    ----------
    settings : BenchSettings
    samples : socket.socket
        Its link to the recorder; closed here.
    stop : socket.socket or None
        Listening socket of its stop port; stays open here.

    Returns
    -------
    The process, and this end of its command link.

    Raises
    ------
    OSError
        It cannot be started.
    """
    ours, theirs = socket.socketpair()
    command = [sys.executable, "-m", "bench_service.bench", "--fd", str(theirs.fileno())]
    command += ["--samples-fd", str(samples.fileno()), "--settings", settings.to_json()]
    inherited = [theirs.fileno(), samples.fileno()]
    if stop is not None:
        command += ["--stop-fd", str(stop.fileno())]
        inherited.append(stop.fileno())
    with samples, theirs:
        try:
            process = subprocess.Popen(
                command,
                pass_fds=inherited,
                stdin=subprocess.DEVNULL,
                process_group=0,  # Ctrl-C is for the service, also before the process can ignore it
            )
        except OSError:
            ours.close()
            raise
    return process, ours


async def end_of(process: "subprocess.Popen[bytes]") -> int:
    """Wait a moment for the end of a process whose link is closed; kill it if it does not come.

    It has that long to bring its cycler to rest; if it hangs, the device's watchdog has done so.
    """
    deadline_s = time.monotonic() + _END_S
    while process.poll() is None:
        if time.monotonic() > deadline_s:
            process.kill()
        await asyncio.sleep(0.02)
    return process.returncode
