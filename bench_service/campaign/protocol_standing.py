"""Where a protocol stands that something outside the cell has cut off: step, cycle and counted charge."""

from __future__ import annotations

from dataclasses import replace

from bench_service.bench.limits import Limits
from bench_service.bench.protocol_window import window_of
from bench_service.campaign.benches import Bench
from bench_service.campaign.ordering import RunOrder
from bench_service.errors import ConflictError
from bench_service.jobs.counting import counted_soc
from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.program import ANY_CHAMBER
from bench_service.protocol.resuming import standing_after
from bench_service.protocol.state import Standing
from bench_service.store.integrity import Expected, read_whole
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES, RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import STEPS

# Runs in a row without a sample: the next one will not get any further.
_MOST_IN_VAIN = 3


def taken_up(order: RunOrder, bench: Bench, store: MetadataStore, samples: SampleReader) -> RunOrder:
    """Return the order for what a run of a protocol has left over; reads the store, so it is called in a thread.

    Raises
    ------
    ConflictError
        The run has not ended, or has come to its end, or was of another protocol or another cell.
    DamagedError
        Samples of it are missing: nobody knows where the cell stands.
    """
    assert order.continues is not None
    run, where = store.runs.get(order.continues), ("continues", order.continues)
    if run.protocol_id is None or run.protocol_id != order.protocol_id:
        raise ConflictError(f"run {run.id} did not play protocol {order.protocol_id}; give its own", where)
    if run.state in (*OPEN_RUN_STATES, "completed"):
        raise ConflictError(f"run {run.id} is {run.state}; there is nothing to go on with", where)
    if run.bench != bench.name:
        raise ConflictError(f"run {run.id} was on bench {run.bench!r}, where its cell is", where)
    if run.number <= bench.runs_before_cell:
        raise ConflictError(f"the simulated cell of run {run.id} has begun anew with the service; start it anew", where)
    standing, soc = standing_of(run, store, samples)
    if standing is None:
        raise ConflictError(f"run {run.id} has played its protocol to the end", where)
    return replace(order, standing=standing.to_json(), initial_soc=soc)


def standing_of(run: RunRecord, store: MetadataStore, samples: SampleReader) -> tuple[Standing | None, float]:
    """Return where the protocol of a run stands after it, and the counted state of charge; see `taken_up`."""
    assert run.protocol_id is not None
    start = None if run.standing is None else Standing.from_json(run.standing)
    program = compile_protocol(
        read_protocol(store.protocols.document(run.protocol_id)),
        run.capacity_Ah,
        window_of(Limits.from_json(run.limits), chamber=ANY_CHAMBER),
    )
    if not run.n_samples:
        return start or Standing(counters=[0] * program.n_counters), run.initial_soc
    columns = read_whole(samples, Expected.of(run)).columns
    steps = samples.read(run.id, STEPS).columns
    try:
        standing = standing_after(program, start, steps, columns)
    except ValueError as error:
        raise ConflictError(f"run {run.id}: {error}", ("continues", run.id)) from error
    soc = float(counted_soc(columns["time_s"], columns["current_A"], run.initial_soc, run.capacity_Ah)[-1])
    return standing, min(max(soc, 0.0), 1.0)


def left_to_resume(store: MetadataStore, bench: str) -> RunRecord | None:
    """Return the run whose protocol goes on by itself on a bench: its last, where that was cut off and says so."""
    last = store.runs.page(bench=bench, limit=_MOST_IN_VAIN)
    if not last or not goes_on(last[0]):
        return None
    in_vain = len(last) == _MOST_IN_VAIN and not any(run.n_samples for run in last)
    return None if in_vain else last[0]


def goes_on(run: RunRecord) -> bool:
    """Whether a run was cut off, and is to go on by itself; one that a person or a fault has ended never does."""
    cut_off = run.state == "interrupted" and run.protocol_id is not None and run.campaign_id is None
    return cut_off and run.on_interruption == "resume"
