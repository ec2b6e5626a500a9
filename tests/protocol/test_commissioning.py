"""A commissioning over each transport, and what it finds where the device is not as it should be."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bench_service.bench.commissioning import proving
from bench_service.bench.commissioning.check import ProofOrder, Report
from bench_service.bench.commissioning.commissioner import commission
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings
from bench_service.bench.stop import StopSignal
from drivers.cycler import CyclerProtocolError
from drivers.factory import open_cycler
from drivers.register_map import MAPS
from simulators import clocks
from tests.protocol.rigs import Rig, rig

LIMITS = Limits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), (0.0, 1.0), None, 1e6)
PROVE = ProofOrder(prove=True, settle_s=0.2)
FEED: Any = SimpleNamespace(due=False, note_lateness=lambda _: None)
GONE_S = 0.3


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simulator in lock-step that misses its client soon."""
    monkeypatch.setattr(clocks, "CLIENT_GONE_S", GONE_S)
    monkeypatch.setattr(proving, "_CLIENT_GONE_S", GONE_S)


async def commissioned(made: Rig, order: ProofOrder = PROVE, **changes: Any) -> Report:
    settings = replace(BenchSettings("b", made.address, made.map_name, LIMITS, watchdog_s=0.3), **changes)
    device = made.driver, await made.driver.connect()
    return await commission(settings, device, order, (FEED, StopSignal(), lambda *_: None))


def outcomes(report: Report) -> dict[str, str]:
    return {check.name: check.outcome for check in report.checks}


@pytest.mark.parametrize("transport", ["modbus-tcp", "modbus-rtu", "can-virtual"])
async def test_a_sound_device_passes(transport: str) -> None:
    async with rig(transport) as made:
        report = await commissioned(made)
        assert (report.state, report.reason, report.latch) == ("passed", None, None)
        proved = {"limits", "limit_refused", "limit_trips", "watchdog", "current_follows", "sign", "stop"}
        assert {outcomes(report)[name] for name in proved} == {"passed"}
        assert report.identity == {"maker": "", "model": "", "serial": "1", "firmware": "1"}
        assert made.at_rest and not made.device.cycler.alarms
        assert abs((await made.driver.sample()).current_A) < 0.02
        (sign,) = (check for check in report.checks if check.name == "sign")
        assert 0.01 < sign.values["resistance_least_Ohm"] <= sign.values["resistance_most_Ohm"] < 0.05


async def test_a_probe_writes_nothing() -> None:
    async with rig("modbus-tcp") as made:
        cycler = made.device.cycler
        before = dict(cycler.limits), cycler.watchdog_s, cycler.remote, cycler.output_on
        report = await commissioned(made, ProofOrder())
        assert report.state == "probed" and "limits" not in outcomes(report)
        assert (dict(cycler.limits), cycler.watchdog_s, cycler.remote, cycler.output_on) == before


async def test_a_watchdog_that_does_not_bite_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clocks, "CLIENT_GONE_S", 1e9)
    async with rig("modbus-tcp") as made:
        report = await commissioned(made)
        assert report.state == "failed" and outcomes(report)["watchdog"] == "failed"
        assert report.reason is not None and "without a message the output was still on" in report.reason
        assert report.latch is not None and "sign" not in outcomes(report)
        assert made.at_rest


async def test_a_map_of_the_wrong_sign_fails_with_little_current(tmp_path: Path) -> None:
    turned = tmp_path / "turned.toml"
    text = (MAPS / "generic.toml").read_text().split("[[frame]]")[0]
    for role in ("set_current", "actual_current", "setpoint_in_force"):
        text = text.replace(f'role = "{role}"', f'role = "{role}"\nscale = "-1"')
    turned.write_text(text)
    async with rig("modbus-tcp") as made:
        made.driver = open_cycler(made.address, turned, 5.0)
        report = await commissioned(made)
        await made.driver.close()
        assert report.state == "failed" and outcomes(report).get("sign") == "failed", report.reason
        assert report.reason is not None and "it falls when the cell is charged" in report.reason
        assert made.at_rest and "stop" not in outcomes(report)


async def test_a_stop_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proving, "_GRACE_S", 30.0)
    async with rig("modbus-tcp") as made:
        settings = BenchSettings("b", made.address, made.map_name, LIMITS, watchdog_s=0.3)
        device, stop = (made.driver, await made.driver.connect()), StopSignal()
        switch = made.device.cycler.set_output

        def switched(on: bool) -> None:  # in the silence: the second time that the output is on
            switch(on)
            seen.append(on)
            if sum(seen) == 2:
                stop.give("stopped", "by somebody")

        seen: list[bool] = []
        monkeypatch.setattr(made.device.cycler, "set_output", switched)
        report = await commission(settings, device, PROVE, (FEED, stop, lambda *_: None))
        assert (report.state, report.reason) == ("stopped", "by somebody")
        assert made.at_rest


async def test_pulses_that_do_not_fit_are_refused() -> None:
    async with rig("modbus-tcp") as made:
        report = await commissioned(made, replace(PROVE, current_A=11.0))
        assert report.state == "refused" and report.reason == "pulses of 11 A do not fit; up to 10 A may flow"
        assert made.at_rest


@pytest.mark.parametrize("transport", ["modbus-tcp", "can-virtual"])
async def test_another_device_at_the_address_is_told_and_not_written_to(transport: str) -> None:
    async with rig(transport) as made:
        # The usual second is less than a busy machine may need until the output is looked at.
        await made.running(2.0, watchdog_s=10.0)
        cycler = made.device.cycler
        made.driver._link.close()  # pyright: ignore[reportAttributeAccessIssue]
        cycler.settings = replace(cycler.settings, serial=2)
        if hasattr(made.device, "publish"):
            made.device.publish()
        other = "another device answers .* serial number is '2', before it was '1'"
        with pytest.raises(CyclerProtocolError, match=other):
            await made.driver.safe()
        assert cycler.set_point_A == 2.0
        assert (await made.driver.connect()).serial == "2"
        await made.driver.safe()
        assert made.at_rest


class Resistor:
    """A resistor in place of the cell: current makes a voltage and nothing else."""

    def __init__(self, ohm: float, cell: Any) -> None:
        self._ohm, self._truth = ohm, cell.step(0.0, 0.0)

    def step(self, current_A: float, dt_s: float) -> Any:
        return self._truth._replace(voltage_V=self._ohm * current_A)


@pytest.mark.parametrize(("stated_Ohm", "state"), [(0.5, "passed"), (0.8, "failed")])
async def test_a_known_resistor_proves_the_scales(stated_Ohm: float, state: str) -> None:
    async with rig("modbus-tcp") as made:
        cycler = made.device.cycler
        cycler._cell = Resistor(0.5, cycler._cell)
        # The output is off and the measurement that is shown still the cell's: both anew.
        cycler._truth = cycler._cell.step(0.0, 0.0)
        cycler.measurement = cycler.measurement._replace(voltage_V=-0.0005)
        made.device.publish()
        report = await commissioned(made, replace(PROVE, resistor_Ohm=stated_Ohm, current_A=2.0))
        assert report.state == state, report.reason
        assert outcomes(report)["sign"] == state and outcomes(report)["limit_trips"] == "absent"
        assert made.at_rest
