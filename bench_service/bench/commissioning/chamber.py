"""The temperature chamber in a commissioning: who it is, and whether what it shows can be true."""

from dataclasses import replace

from bench_service.bench.chamber.keeper import ChamberKeeper
from bench_service.bench.commissioning.check import Check, Report, failed
from drivers.cycler import IDENTITY


async def with_chamber(report: Report, keeper: ChamberKeeper) -> Report:
    """Return a report that also tells of the bench's chamber, where it has one; nothing is written to it."""
    if keeper.settings is None or report.state in ("refused", "stopped"):
        return report
    await keeper.answers()
    check, identity = _check(keeper), keeper.identity
    said = {} if identity is None else {key: identity.said.get(key, "") for key in IDENTITY}
    told = replace(report, checks=(*report.checks, check), chamber=said)
    if report.state == "failed" or (reason := failed((check,))) is None:
        return told
    return replace(told, state="failed", reason=reason)


def _check(keeper: ChamberKeeper) -> Check:
    assert keeper.settings is not None  # noqa: S101  # asked before
    reading, identity = keeper.reading, keeper.identity
    if reading is None or identity is None:
        return Check("chamber", "failed", "the temperature chamber does not answer; runs are refused")
    shown = ", ".join(f"{name} {value}" for name, value in identity.said.items() if value) or "says nothing of itself"
    text = f"{identity.name}: {shown}; its air is {reading.temperature_degC:.4g} degC"
    values = {"ambient_degC": reading.temperature_degC}
    low, high = keeper.settings.air_degC
    if reading.alarms:
        return Check("chamber", "failed", f"{text}; it reports {', '.join(sorted(reading.alarms))}", values)
    if not low <= reading.temperature_degC <= high:
        return Check("chamber", "failed", f"{text}, but allowed are {low:g} to {high:g} degC: check its map", values)
    return Check("chamber", "passed", text, values)
