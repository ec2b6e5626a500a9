"""One commissioning at a time, answered or lost."""

import asyncio

import pytest

from bench_service.bench.commissioning.call import CommissionCall
from bench_service.bench.commissioning.check import ProofOrder
from bench_service.errors import BenchBusyError, BenchOfflineError


async def test_it_is_answered_once() -> None:
    call = CommissionCall("left")
    message = call.begin(ProofOrder(prove=True, current_A=1.0))
    assert message["op"] == "commission"
    assert ProofOrder.from_json(message["order"]) == ProofOrder(prove=True, current_A=1.0)
    with pytest.raises(BenchBusyError, match="is being commissioned"):
        call.begin(ProofOrder())
    waiting = asyncio.create_task(call.answer())
    await asyncio.sleep(0)
    call.answered({"state": "passed"})
    call.answered({"state": "late"})
    assert await waiting == {"state": "passed"}
    call.begin(ProofOrder())


async def test_a_process_that_goes_takes_it_along() -> None:
    call = CommissionCall("left")
    call.lost("nothing was asked")
    call.begin(ProofOrder())
    call.lost("its control process has ended")
    with pytest.raises(BenchOfflineError, match="its control process has ended; commission it again"):
        await call.answer()


def test_an_order_with_other_keys_is_none() -> None:
    with pytest.raises(ValueError, match="commissioning order"):
        ProofOrder.from_json({"prove": True, "speed": 2})
