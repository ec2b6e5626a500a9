"""Every fault in the middle of a pulse, over every transport: rest, one reason, and no wrong sample stored as good."""

import asyncio

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simulators.faults import DEVICE_KINDS, LINK_KINDS, VALUE_KINDS
from tests.patience import FACTOR
from tests.protocol.fault_runs import play, play_case, random_case

HARMLESS = {"delay"}
LATE_S = 0.65
# Less than what comes late; where nothing does, as long as a busy machine may take.
IMPATIENT_S, PATIENT_S = 0.5, 10.0 * FACTOR
AGAIN = 4
WIRES = ("modbus-tcp", "modbus-rtu", "can-virtual")


def script(kind):
    """The fault with the twelfth sample or, where that is what it is about, the seventh set-point."""
    size = {"late": f"={LATE_S}", "slow": f"={LATE_S}", "short": "=0.05", "over_temperature": "=20"}.get(kind, "")
    return f"{kind}{size}@set_point:7" if kind in ("refused", "lost_reply") else f"{kind}{size}@sample:12"


async def played(script, transport, **how):
    """A fault, impatiently: a machine that was too busy for that before the fault began has said nothing of it."""
    outcome = await play(script, transport, timeout_s=IMPATIENT_S, **how)
    for _ in range(AGAIN):
        if outcome.begun:
            break
        outcome = await play(script, transport, timeout_s=IMPATIENT_S, **how)
    return outcome


@pytest.mark.parametrize("transport", WIRES)
@pytest.mark.parametrize("kind", LINK_KINDS)
async def test_a_message_goes_wrong(kind, transport):
    outcome = await played(script(kind), transport)
    assert outcome.begun == (kind,) and not outcome.complaints
    assert outcome.end.state == ("completed" if kind in HARMLESS else "fault"), outcome.end


@pytest.mark.parametrize("transport", ["modbus-tcp", "can-udp"])
@pytest.mark.parametrize("kind", [*DEVICE_KINDS, *VALUE_KINDS])
async def test_a_device_or_a_value_goes_wrong(kind, transport):
    outcome = await play(script(kind), transport, timeout_s=PATIENT_S)
    assert outcome.begun == (kind,) and not outcome.complaints
    assert outcome.end.state == "fault", outcome.end


@pytest.mark.parametrize("what", ["current", "temperature"])
@pytest.mark.parametrize("kind", ["nan", "sentinel", "jump=30", "reversed"])
async def test_another_value_goes_wrong(kind, what):
    name, _, size = kind.partition("=")
    outcome = await play(f"{name}.{what}{'=' + size if size else ''}@sample:12", "modbus-tcp", timeout_s=PATIENT_S)
    assert outcome.end.state == "fault" and not outcome.complaints, outcome


@pytest.mark.parametrize("kind", ["silence", "late", "watchdog", "nan", "restart"])
async def test_on_the_wall_clock(kind):
    outcome = await played(script(kind) + ("x1000" if kind == "silence" else ""), "modbus-tcp", lock_step=False)
    assert outcome.begun == (kind,) and outcome.end.state == "fault" and not outcome.complaints, outcome


async def test_nothing_goes_wrong():
    outcome = await play("", "modbus-tcp", timeout_s=PATIENT_S)
    assert outcome.end.state == "completed" and not outcome.complaints


async def test_the_judge_sees_a_wrong_sample_that_is_not_marked(monkeypatch):
    """The judgement itself can fail: without the mark, the sample that ended the run counts as good."""
    monkeypatch.setattr("bench_service.bench.run_loop.sample_flags", lambda *_, **__: 0)
    outcome = await play("jump.temperature=30@sample:12", "modbus-tcp", timeout_s=PATIENT_S)
    assert any("stored as good" in complaint for complaint in outcome.complaints)


@settings(max_examples=8, deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 2**32 - 1))
def test_random_faults_end_safely(seed):
    outcome = asyncio.run(play_case(seed))
    assert not outcome.complaints, (random_case(seed), outcome)
