"""An example: a charging routine, tested against an emulated battery in CI; hours of charging take a second.

Run it with ``pytest docs/example-tests``.
"""

import pytest

FAULTS = ["silence@sample:20", "nan.voltage@t:3", "restart@t:3", "short=0.05@t:3"]


def charge_profile(capacity_Ah: float, hours: float) -> tuple[list[float], list[float]]:
    """What is under test here: half an hour at C/2, then rest."""
    seconds = 3600.0 * hours
    return [0.0, seconds, seconds + 600.0], [capacity_Ah / 2.0, 0.0, 0.0]


@pytest.mark.emulated(cell="nmc", initial_soc=0.3)
def test_half_an_hour_at_half_a_c_stores_a_quarter(bench):
    """The charge that was counted is the charge that was asked for."""
    run = bench.play(*charge_profile(bench.capacity_Ah, 0.5), dt_s=1.0)
    assert run.state == "completed", run.reason
    charge_Ah = run.current_A.sum() / 3600.0
    assert charge_Ah == pytest.approx(0.25 * bench.capacity_Ah, rel=0.01)
    assert run.voltage_V[-1] > run.voltage_V[0]


@pytest.mark.emulated(cell="lfp", initial_soc=0.95)
def test_a_full_cell_ends_the_run_before_it_is_overcharged(bench, emulated_cycler):
    """The bench's own limits hold whatever the routine asks for."""
    run = bench.play(*charge_profile(bench.capacity_Ah, 1.0), dt_s=1.0)
    assert run.state == "fault" and run.code in ("voltage_limit", "soc_limit")
    assert run.at_rest and not emulated_cycler.cycler.output_on


@pytest.mark.parametrize("emulated_protocol", ["modbus-tcp", "modbus-rtu", "can"])
def test_every_transport_gives_the_same_run(bench, emulated_protocol):
    """Modbus TCP, Modbus RTU on a pseudo-terminal, CAN on a virtual bus."""
    run = bench.play([0.0, 10.0, 20.0], [1.0, -1.0, 0.0], dt_s=0.5)
    assert run.state == "completed" and len(run.time_s) == 41
    assert run.voltage_V[19] > run.voltage_V[39]


@pytest.mark.parametrize(
    "emulated_faults", ["silence@sample:20x99", "nan.voltage@t:3", "restart@t:3", "short=0.05@t:3"]
)
def test_whatever_fails_the_bench_ends_at_rest(bench, emulated_cycler, emulated_faults):
    """A silent device, a lost sensor, a restart, an internal short."""
    run = bench.play([0.0, 10.0], [2.0, 0.0], dt_s=0.2, timeout_s=0.1)
    assert run.state == "fault" and run.reason
    assert not emulated_cycler.cycler.output_on
