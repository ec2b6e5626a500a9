"""All rules together: one state, one step for each fresh sample."""

import math
from dataclasses import dataclass, replace

from bench_service.bench.plausibility import jumps, response, stillness, throughput, warmth
from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.jumps import Jumps
from bench_service.bench.plausibility.response import Response
from bench_service.bench.plausibility.sample import Sample
from bench_service.bench.plausibility.stillness import Stillness
from bench_service.bench.plausibility.throughput import Throughput
from bench_service.bench.plausibility.warmth import Warmth


@dataclass(frozen=True, slots=True)
class Watch:
    """What the rules remember.

    Parameters
    ----------
    last : Sample or None
    response, stillness, jumps, warmth, throughput
        Of the rules of these names.
    """

    last: Sample | None = None
    response: Response = Response()
    stillness: Stillness = Stillness()
    jumps: Jumps = Jumps()
    warmth: Warmth = Warmth()
    throughput: Throughput = Throughput()


def observe(watch: Watch, band: CellBand, now: Sample, least_A: float) -> tuple[Watch, Finding | None]:
    """Take one fresh sample.

    Parameters
    ----------
    watch : Watch
    band : CellBand
    now : Sample
        Later than the one before; one with a missing value is passed over.
    least_A : float
        Steps of the current below it are noise.

    Returns
    -------
    The watch after it, and the worst finding: a trip before a warning.
    """
    if not math.isfinite(now.voltage_V + now.current_A + now.temperature_degC):
        return watch, None
    before = watch.last
    if before is None:
        return replace(watch, last=now), None
    answer = response.follow(watch.response, band, before, now, least_A)
    held = stillness.follow(watch.stillness, band, before, now)
    jumped = jumps.follow(watch.jumps, band, watch.response, before, now)
    warm = warmth.follow(watch.warmth, band, answer, before, now)
    moved = throughput.follow(watch.throughput, before, now)
    findings = [
        jumps.judge(watch.jumps, jumped, band),
        stillness.judge(held, now, least_A),
        response.judge(answer, band),
        warmth.judge(warm, now),
        throughput.judge(moved, band),
    ]
    found = [finding for finding in findings if finding is not None]
    worst = next((finding for finding in found if finding.stage == "trip"), found[0] if found else None)
    return Watch(now, answer, held, jumped, warm, moved), worst
