"""Numerical libraries work in one thread, whichever way the program is started."""

import os
import subprocess
import sys

import pytest

SAYS = "import numpy, threadpoolctl; print({each['num_threads'] for each in threadpoolctl.threadpool_info()})"


@pytest.mark.parametrize(
    ("told", "threads"), [({}, "{1}"), ({"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}, "{2}")]
)
def test_a_command_works_in_one_thread_unless_told_otherwise(told: dict[str, str], threads: str) -> None:
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("needs two processors")
    plain = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    lines = ["import contextlib", "from bench_service.cli.main import main", "with contextlib.suppress(SystemExit):"]
    code = "\n".join([*lines, "    main(['--help'])", SAYS])
    ended = subprocess.run(
        [sys.executable, "-c", code], env=plain | told, capture_output=True, text=True, timeout=60, check=True
    )
    assert ended.stdout.splitlines()[-1] == threads
