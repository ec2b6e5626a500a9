"""Rules that hold for every test."""

from __future__ import annotations

import gc
import os
import shutil
import signal

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Keep numerical libraries to one thread: small problems are slower, not faster, on several; let workers work."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    # Thousands of tests are collected to be kept: there is no garbage among them, and looking for it takes long.
    gc.disable()
    # A suite that was started in the background may have been told to ignore Ctrl-C, and would hand that on to the
    # programs that tests end by it.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Fits of a service under test give way to nobody: on a busy machine they would get hardly any time.
    os.environ.setdefault("BENCH_WORKER_NICE", "0")


def pytest_collection_finish() -> None:
    """From now on only what tests themselves make is looked through for garbage."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose system program is missing; in CI that is a failure, because CI installs it."""
    for marker in item.iter_markers("needs_program"):
        for program in marker.args:
            if shutil.which(program) is None:
                reason = f"needs the system program {program!r} (Debian: apt-get install {program})"
                if os.environ.get("CI"):
                    pytest.fail(reason)
                pytest.skip(reason)
