"""Cells that share nothing with the models, measured as in a laboratory: for `diagnosis_foreign.py`.

Three truths, `particle`, `spread` and `strands`, see `simulators`. All constants are random. Three training runs of
three kinds out of five, a judged run of any kind; each log begins in the middle of an unlogged history, with a state of
charge that is stated to half a point. Sensors have noise, steps, an offset and a gain that stay; the chamber stands
still or moves.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.data.timeseries import FloatArray, TimeSeries
from simulators.cell import TruthCell
from simulators.particle_cell import ParticleCell
from simulators.particle_cells import PARTICLE_AGEING, PARTICLE_EFFECTS, random_particle_cell
from simulators.spread_cell import SpreadCell
from simulators.spread_cells import SPREAD_EFFECTS, random_spread_cell
from simulators.strand_cell import StrandCell
from simulators.strand_cells import STRAND_EFFECTS, random_strand_cell

KINDS = ("pulses", "drive", "cycles", "multisine", "stages")
LOG_S, SOC = 6000, (0.12, 0.88)
TRAIN_S = 10_000
_OUTSIDE = 0.06
_STATED_STD = 0.005


@dataclass(frozen=True)
class Truth:
    """One kind of foreign cell: how constants are drawn, what can change, and how a cell is made of constants."""

    draw: Callable[[np.random.Generator], Any]
    effects: dict[str, Callable[[Any, float], Any]]
    make: Callable[[Any, float, float], TruthCell]


TRUTHS = {
    "particle": Truth(random_particle_cell, PARTICLE_EFFECTS, ParticleCell),
    "spread": Truth(random_spread_cell, SPREAD_EFFECTS, SpreadCell),
    "strands": Truth(random_strand_cell, STRAND_EFFECTS, StrandCell),
}


@dataclass(frozen=True)
class Rig:
    """A cell's constants and the bench around it.

    Attributes
    ----------
    family, constants : of the cell
    ambient_degC, swing_K : of the chamber, which stands still where the swing is 0
    volts, amperes, kelvins : (offset, gain, noise, step) of each sensor
    soc_off : stated less true state of charge
    delay_s : by which the voltage is late
    contact_Ohm : of a contact that is bad for some minutes, now and then
    """

    family: str
    constants: Any
    ambient_degC: float
    swing_K: float
    volts: tuple[float, float, float, float]
    amperes: tuple[float, float, float, float]
    kelvins: tuple[float, float, float, float]
    soc_off: float = 0.0
    delay_s: int = 0
    contact_Ohm: float = 0.0


# What may change in the bench, by contract name: rig with a size, where 1 is large.
BENCH_EFFECTS: dict[str, Callable[[Rig, float], Rig]] = {
    "current_offset": lambda rig, x: _shifted(rig, "amperes", 0.02 * rig.constants.capacity_Ah * x),
    "dead_time": lambda rig, x: replace(rig, delay_s=max(1, round(3.0 * x))),
    "initial_soc": lambda rig, x: replace(rig, soc_off=0.08 * x),
    "temperature_sensor": lambda rig, x: _shifted(rig, "kelvins", 5.0 * x),
    "voltage_offset": lambda rig, x: _shifted(rig, "volts", 0.02 * x),
}


# Further ones, drawn only where they are asked for: what is drawn from the others stays what it was.
ASKED_EFFECTS: dict[str, Callable[[Rig, float], Rig]] = {
    "current_gain": lambda rig, x: _gained(rig, "amperes", 0.03 * x),
    "intermittent_contact": lambda rig, x: replace(rig, contact_Ohm=0.05 * x / rig.constants.capacity_Ah),
    "voltage_gain": lambda rig, x: _gained(rig, "volts", 0.01 * x),
}
ASKED_OF_CELLS: dict[str, dict[str, Callable[[Any, float], Any]]] = {
    "particle": PARTICLE_AGEING,
    "spread": {"core_temperature": lambda p, x: replace(p, core_W_per_K=p.core_W_per_K / (1.0 + 4.0 * x))},
    "strands": {},
}
# A contact is bad while the sum of two swings of these periods, s, is above a level.
_CONTACT_S, _CONTACT_LEVEL = (2300.0, 1010.0), 0.7


def contact_is_bad(time_s: FloatArray, phase: float) -> np.ndarray:
    """(n,) whether a contact that comes and goes is bad: for some minutes, now and then."""
    return np.sum([np.sin(2.0 * np.pi * time_s / each + phase) for each in _CONTACT_S], axis=0) > _CONTACT_LEVEL


def _gained(rig: Rig, sensor: str, by: float) -> Rig:
    offset, gain, *others = getattr(rig, sensor)
    return replace(rig, **{sensor: (offset, gain + by, *others)})


def _shifted(rig: Rig, sensor: str, by: float) -> Rig:
    offset, *others = getattr(rig, sensor)
    return replace(rig, **{sensor: (offset + by, *others)})


def effects_of(family: str, asked: tuple[str, ...] = ()) -> list[str]:
    """What can change in such a cell or its bench: of what is asked for, or of everything but `ASKED_EFFECTS`."""
    usual = {*TRUTHS[family].effects, *BENCH_EFFECTS}
    known = {*usual, *ASKED_EFFECTS, *ASKED_OF_CELLS[family]}
    return sorted(known & set(asked) if asked else usual)


def changed(rig: Rig, name: str, x: float) -> Rig:
    """The rig after something has changed."""
    of_bench = BENCH_EFFECTS.get(name) or ASKED_EFFECTS.get(name)
    if of_bench is not None:
        return of_bench(rig, x)
    of_cell = TRUTHS[rig.family].effects.get(name) or ASKED_OF_CELLS[rig.family][name]
    return replace(rig, constants=of_cell(rig.constants, x))


def random_rig(family: str, rng: np.random.Generator) -> Rig:
    """A cell and its bench."""
    constants = TRUTHS[family].draw(rng)
    capacity_Ah = constants.capacity_Ah
    return Rig(
        family,
        constants,
        float(rng.uniform(12.0, 32.0)),
        float(rng.choice([0.0, rng.uniform(4.0, 10.0)])),
        (
            1e-3 * rng.normal(),
            1.0 + 2e-4 * rng.normal(),
            float(rng.uniform(3e-4, 1.5e-3)),
            float(rng.choice([1e-4, 1e-3])),
        ),
        (2e-4 * capacity_Ah * rng.normal(), 1.0 + 1e-3 * rng.normal(), 3e-4 * capacity_Ah, 1e-4 * capacity_Ah),
        (0.3 * rng.normal(), 1.0, 0.05, float(rng.choice([0.01, 0.1]))),
    )


def profile_A(kind: str, capacity_Ah: float, soc: float, rng: np.random.Generator, n: int = LOG_S) -> FloatArray:
    """(n,) current of each second; it turns round at the ends of the window of SoC."""
    parts: list[FloatArray] = []
    length, falling = 0, bool(rng.random() < 0.5)
    while length < n:
        falling = False if soc < SOC[0] + 0.1 else True if soc > SOC[1] - 0.1 else falling
        part = capacity_Ah * _SEGMENTS[kind](-1.0 if falling else 1.0, rng)
        # A segment that would leave the window is cut where it does; one that begins far outside leads back as a whole,
        # for its first seconds alone may lead on.
        counted = soc + np.cumsum(part) / (3600.0 * capacity_Ah)
        inside = (counted > SOC[0]) & (counted < SOC[1])
        if SOC[0] - _OUTSIDE < soc < SOC[1] + _OUTSIDE:
            part = part[: max(30, len(part) if inside.all() else int(np.argmin(inside)))]
        parts.append(part)
        soc += float(part.sum()) / (3600.0 * capacity_Ah)
        length += len(part)
    return np.concatenate(parts)[:n]


def segment_A(kind: str, capacity_Ah: float, sign: float, rng: np.random.Generator) -> FloatArray:
    """(n,) one segment of a kind; its mean current charges (sign 1) or discharges (-1), as a rule."""
    return capacity_Ah * _SEGMENTS[kind](sign, rng)


def _pulses(sign: float, rng: np.random.Generator) -> FloatArray:
    parts = [np.repeat([s * rng.uniform(0.5, 2.0), 0.0], [int(rng.integers(8, 40)), 40]) for s in (-1.0, 1.0)]
    rate = sign * rng.uniform(0.4, 1.0)
    return np.concatenate([*parts, np.full(int(180 / abs(rate)), rate), np.zeros(int(rng.integers(100, 800)))])


def _drive(sign: float, rng: np.random.Generator) -> FloatArray:
    n = int(rng.integers(300, 900))
    noise = np.convolve(rng.standard_normal(n + 20), np.ones(12) / 3.5, mode="same")[:n]
    driven = np.clip(sign * 0.45 + 0.7 * noise, -2.5, 1.5)
    return np.where(np.convolve(rng.random(n) < 0.004, np.ones(40), mode="same") > 0.5, 0.0, driven)


def _cycles(sign: float, rng: np.random.Generator) -> FloatArray:
    rate, n = sign * rng.uniform(0.3, 1.0), int(rng.integers(600, 2400))
    taper = np.exp(-np.arange(int(rng.integers(200, 900))) / 300.0) if sign > 0.0 else np.zeros(0)
    return np.concatenate([np.full(n, rate), rate * taper, np.zeros(int(rng.integers(100, 1200)))])


def _multisine(sign: float, rng: np.random.Generator) -> FloatArray:
    n = int(rng.integers(400, 1200))
    periods, phases = np.geomspace(4.0, 400.0, 9), rng.uniform(0.0, 2.0 * np.pi, 9)
    waves = np.sin(2.0 * np.pi * np.arange(n)[:, None] / periods + phases).sum(axis=1)
    return sign * 0.3 + 0.25 * waves


def _stages(sign: float, rng: np.random.Generator) -> FloatArray:
    rates = sign * rng.uniform(-0.3, 1.2, 4) * (rng.random(4) > 0.25)
    return np.repeat(rates, rng.integers(60, 500, 4))


_SEGMENTS: dict[str, Callable[[float, np.random.Generator], FloatArray]] = {
    "pulses": _pulses,
    "drive": _drive,
    "cycles": _cycles,
    "multisine": _multisine,
    "stages": _stages,
}


@dataclass(frozen=True, eq=False)
class Plan:
    """What is played: an unlogged history and a log, from a state of charge at rest."""

    soc: float
    history_A: FloatArray
    logged_A: FloatArray
    phase: float

    def logged_soc(self, capacity_Ah: float) -> float:
        """State of charge at which the log begins."""
        return self.soc + float(self.history_A.sum()) / (3600.0 * capacity_Ah)


def make_plan(kind: str, capacity_Ah: float, rng: np.random.Generator, n: int = LOG_S) -> Plan:
    """Draw a plan whose log has n samples."""
    soc = float(rng.uniform(0.3, 0.85))
    before = profile_A(str(rng.choice(KINDS)), capacity_Ah, soc, rng, int(rng.integers(300, 3000)))
    start = soc + float(before.sum()) / (3600.0 * capacity_Ah)
    return Plan(soc, before, profile_A(kind, capacity_Ah, start, rng, n), float(rng.uniform(0.0, 2.0 * np.pi)))


def true_columns(rig: Rig, plan: Plan) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """(n,) voltage, temperature and ambient of the log without noise, and the true state of charge at its start."""
    cell = TRUTHS[rig.family].make(rig.constants, plan.soc, rig.ambient_degC)
    soc = cell.step(0.0, 0.0).soc
    for current in plan.history_A[::5]:
        soc = cell.step(float(current), 5.0).soc
    rows = []
    ambient = rig.ambient_degC + rig.swing_K * (np.sin(plan.phase + np.arange(len(plan.logged_A)) / 1500.0))
    for k, current in enumerate(plan.logged_A):
        cell.ambient_degC = float(ambient[k])  # pyright: ignore[reportAttributeAccessIssue]
        rows.append(cell.step(float(current), 1.0 if k else 0.0)[:2])
    voltage, temperature = np.array(rows).T
    return voltage, temperature, ambient, soc


def logged(rig: Rig, plan: Plan, columns: tuple[FloatArray, FloatArray, FloatArray, float], seed: int) -> TimeSeries:
    """What the sensors make of it."""
    rng = np.random.default_rng([seed, 77])
    voltage, temperature, ambient, _ = columns
    if rig.contact_Ohm:
        voltage = voltage + rig.contact_Ohm * plan.logged_A * contact_is_bad(np.arange(float(len(voltage))), seed)
    late = np.concatenate([np.full(rig.delay_s, voltage[0]), voltage])[: len(voltage)]

    def read(values: FloatArray, sensor: tuple[float, float, float, float]) -> FloatArray:
        offset, gain, noise, step = sensor
        return step * np.round((gain * values + offset + noise * rng.standard_normal(len(values))) / step)

    return TimeSeries(
        np.arange(len(voltage), dtype=np.float64),
        read(plan.logged_A, rig.amperes),
        read(late, rig.volts),
        read(temperature, rig.kelvins),
        ambient,
        name=f"{rig.family} {seed}",
    )


def stated_soc(rig: Rig, true_soc: float, seed: int) -> float:
    """State of charge that somebody believes the log to begin at."""
    return true_soc + rig.soc_off + _STATED_STD * float(np.random.default_rng([seed, 78]).normal())


def true_size(name: str, before: Rig, after: Rig, true_soc: float) -> float | None:
    """First parameter of the effect as the contract has it; None where the truth has no such number."""
    values = {
        "capacity": after.constants.capacity_Ah,
        "current_gain": after.amperes[1] / before.amperes[1] - 1.0,
        "intermittent_contact": after.contact_Ohm,
        "voltage_gain": after.volts[1] / before.volts[1] - 1.0,
        "current_offset": after.amperes[0] - before.amperes[0],
        "dead_time": float(after.delay_s - before.delay_s),
        "entropic_voltage": _slope_V_per_K(after) - _slope_V_per_K(before),
        "initial_soc": true_soc,
        "self_discharge": after.constants.leakage_A,
        "series_resistance": getattr(after.constants, "series_Ohm", None),
        "temperature_sensor": after.kelvins[0] - before.kelvins[0],
        "voltage_offset": after.volts[0] - before.volts[0],
    }
    return values.get(name)


def _slope_V_per_K(rig: Rig) -> float:
    """What the effect moves: a constant of the particle cell, both ends of the others."""
    return float(np.mean(rig.constants.entropy_V_per_K))
