"""What the service loads before it answers."""

import json
import subprocess
import sys

from tests.patience import PATIENCE_S

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


def loaded(module: str, names: tuple[str, ...]) -> list[str]:
    """Which of these a new interpreter has loaded once it has imported a module."""
    program = f"import {module}, json, sys; print(json.dumps([m for m in {names!r} if m in sys.modules]))"
    command = [sys.executable, "-c", program]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S).stdout)


def test_the_service_starts_without_the_libraries_of_its_workers() -> None:
    assert loaded("bench_service.app", HEAVY) == []


def test_a_control_process_starts_without_what_only_fits_need() -> None:
    assert (
        loaded("bench_service.bench.__main__", ("scipy.signal", "scipy.interpolate", "scipy.optimize", "pyarrow")) == []
    )


def test_a_control_process_starts_without_the_observer_and_its_compiler() -> None:
    assert loaded("bench_service.bench.__main__", HEAVY) == []


def test_models_load_without_what_few_of_them_need() -> None:
    assert loaded("models.pipeline", ("scipy.stats", "scipy.optimize", "scipy.signal", "scipy.interpolate")) == []
