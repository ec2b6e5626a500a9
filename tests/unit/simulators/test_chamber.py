"""A simulated chamber: how fast its air moves, that a cell in it follows, and what its faults do."""

import math

import pytest

from drivers.register_map import load_map
from simulators.bench_devices import build_device
from simulators.bench_settings import SimulatorSettings
from simulators.chamber import Chamber, ChamberSettings
from simulators.chamber_device import ChamberDevice
from simulators.chamber_server import chamber_alone
from simulators.modbus_refusals import RefusedError


def warmed(to_degC: float, seconds: float, step_s: float, **more: float) -> Chamber:
    chamber = Chamber(ChamberSettings(**more))
    chamber.set(to_degC)
    chamber.switch(True)
    for _ in range(round(seconds / step_s)):
        chamber.advance(step_s)
    return chamber


def test_the_air_moves_by_the_ramp_and_then_as_a_lag() -> None:
    # 3 K/min and 60 s: 12 K to go, of which 9 K at full speed (180 s), then 3 K by exp(-t/60).
    assert warmed(37.0, 120.0, 10.0).air_degC == pytest.approx(31.0)
    expected = 37.0 - 3.0 * math.exp(-1.0)
    for step_s in (0.5, 7.5, 240.0):
        assert warmed(37.0, 240.0, step_s).air_degC == pytest.approx(expected)
    assert warmed(13.0, 240.0, 1.0).air_degC == pytest.approx(13.0 + 3.0 * math.exp(-1.0))


def test_off_it_goes_back_to_the_room_slowly() -> None:
    chamber = warmed(45.0, 3600.0, 60.0)
    chamber.switch(False)
    chamber.advance(3600.0)
    assert chamber.air_degC == pytest.approx(25.0 + 20.0 * math.exp(-1.0), abs=0.01)


def test_a_cell_in_it_has_its_air_around_it() -> None:
    settings = SimulatorSettings(lock_step=True, ambient_degC=20.0)
    chamber = Chamber(ChamberSettings(), settings.ambient_degC)
    device = build_device(settings, chamber=chamber)
    chamber.set(40.0)
    chamber.switch(True)
    for _ in range(60):
        device.cycler.advance(60.0)
    seen = device.cycler.measurement
    assert chamber.air_degC == pytest.approx(40.0, abs=0.01)
    assert seen.ambient_degC == pytest.approx(40.0, abs=0.1) and 35.0 < seen.temperature_degC < 40.1


@pytest.mark.parametrize(
    ("script", "air", "shown", "on", "alarms"),
    [
        ("nan.temperature@t:5", 25.5, math.nan, True, set()),
        ("jump.temperature=10@t:5", 25.5, 35.5, True, set()),
        ("watchdog@t:5", 25.0, 25.0, False, {"heater"}),
        ("over_temperature=60@t:5", 625.5, 625.5, False, {"over_temperature"}),
        ("frozen@t:5", 25.5, 25.0, True, set()),
    ],
)
def test_its_faults(script: str, air: float, shown: float, on: bool, alarms: set[str]) -> None:
    chamber = warmed(35.0, 0.0, 1.0, faults=script)
    assert chamber.shown_degC == 25.0
    chamber.advance(10.0)
    assert chamber.shown_degC == pytest.approx(shown, nan_ok=True)
    assert (chamber.air_degC, chamber.on, chamber.alarms) == (pytest.approx(air), on, alarms)
    chamber.switch(True)
    assert chamber.on is not bool(alarms)


def test_a_restart_forgets_and_a_deaf_one_does_not_listen() -> None:
    chamber = warmed(35.0, 0.0, 1.0, faults="restart@t:5")
    chamber.advance(10.0)
    assert chamber.shown_degC == 25.0 and not chamber.on and chamber.set_degC == 25.0
    deaf = Chamber(ChamberSettings(faults="refused@t:0"))
    assert deaf.shown_degC == 25.0
    deaf.set(35.0)
    assert deaf.set_degC == 25.0


def test_its_registers_refuse_what_is_not_there() -> None:
    device = ChamberDevice(load_map("generic_chamber", "chamber"), Chamber(ChamberSettings()), lambda: None)
    assert device.read("holding", 100, 4) == b"\x09\xc4\x09\xc4\x00\x00\x00\x00"
    device.write(100, (3500).to_bytes(2, "big"))
    device.write_coils(0, [True])
    assert device.chamber.set_degC == 35.0 and device.read_coils(0, 2) == [True, False]
    for wrong in (
        lambda: device.write(101, b"\0\0"),
        lambda: device.write(100, b"\x7f\xff"),
        lambda: device.read_coils(5, 1),
    ):
        with pytest.raises(RefusedError):
            wrong()
    device.chamber.alarms.add("fan")
    device.write_coils(1, [True])
    assert not device.chamber.alarms


def test_one_of_its_own_moves_with_the_wall_clock() -> None:
    now = [100.0]
    settings = SimulatorSettings(map_name="generic_chamber", speed=10.0)
    device, _ = chamber_alone(settings, lambda: now[0])
    device.write(100, (3500).to_bytes(2, "big"))
    device.write_coils(0, [True])
    now[0] += 6.0
    device.heard()
    assert device.chamber.air_degC == pytest.approx(28.0) and device.read("holding", 101, 1) == (2800).to_bytes(
        2, "big"
    )
    with pytest.raises(ValueError, match="in lock-step it stands beside a bench"):
        chamber_alone(SimulatorSettings(map_name="generic_chamber", lock_step=True))


@pytest.mark.parametrize("wrong", [{"ramp_K_per_min": 0.0}, {"port": -1}, {"faults": "nonsense"}])
def test_what_no_chamber_is_like_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"chamber|fault"):
        ChamberSettings(**wrong)  # pyright: ignore[reportArgumentType]
