import asyncio

from bench_service.bench.lease import Lease


async def test_a_lease_is_lost_once_and_renewed() -> None:
    now, lost = [0.0], list[float]()
    lease = Lease(lost.append, 10.0, lambda: now[0])
    for now[0] in (1.0, 9.0):
        lease.watch()
    assert lost == []
    for now[0] in (10.5, 11.0, 30.0):
        lease.watch()
    assert lost == [10.5]
    lease.renew()
    now[0] = 41.0
    lease.watch()
    lease.close()
    await asyncio.sleep(0)
    assert lost == [10.5, 11.0]
