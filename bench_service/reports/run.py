"""Report of a run: what was decided, what was measured, what happened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.reports import words
from bench_service.reports.document import Heading, Key, Keys, Part, Points, Report, Section, Table
from bench_service.reports.drawing import BLUE, GREEN, GREY, RUST, Axis, Line, curves, level
from bench_service.reports.free_run import TIME
from bench_service.store.records import IMPORTED, EventRecord, RunRecord

_MOST_EVENTS, _MOST_CYCLES = 40, 200
_BAND_95 = 1.96
_HOUR_S = 3600.0
_SEVERITIES = {"info": "", "warning": "warning", "error": "error"}
_VERIFIED = {
    "missing": "The bench's hardware was not commissioned.",
    "failed": "The bench's hardware had failed its commissioning.",
    "void": "The bench's hardware is not the one that was commissioned.",
    "simulated": "The bench was simulated.",
}

Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Measured:
    """What was stored of a run.

    Attributes
    ----------
    samples, observer : columns of the streams; empty where there is none
    cycles : what each has moved
    events : what happened, the oldest first
    damage : what is missing of the samples; None: nothing
    """

    samples: Columns
    observer: Columns = field(default_factory=dict)
    cycles: Sequence[Mapping[str, Any]] = ()
    events: Sequence[EventRecord] = ()
    damage: str | None = None


def run_report(heading: Heading, run: RunRecord, measured: Measured) -> Report:
    """Put the report together."""
    sections = [Section("Course of the run", _course(run, measured))]
    if len(measured.cycles) > 1:
        sections.append(Section("Cycles", _cycles(measured.cycles)))
    sections.append(Section("Start" if run.bench == IMPORTED else "Limits it was held to", [_limits(run)]))
    if measured.events:
        sections.append(Section("What happened", _events(measured.events)))
    return Report(heading, _summary(run, measured), sections)


def _summary(run: RunRecord, measured: Measured) -> list[Part]:
    state = words.state(run.state).capitalize()
    said = [words.sentence(f"{state}: {words.told(run.reason)}" if run.reason else state)]
    hardware = (run.commissioning or {}).get("state")
    if hardware in _VERIFIED:
        said.append(_VERIFIED[hardware])
    if run.missed_ticks:
        said.append(f"{words.count(run.missed_ticks)} samples were not taken in time and are not there.")
    damage = measured.damage or run.damage
    if damage is not None:
        said.append(f"Stored samples are missing: {words.told(damage)}.")
    if run.continues is not None:
        said.append(f"It goes on from run {run.continues[:8]}.")
    parts: list[Part] = [Keys(_keys(run, measured.samples)), Points(said)]
    return [*parts, f"Notes: {run.notes}"] if run.notes else parts


def _keys(run: RunRecord, samples: Columns) -> list[Key]:
    samples_text = f"{words.count(run.n_samples)} samples, one each {words.duration(run.dt_s)}"
    if not len(samples.get("time_s", ())):
        return [Key("Samples", words.count(run.n_samples or 0))]
    keys = [Key("Duration", words.duration(float(samples["time_s"][-1])), samples_text)]
    charged, discharged, energy = _moved(samples)
    keys.append(Key("Charged", words.quantity(charged, "Ah"), f"discharged {words.quantity(discharged, 'Ah')}"))
    keys.append(Key("Energy into the cell", words.quantity(energy, "Wh"), "charged less discharged"))
    for name, title, unit in (("voltage_V", "Voltage", "V"), ("temperature_degC", "Temperature", "degC")):
        values = samples.get(name)
        if values is not None and np.isfinite(values).any():
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            keys.append(Key(title, words.between(name, (low, high), unit), "lowest to highest"))
    return keys


def _moved(samples: Columns) -> tuple[float, float, float]:
    """Charge in, charge out and energy in, each sample's current held to the next."""
    hours = np.diff(samples["time_s"], append=samples["time_s"][-1]) / _HOUR_S
    current, voltage = np.nan_to_num(samples["current_A"]), np.nan_to_num(samples["voltage_V"])
    charged = float((np.clip(current, 0.0, None) * hours).sum())
    discharged = float((np.clip(-current, 0.0, None) * hours).sum())
    return charged, discharged, float((current * voltage * hours).sum())


