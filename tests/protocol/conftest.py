"""Simulated cyclers with their drivers, as many tests of one transport need them."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from tests.protocol.rigs import Rig, rig


@pytest.fixture
async def tcp() -> AsyncIterator[Rig]:
    """Modbus TCP through a proxy, in lock-step."""
    async with rig("modbus-tcp", proxied=True) as made:
        yield made


@pytest.fixture
async def wall() -> AsyncIterator[Rig]:
    """Modbus TCP through a proxy, on the wall clock."""
    async with rig("modbus-tcp", proxied=True, lock_step=False) as made:
        yield made


@pytest.fixture
async def rtu() -> AsyncIterator[Rig]:
    """Modbus RTU in lock-step."""
    async with rig("modbus-rtu", timeout_s=0.15) as made:
        yield made


@pytest.fixture
async def made() -> AsyncIterator[Rig]:
    """CAN inside this process, in lock-step."""
    async with rig("can-virtual") as made:
        yield made


@pytest.fixture
async def udp() -> AsyncIterator[Rig]:
    """CAN by UDP multicast, in lock-step."""
    async with rig("can-udp") as made:
        yield made
