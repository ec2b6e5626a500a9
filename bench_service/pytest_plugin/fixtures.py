"""The fixtures of the plugin, and its marker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from bench_service.pytest_plugin.background import Background
from bench_service.pytest_plugin.values import EmulatedCell

if TYPE_CHECKING:
    from bench_service.pytest_plugin.emulated_bench import EmulatedBench
    from bench_service.pytest_plugin.emulated_cycler import EmulatedCycler

_PROTOCOLS = ("modbus-tcp", "modbus-rtu", "can")


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line(
        "markers",
        "emulated(cell=, capacity_Ah=, initial_soc=, ambient_degC=, effects=, protocol=, map=, faults=, seed=): "
        "what the emulated bench of a test is made of",
    )


def _marked(request: pytest.FixtureRequest, name: str, default: Any) -> Any:
    found = [marker.kwargs[name] for marker in request.node.iter_markers("emulated") if name in marker.kwargs]
    return found[0] if found else default


@pytest.fixture
def emulated_protocol(request: pytest.FixtureRequest) -> str:
    """Return "modbus-tcp", "modbus-rtu" (a pseudo-terminal) or "can" (a virtual bus)."""
    return _marked(request, "protocol", "modbus-tcp")


@pytest.fixture
def emulated_map(request: pytest.FixtureRequest, emulated_protocol: str) -> str:
    """Return the device map: a name, or the path of a file."""
    return _marked(request, "map", "generic_can" if emulated_protocol == "can" else "generic")


@pytest.fixture
def emulated_faults(request: pytest.FixtureRequest) -> str:
    """Return what goes wrong when, see `simulators.faults`; nothing by default."""
    return _marked(request, "faults", "")


@pytest.fixture
def emulated_seed(request: pytest.FixtureRequest) -> int:
    """Return the seed of all noise."""
    return _marked(request, "seed", 0)


@pytest.fixture
def emulated_cell(request: pytest.FixtureRequest) -> EmulatedCell:
    """Return the cell; a test's marker changes it."""
    default = EmulatedCell()
    names = ("cell", "capacity_Ah", "initial_soc", "ambient_degC", "effects")
    return replace(default, **{name: _marked(request, name, getattr(default, name)) for name in names})


@pytest.fixture
def _emulation() -> Iterator[Background]:
    """Run an event loop for the emulated devices of a test."""
    background = Background()
    yield background
    background.close()


@pytest.fixture
def emulated_cycler(
    _emulation: Background,
    emulated_cell: EmulatedCell,
    emulated_protocol: str,
    emulated_map: str,
    emulated_faults: str,
    emulated_seed: int,
) -> Iterator[EmulatedCycler]:
    """Serve a cycler with the cell, in lock-step."""
    # Lazy: the simulators take 0.2 s, and most tests of a session may need none.
    from bench_service.pytest_plugin.emulated_cycler import EmulatedCycler
    from simulators.bench import SimulatorSettings

    if emulated_protocol not in _PROTOCOLS:
        raise ValueError(f"emulated_protocol is {emulated_protocol!r}; choose one of {', '.join(_PROTOCOLS)}")
    settings = SimulatorSettings(
        protocol=emulated_protocol,
        map_name=emulated_map,
        cell=emulated_cell.cell,
        capacity_Ah=emulated_cell.capacity_Ah,
        initial_soc=emulated_cell.initial_soc,
        ambient_degC=emulated_cell.ambient_degC,
        effects=emulated_cell.effects,
        seed=emulated_seed,
        lock_step=True,
    )
    cycler = EmulatedCycler(_emulation, emulated_protocol, emulated_map, emulated_faults, settings)
    yield cycler
    cycler.close()


@pytest.fixture
def bench(_emulation: Background, emulated_cycler: EmulatedCycler, emulated_cell: EmulatedCell) -> EmulatedBench:
    """Return a bench with the emulated cycler."""
    # Lazy: driver and run loop take 0.1 s more.
    from bench_service.pytest_plugin.emulated_bench import EmulatedBench

    return EmulatedBench(_emulation, emulated_cycler, emulated_cell)