def _course(run: RunRecord, measured: Measured) -> list[Part]:
    samples, observer = measured.samples, measured.observer
    if not len(samples.get("time_s", ())):
        return ["No sample is stored."]
    hours = samples["time_s"] / _HOUR_S
    voltage = [Line("measured", hours, samples["voltage_V"], None, BLUE)]
    voltage += [level(f"limit {words.number(edge)} V", hours, edge) for edge in _held(run).get("voltage_V") or ()]
    parts: list[Part] = [
        curves("Voltage", voltage, TIME, Axis("voltage", "V")),
        curves("Current", [Line("", hours, samples["current_A"], None, RUST)], TIME, Axis("current", "A")),
    ]
    heat = [
        Line(label, hours, samples[name], None, colour)
        for name, label, colour in (("temperature_degC", "cell", RUST), ("ambient_degC", "ambient", GREY))
        if name in samples and np.isfinite(samples[name]).any()
    ]
    if heat:
        parts.append(curves("Temperature", heat, TIME, Axis("temperature", "°C")))
    soc = [Line("charge counted from the stated start", hours, 100.0 * _counted(run, samples), None, GREY)]
    if len(observer.get("time_s", ())):
        band = 100.0 * _BAND_95 * observer["soc_std"] if "soc_std" in observer else None
        at = observer["time_s"] / _HOUR_S
        soc.append(Line("live observer, with 95 % band", at, 100.0 * observer["soc"], band, GREEN))
    parts.append(curves("State of charge", soc, TIME, Axis("state of charge", "%")))
    return parts


def _counted(run: RunRecord, samples: Columns) -> NDArray[Any]:
    hours = np.diff(samples["time_s"], prepend=samples["time_s"][0]) / _HOUR_S
    held = np.concatenate([[0.0], np.nan_to_num(samples["current_A"])[:-1]])
    return run.initial_soc + np.cumsum(held * hours) / run.capacity_Ah


def _cycles(cycles: Sequence[Mapping[str, Any]]) -> list[Part]:
    number = np.array([float(each["cycle_count"]) for each in cycles])
    lines = [
        Line(name, number, np.array([float(each[key]) for each in cycles]), None, colour, dots=len(cycles) < 60)
        for key, name, colour in (("charged_Ah", "charged", BLUE), ("discharged_Ah", "discharged", RUST))
    ]
    rows = [
        (
            f"{each['cycle_count']}{', begun part charged' if each['begun_part_charged'] else ''}",
            words.duration(each["duration_s"]),
            words.quantity(each["charged_Ah"], "Ah", digits=4),
            words.quantity(each["discharged_Ah"], "Ah", digits=4),
            words.percent(each["coulombic_efficiency"], 2),
            words.percent(each["energy_efficiency"], 1),
        )
        for each in cycles[:_MOST_CYCLES]
    ]
    heads = ("Cycle", "Duration", "Charged", "Discharged", "Charge out of charge in", "Energy out of energy in")
    parts: list[Part] = [curves("Charge of each cycle", lines, Axis("cycle"), Axis("charge", "Ah")),
                         Table(heads, rows, frozenset(range(6)))]  # fmt: skip
    if len(cycles) > _MOST_CYCLES:
        parts.append(f"The first {_MOST_CYCLES} of {len(cycles)} cycles.")
    return parts


def _held(run: RunRecord) -> Mapping[str, Any]:
    """Limits that a run was held to: nobody knows those of one that was brought in from a file."""
    return {} if run.bench == IMPORTED else run.limits


def _limits(run: RunRecord) -> Table:
    limits = _held(run)
    titles = (
        ("voltage_V", "Voltage", "V"),
        ("current_A", "Current", "A"),
        ("temperature_degC", "Temperature", "degC"),
        ("soc", "State of charge", "1"),
    )
    rows = [(title, words.between(name, limits[name], unit)) for name, title, unit in titles
            if limits.get(name) is not None]  # fmt: skip
    if limits.get("ramp_A_per_s") is not None:
        rows.append(("Change of the current", f"{words.number(limits['ramp_A_per_s'])} A/s"))
    if limits.get("duration_s") is not None:
        rows.append(("Duration", words.duration(limits["duration_s"])))
    rows.append(("Capacity that charge was counted on", words.quantity(run.capacity_Ah, "Ah")))
    rows.append(("State of charge at the start, as stated", words.percent(run.initial_soc, 1)))
    heads = ("What", "As stated") if run.bench == IMPORTED else ("Limit", "Allowed")
    return Table(heads, rows, frozenset({1}))


def _events(events: Sequence[EventRecord]) -> list[Part]:
    rows = [
        (words.moment(each.created_utc).removesuffix(" UTC"), _SEVERITIES[each.severity], words.told(each.text))
        for each in events[:_MOST_EVENTS]
    ]
    parts: list[Part] = [Table(("When, UTC", "", "What"), rows)]
    return [*parts, f"The first {_MOST_EVENTS} of {len(events)} events."] if len(events) > _MOST_EVENTS else parts
