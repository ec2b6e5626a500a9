"""What a client or a campaign asks for, and what the bench is asked for in turn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench_service.bench.limits import WINDOWS, Limits
from bench_service.bench.protocol_window import window_of
from bench_service.bench.request import ObserverOrder, ProtocolOrder, RunRequest
from bench_service.campaign.admission import admit, narrowed
from bench_service.campaign.benches import Bench
from bench_service.campaign.cell_of_run import check_cell
from bench_service.campaign.chambers import chamber_window
from bench_service.campaign.run_models import BandWish, band_order
from bench_service.campaign.storage import Storage
from bench_service.config import BenchConfig
from bench_service.errors import BadRequestError
from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.preview import preview
from bench_service.protocol.program import ChamberWindow, Program
from bench_service.protocol.state import Standing
from bench_service.protocol.steps import Protocol
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json

# Room for a protocol of which nobody knows how long it takes.
_SAMPLES_UNKNOWN = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrder:
    """What a client or a campaign asks for; units are in the names.

    ``limits`` names only what is narrower than the bench's own. With ``model_id`` the observer runs live, starting
    at ``observer_initial_soc`` (default: ``initial_soc``), with ``observer_gain`` (default: the bench's, see
    `config.bench.BenchConfig`). With ``finish_alone`` it plays on where the service is gone.
    ``continues`` names the run whose profile or protocol is taken up again; ``standing`` is where the protocol stood.
    ``band`` names a model whose band the voltage must not leave. ``cell_id`` names the cell that must be on the bench.
    """

    bench: str
    profile_id: str | None = None
    protocol_id: str | None = None
    dt_s: float
    initial_soc: float
    limits: Mapping[str, Any] | None = None
    model_id: str | None = None
    observer_initial_soc: float | None = None
    observer_gain: str | None = None
    name: str | None = None
    seed: int | None = None
    campaign_id: str | None = None
    finish_alone: bool = False
    continues: str | None = None
    on_interruption: str | None = None
    standing: Json | None = None
    band: BandWish | None = None
    cell_id: str | None = None


def request_of(order: RunOrder, bench: Bench, store: MetadataStore, storage: Storage) -> RunRequest:
    """Build the request of an order; reads the store, so it is called in a thread.

    Raises
    ------
    NotFoundError
        Unknown profile, protocol or model.
    BadRequestError
        Profile, protocol or limits are not admitted.
    ConflictError
        Another cell is on the bench than the one that is meant, or that what it goes on with was played on.
    NoRoomError, StoreError
        It could not be stored.
    """
    check_cell(order.cell_id, bench, store, continues=order.continues, campaign_id=order.campaign_id)
    if (order.profile_id is None) == (order.protocol_id is None):
        raise BadRequestError("a run plays a profile or a protocol: give exactly one of both", ("profile_id",))
    if order.band is not None and order.protocol_id is not None:
        raise BadRequestError("a model has a band along a profile, not along a protocol", ("band",))
    limits = narrowed(bench.limits, order.limits)
    time_s = current_A = np.empty(0)
    protocol = None
    if order.protocol_id is not None:
        document = store.protocols.document(order.protocol_id)
        limits, protocol, samples = _protocol(order, document, limits, bench.config)
    else:
        assert order.profile_id is not None
        time_s, current_A = store.profiles.points(order.profile_id)
        capacity_Ah = bench.config.capacity_Ah
        grid = {"dt_s": order.dt_s, "tick_s": bench.tick_s(order.dt_s)}
        admit(time_s, current_A, limits, initial_soc=order.initial_soc, capacity_Ah=capacity_Ah, **grid)
        samples = math.ceil(float(time_s[-1]) / order.dt_s)
    storage.refuse(samples)
    return RunRequest(
        run_id="",
        dt_s=order.dt_s,
        limits=limits,
        capacity_Ah=bench.config.capacity_Ah,
        time_s=time_s,
        current_A=current_A,
        initial_soc=order.initial_soc,
        observer=_observer(order, store, bench.config.observer_gain),
        settle_s=bench.config.settle_s,
        finish_alone=order.finish_alone,
        protocol=protocol,
        unverified=(hardware := bench.standing()) is not None and hardware.warns,
        band=band_order(store.models, order.band, bench.live),
    )


def program_for(
    document: Json, limits: Limits, capacity_Ah: float, chamber: ChamberWindow | None = None
) -> tuple[Protocol, Limits, Program]:
    """Make a protocol ready for a bench; the narrower of its limits and the bench's hold.

    Raises
    ------
    ProtocolError
        It cannot be played there.
    """
    protocol = read_protocol(document)
    both = within(limits, protocol.limits)
    return protocol, both, compile_protocol(protocol, capacity_Ah, window_of(both, chamber=chamber))


def within(limits: Limits, own: Mapping[str, Any]) -> Limits:
    """Return the narrower of a bench's limits and a protocol's; raises `BadRequestError` where nothing is left."""
    values = limits.to_json()
    for name in WINDOWS:
        if name in own:
            (low, high), (outer_low, outer_high) = own[name], values[name]
            values[name] = [max(low, outer_low), min(high, outer_high)]
    if "ramp_A_per_s" in own:
        values["ramp_A_per_s"] = min(own["ramp_A_per_s"], limits.ramp_A_per_s or math.inf)
    values["duration_s"] = min(own.get("duration_s", math.inf), limits.duration_s)
    try:
        return Limits.from_json(values)
    except ValueError as error:
        raise BadRequestError(f"the protocol's limits leave nothing of the bench's: {error}", ("limits",)) from error


def _protocol(order: RunOrder, document: Json, limits: Limits, bench: BenchConfig) -> tuple[Limits, ProtocolOrder, int]:
    protocol, both, program = program_for(document, limits, bench.capacity_Ah, chamber_window(bench))
    standing = None if order.standing is None else Standing.from_json(order.standing)
    seen = preview(program, order.initial_soc, order.dt_s, standing)
    every_s = max(order.dt_s, protocol.record.time_s or 0.0)
    samples = _SAMPLES_UNKNOWN if seen.duration_s is None else math.ceil(seen.duration_s / every_s)
    return both, ProtocolOrder(document=document, standing=order.standing, expected_s=seen.duration_s), samples


def _observer(order: RunOrder, store: MetadataStore, bench_gain: str | None) -> ObserverOrder | None:
    if order.model_id is None:
        return None
    start_soc = order.initial_soc if order.observer_initial_soc is None else order.observer_initial_soc
    settings: dict[str, Any] = {"initial_soc": start_soc}
    if (gain := order.observer_gain or bench_gain) is not None:
        settings["gain"] = gain
    return ObserverOrder(model=store.models.document(order.model_id), settings=settings)
