"""Fixtures for tests against an emulated battery behind an emulated cycler, over a real protocol, in lock-step.

In a `conftest.py`: ``pytest_plugins = ["bench_service.pytest_plugin"]``. Then

- `emulated_cell`: which cell there is (`EmulatedCell`);
- `emulated_cycler`: a cycler with that cell, served over Modbus TCP, Modbus RTU or CAN (`EmulatedCycler`);
- `bench`: plays profiles on it with the driver, the safety rules and the loop of the real bench (`EmulatedBench`).

What they are made of are fixtures too, so a test changes one by parametrising it: `emulated_protocol`,
`emulated_map`, `emulated_faults`, `emulated_seed`; or by ``@pytest.mark.emulated(cell="lfp", initial_soc=0.3, ...)``.
Simulated time moves as fast as the machine can, and the same test gives the same samples to the bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bench_service.pytest_plugin.fixtures import (
    _emulation,
    bench,
    emulated_cell,
    emulated_cycler,
    emulated_faults,
    emulated_map,
    emulated_protocol,
    emulated_seed,
    pytest_configure,
)
from bench_service.pytest_plugin.values import EmulatedCell, EmulatedRun

if TYPE_CHECKING:
    from bench_service.pytest_plugin.emulated_bench import EmulatedBench
    from bench_service.pytest_plugin.emulated_cycler import EmulatedCycler

__all__ = [
    "EmulatedBench",
    "EmulatedCell",
    "EmulatedCycler",
    "EmulatedRun",
    "bench",
    "emulated_cell",
    "emulated_cycler",
    "emulated_faults",
    "emulated_map",
    "emulated_protocol",
    "emulated_seed",
    "_emulation",
    "pytest_configure",
]


def __getattr__(name: str) -> Any:
    # Lazy: simulators, driver and run loop take 0.3 s, which every pytest session with the plugin would pay.
    if name == "EmulatedBench":
        from bench_service.pytest_plugin.emulated_bench import EmulatedBench

        return EmulatedBench
    if name == "EmulatedCycler":
        from bench_service.pytest_plugin.emulated_cycler import EmulatedCycler

        return EmulatedCycler
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
