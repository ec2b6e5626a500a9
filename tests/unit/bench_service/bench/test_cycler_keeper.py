"""A cycler comes and goes: made safe before it counts as there, waited for longer each time that it does not come."""

from dataclasses import replace
from typing import Any

import pytest

from bench_service.bench import cycler_keeper
from bench_service.bench.cycler_keeper import CyclerKeeper
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, CyclerError

SETTINGS = BenchSettings("left", "modbus-tcp://h:1", "generic", Limits((2, 4), (-1, 1), (0, 45), (0, 1), None, 9.0))
CAPABILITIES = Capabilities("device", "17", (-5, 5), (0, 5), (0.5, 5), True, True, True, True)


class Device:
    """Fails in the calls that are named."""

    def __init__(self, *fails: str) -> None:
        self.fails = fails
        self.calls: list[str] = []

    def __getattr__(self, name: str) -> Any:
        async def call() -> Any:
            self.calls.append(name)
            if name in self.fails:
                raise CyclerError(f"{name} failed")
            return CAPABILITIES if name == "connect" else None

        return call


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> list[Device]:
    """Devices that are found at the address, one after the other."""
    found: list[Device] = []
    monkeypatch.setattr(cycler_keeper, "open_cycler", lambda *_: found.pop(0))
    return found


def keeper_of() -> tuple[CyclerKeeper, list[tuple[str, str, str]]]:
    events: list[tuple[str, str, str]] = []
    return CyclerKeeper(SETTINGS, lambda *event: events.append(event)), events


async def test_a_cycler_is_there_once_it_is_at_rest(devices: list[Device]) -> None:
    device = Device()
    devices.append(device)
    keeper, events = keeper_of()
    assert (keeper.cycler, keeper.offline_reason) == (None, "not connected yet")
    await keeper.connect()
    assert device.calls == ["connect", "safe", "sample"]
    assert (keeper.cycler, keeper.capabilities, keeper.offline_reason) == (device, CAPABILITIES, None)
    assert events == [("info", "connected", "device 17 connected, at rest")]


async def test_one_that_does_not_come_to_rest_is_let_go(devices: list[Device]) -> None:
    device = Device("safe")
    devices.append(device)
    keeper, events = keeper_of()
    await keeper.connect()
    assert device.calls == ["connect", "safe", "safe", "close"]
    assert keeper.cycler is None and keeper.offline_reason is not None
    assert "rest was not confirmed: safe failed" in keeper.offline_reason
    assert [event[:2] for event in events] == [("warning", "offline")]


async def test_one_that_cannot_be_steered_is_let_go_at_rest(devices: list[Device]) -> None:
    device = Device("sample")
    devices.append(device)
    keeper, events = keeper_of()
    await keeper.connect()
    assert device.calls == ["connect", "safe", "sample", "close"]
    assert (keeper.cycler, keeper.offline_reason, keeper.retry_s) == (None, "sample failed", 0.2)
    assert [event[:2] for event in events] == [("warning", "offline")]


async def test_each_failure_is_waited_for_longer_and_told_once(devices: list[Device]) -> None:
    devices += [Device("connect") for _ in range(8)] + [Device()]
    keeper, events = keeper_of()
    waits = []
    for _ in range(8):
        await keeper.connect()
        waits.append(keeper.retry_s)
    assert waits == [0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0]
    assert len(events) == 1
    await keeper.connect()
    assert keeper.retry_s == 0.0 and events[-1][1] == "connected"


async def test_one_that_cannot_be_released_is_let_go(devices: list[Device]) -> None:
    device = Device("release")
    devices.append(device)
    keeper, events = keeper_of()
    await keeper.release()  # nothing there
    await keeper.connect()
    await keeper.release()
    assert device.calls[-2:] == ["release", "close"]
    assert (keeper.cycler, keeper.capabilities, keeper.offline_reason) == (None, None, "release failed")
    assert events[-1] == ("warning", "offline", "left is offline: release failed")


async def test_another_device_at_the_address_is_told(devices: list[Device]) -> None:
    class Other(Device):
        def __getattr__(self, name: str) -> Any:
            async def call() -> Any:
                return replace(CAPABILITIES, serial="18") if name == "connect" else None

            return call

    devices += [Device(), Device(), Other()]
    keeper, events = keeper_of()
    for _ in range(2):
        await keeper.connect()
        await keeper.disconnect("gone")
    assert [code for _, code, _ in events] == ["connected", "offline", "connected", "offline"]
    await keeper.connect()
    assert ("error", "other_device") in [event[:2] for event in events]
    assert any("the serial number is '18', before it was '17'" in text for _, _, text in events)


async def test_what_an_earlier_process_has_seen_is_known(devices: list[Device]) -> None:
    devices += [Device(), Device()]
    known = {"maker": "", "model": "", "serial": "17", "firmware": "0.9"}
    events: list[tuple[str, str, str]] = []
    keeper = CyclerKeeper(replace(SETTINGS, identity=known), lambda *event: events.append(event))
    await keeper.connect()
    told = [text for _, code, text in events if code == "other_device"]
    assert len(told) == 1 and "the firmware is '', before it was '0.9'" in told[0]
    await keeper.disconnect("gone")
    await keeper.connect()  # acknowledged or not: it is the known one now
    assert len([code for _, code, _ in events if code == "other_device"]) == 1


async def test_at_the_end_the_cycler_is_brought_to_rest(devices: list[Device]) -> None:
    device = Device()
    devices.append(device)
    keeper, _ = keeper_of()
    await keeper.leave()
    await keeper.connect()
    await keeper.leave()
    assert device.calls[-2:] == ["safe", "close"]
