"""What the service loads before it answers."""

import json
import subprocess
import sys

# Each costs tenths of a second; workers and single requests load them when they need them.
HEAVY = (
    "scipy",
    "numba",
    "pyarrow",
    "rich",
    "models.network.local_model_network",
    "models.network.signals",
    "models.observer",
)


def test_the_service_starts_without_the_libraries_of_its_workers() -> None:
    program = f"import bench_service.app, json, sys; print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert json.loads(answer.stdout) == []
