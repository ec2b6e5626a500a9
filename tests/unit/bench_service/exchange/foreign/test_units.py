"""Units in names of columns."""

import pytest

from bench_service.exchange.foreign.units import split_name


@pytest.mark.parametrize(
    ("name", "base", "unit"),
    [
        ("Voltage(V)", "voltage", "V"),
        ("Ecell/V", "ecell", "V"),
        ("<I>/mA", "i", "mA"),
        ("U[V]", "u", "V"),
        ("Test Time / s", "test time", "s"),
        ("Test_Time(s)", "test time", "s"),
        ("~Time[s]", "time", "s"),
        ("Run Time (h)", "run time", "h"),
        ("Test Time (sec)", "test time", "s"),
        ("test_time_second", "test time", "s"),
        ("surface_temperature_celsius", "surface temperature", "degC"),
        ("Temperature/\ufffdC", "temperature", "degC"),
        ("T1(℃)", "t1", "degC"),
        ("Current, mA", "current", "mA"),
        ("Strom in A", "strom", "A"),
        ("I (µA)", "i", "uA"),
        ("Total Time (hh:mm:ss.SSS)", "total time", "duration"),
        ("Cycle Count / 1", "cycle count", None),
        ("step_count", "step count", None),
        ("control/V/mA", "control v", "mA"),
    ],
)
def test_name_and_unit(name: str, base: str, unit: str | None) -> None:
    found, of, other = split_name(name)
    assert (found, of.name if of else None, other) == (base, unit, False)


def test_a_power_is_none_of_ours() -> None:
    assert split_name("Current Power (W)")[2]
