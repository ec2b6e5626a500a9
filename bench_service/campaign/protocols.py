"""Protocols taken in, made for a bench, and looked at before they are started."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from bench_service.bench.protocol_window import window_of
from bench_service.campaign.benches import Bench
from bench_service.campaign.chambers import chamber_window
from bench_service.campaign.ordering import program_for, within
from bench_service.campaign.protocol_design import with_designs
from bench_service.campaign.services import Services
from bench_service.errors import BadRequestError
from bench_service.protocol.document import read_protocol
from bench_service.protocol.formats.reading import any_document
from bench_service.protocol.library import build_test
from bench_service.protocol.preview import Preview, preview
from bench_service.protocol.program import Again, Play, Program
from bench_service.store.records import Json, ProtocolRecord


async def add_protocol(services: Services, body: Json) -> ProtocolRecord:
    """Check a protocol and store it; raises `BadRequestError`."""
    document = await services.aside.call(document_of, services, body)
    protocol = read_protocol(document)
    n_steps = len(protocol.steps)
    return await services.journal.write(services.store.protocols.add, protocol.name, n_steps, document)


def document_of(services: Services, body: Json) -> Json:
    """Return the document that a request gives or means, ready to be played.

    Raises
    ------
    BadRequestError
        None of the ways to give one is used, or more than one.
    """
    given = [name for name in ("document", "standard_test", "protocol_id") if body.get(name) is not None]
    if len(given) != 1:
        raise BadRequestError("give one of document, standard_test or protocol_id", ("document",))
    bench = None if body["bench"] is None else services.benches.get(body["bench"])
    if given[0] == "protocol_id":
        return services.store.protocols.document(body["protocol_id"])
    if given[0] == "standard_test":
        bench = _needed(bench)
        window = window_of(bench.limits)
        document = build_test(body["standard_test"], body["parameters"], window, bench.config.capacity_Ah)
        return with_designs(document, window, bench.config.capacity_Ah)
    document = any_document(body["document"])
    if bench is not None:
        window = window_of(within(bench.limits, read_protocol(document).limits))
        document = with_designs(document, window, bench.config.capacity_Ah)
    return document


def look_ahead(services: Services, body: Json) -> Json:
    """Return what a protocol would do on a bench; raises `BadRequestError` where it cannot be played there."""
    bench = _needed(None if body["bench"] is None else services.benches.get(body["bench"]))
    document = document_of(services, body)
    protocol, limits, program = program_for(
        document, bench.limits, bench.config.capacity_Ah, chamber_window(bench.config)
    )
    seen = preview(program, body["initial_soc"], body["dt_s"])
    return {
        "name": protocol.name,
        "document": document,
        "steps": _steps(program),
        "limits": limits.to_json(),
        **_ahead(seen),
    }


def _needed(bench: Bench | None) -> Bench:
    if bench is None:
        raise BadRequestError("say for which bench", ("bench",))
    return bench


def _steps(program: Program) -> list[dict[str, Any]]:
    steps: dict[int, dict[str, Any]] = {}
    for place, each in enumerate(program.instructions):
        if isinstance(each, Play) and each.number not in steps:
            ends = [
                {"quantity": end.quantity, "above": end.above, "value": end.value, "over_s": end.over_s}
                for end in each.ends
            ]
            steps[each.number] = {
                "step_index": each.number,
                "name": each.name,
                "law": each.law,
                "level": each.level,
                "voltage_V": each.voltage_V or None,
                "ends": ends,
                "soak": None if each.soak is None else asdict(each.soak),
                "most_times": _most_times(program, place),
                "where": list(each.where),
            }
    return list(steps.values())


def _most_times(program: Program, place: int) -> int:
    """How often the loops around an instruction play it, unless an end leads out of them earlier."""
    ends = [(at, each) for at, each in enumerate(program.instructions) if isinstance(each, Again)]
    return math.prod(each.count for at, each in ends if each.back <= place <= at)


def _ahead(seen: Preview) -> Json:
    return {
        "duration_s": seen.duration_s,
        "stopped": seen.stopped,
        "series": {
            "time_s": seen.time_s,
            "current_A": seen.current_A,
            "voltage_V": seen.voltage_V,
            "step_count": seen.step_count,
        },
    }
