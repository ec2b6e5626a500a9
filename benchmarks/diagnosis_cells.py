"""Blind cases for the diagnosis: random simulated cells, profiles, and effects of random size.

Used by `diagnosis_change.py` and `diagnosis_structure.py`. Every case is made from one seed: a cell with all its
parameters moved at random around a default one, a training run, and one or more runs of the same cell after something
in the cell or in its sensors has changed. Nothing but the records is given to the diagnosis.
"""

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray, TimeSeries
from models.design import StepProfileRequest, step_profile
from models.effects import effects
from simulators.catalogue import cell_type
from simulators.cell import Branch, Cell, CellParameters
from simulators.effects import apply_effects
from simulators.hidden_effect import SIZES, Size, own_value
from simulators.sensors import SensorParameters, Sensors

DT_S = 1.0
PROFILES = ("designed", "pulses", "load")
CHEMISTRIES = ("nmc", "lfp")
SOC = (0.1, 0.9)
_SPREAD = (0.7, 1.4)
# Amperes per ampere-hour.
_DISCHARGE_C, _CHARGE_C = 2.0, 1.0
_REST_BEFORE_S = 60


@dataclass(frozen=True)
class Rig:
    """A cell with its sensors and what neither parameters nor sensors of the simulator can express.

    Attributes
    ----------
    stated_soc_error : stated less true SoC at the start
    delay_s : by which the voltage comes late
    """

    cell: CellParameters
    sensors: SensorParameters
    stated_soc_error: float = 0.0
    delay_s: float = 0.0


def random_cell(chemistry: str, rng: np.random.Generator) -> CellParameters:
    """A default cell with its parameters moved at random."""
    p = cell_type(chemistry).parameters

    def moved(value: float) -> float:
        return value * float(np.exp(rng.uniform(*np.log(_SPREAD))))

    def branch(each: Branch) -> Branch:
        return Branch(moved(each.resistance_Ohm), moved(each.time_constant_s))

    return replace(
        p,
        ohmic_Ohm=moved(p.ohmic_Ohm),
        ohmic_at_empty_Ohm=moved(p.ohmic_at_empty_Ohm),
        fast_1=branch(p.fast_1),
        fast_2=branch(p.fast_2),
        slow=branch(p.slow),
        hysteresis_amplitude_V=moved(p.hysteresis_amplitude_V),
        hysteresis_rate=moved(p.hysteresis_rate),
        exchange_current_A=moved(p.exchange_current_A),
        activation_K=moved(p.activation_K),
        dU_dT_V_per_K=moved(p.dU_dT_V_per_K),
        heat_capacity_J_per_K=moved(p.heat_capacity_J_per_K),
        heat_transfer_W_per_K=moved(p.heat_transfer_W_per_K),
    )


def current_A(
    profile: str, capacity_Ah: float, initial_soc: float, duration_s: float, rng: np.random.Generator
) -> FloatArray:
    """(n,) current of each second; sample k is what flows until it."""
    if profile == "designed":
        request = StepProfileRequest(
            capacity_Ah=capacity_Ah,
            current_A=(-_DISCHARGE_C * capacity_Ah, _CHARGE_C * capacity_Ah),
            soc=SOC,
            initial_soc=initial_soc,
            duration_s=duration_s,
            dt_s=DT_S,
        )
        plan = step_profile(request, rng)
        grid_s = np.arange(round(plan.duration_s / DT_S)) * DT_S
        held = plan.current_A[np.searchsorted(plan.time_s, grid_s + 0.5 * DT_S, side="right") - 1]
        return np.concatenate([np.zeros(1 + _REST_BEFORE_S), held])
    segment = _pulses if profile == "pulses" else _load
    out: list[FloatArray] = [np.zeros(1 + _REST_BEFORE_S)]
    soc, falling = initial_soc, True
    length = 0
    while length < duration_s:
        if soc < SOC[0] + 0.05:
            falling = False
        if soc > SOC[1] - 0.05:
            falling = True
        part = segment(capacity_Ah, falling, rng)
        out.append(part)
        soc += float(part.sum()) * DT_S / (3600.0 * capacity_Ah)
        length += len(part)
    return np.concatenate(out)[: round(duration_s / DT_S)]


def _pulses(capacity_Ah: float, falling: bool, rng: np.random.Generator) -> FloatArray:
    """Pulses of both signs with rests, then a move of the charge."""
    parts = []
    for sign in (-1.0, 1.0):
        limit = _DISCHARGE_C if sign < 0 else _CHARGE_C
        parts += [np.full(int(rng.integers(10, 40)), sign * rng.uniform(0.3, 1.0) * limit), np.zeros(60)]
    rate = -rng.uniform(0.4, 1.0) * _DISCHARGE_C if falling else rng.uniform(0.5, 1.0) * _CHARGE_C
    parts += [np.full(int(0.05 * 3600 / abs(rate)), rate), np.zeros(int(rng.integers(200, 900)))]
    return capacity_Ah * np.concatenate(parts)


def _load(capacity_Ah: float, falling: bool, rng: np.random.Generator) -> FloatArray:
    """A stretch of driving with recuperation, or of charging, with a pause now and then."""
    if not falling:
        part = np.full(int(rng.integers(300, 900)), rng.uniform(0.4, 1.0) * _CHARGE_C)
        return capacity_Ah * np.concatenate([part, np.zeros(int(rng.integers(30, 600)))])
    steps = [
        np.full(int(rng.integers(3, 40)), np.clip(rng.normal(-0.5, 0.6), -_DISCHARGE_C, 0.6 * _CHARGE_C))
        for _ in range(30)
    ]
    pause = [np.zeros(int(rng.integers(100, 900)))] if rng.uniform() < 0.4 else []
    return capacity_Ah * np.concatenate([*steps, *pause])


def chamber_degC(moves: bool, n: int, rng: np.random.Generator) -> FloatArray:
    """(n,) chamber temperature: constant, or steps between 10 and 40 degC every hour."""
    if not moves:
        return np.full(n, 25.0)
    levels = rng.permutation(np.linspace(10.0, 40.0, 5))
    target = levels[(np.arange(n) // 3600) % len(levels)]
    # A chamber needs minutes to get there.
    keep, out = np.exp(-DT_S / 300.0), np.empty(n)
    out[0] = 25.0
    for k in range(1, n):
        out[k] = target[k] + (out[k - 1] - target[k]) * keep
    return out


def play(
    rig: Rig, current: FloatArray, chamber: FloatArray, initial_soc: float, rng: np.random.Generator, name: str
) -> TimeSeries:
    """Measure one run."""
    sensors = Sensors(rig.sensors, rng)
    outputs = _outputs(Cell(rig.cell, initial_soc, float(chamber[0])), current, chamber)
    if rig.delay_s:
        outputs = _late(outputs, rig.delay_s)
    read = np.array(
        [
            sensors.measure(output, each, ambient)
            for output, each, ambient in zip(outputs, current.tolist(), chamber.tolist(), strict=True)
        ]
    )
    stated = np.full(len(current), np.nan)
    stated[0] = initial_soc + rig.stated_soc_error
    time_s = np.arange(len(current)) * DT_S
    return TimeSeries(time_s, read[:, 1], read[:, 0], read[:, 2], read[:, 3], stated, name)


def begun_late(run: TimeSeries, capacity_Ah: float, start_s: float) -> tuple[TimeSeries, float]:
    """A log that begins somewhere in a run, with the state of charge that a person counts for its first sample."""
    first = round(start_s / DT_S)
    counted_Ah = float(np.sum(run.current_A[1 : first + 1])) * DT_S / 3600.0
    assert run.soc_ref is not None
    stated = np.full(len(run) - first, np.nan)
    stated[0] = run.soc_ref[0] + counted_Ah / capacity_Ah
    time_s = run.time_s[first:] - run.time_s[first]
    ambient = None if run.ambient_degC is None else run.ambient_degC[first:]
    later = TimeSeries(
        time_s, run.current_A[first:], run.voltage_V[first:], run.temperature_degC[first:], ambient, stated, run.name
    )
    return later, float(stated[0])


def _late(outputs: list, delay_s: float) -> list:
    """Voltages between two samples, as a sensor that reads `delay_s` late sees them."""
    share = delay_s / DT_S
    whole = int(np.ceil(share))
    out = []
    for k in range(len(outputs)):
        later, earlier = outputs[max(k - whole + 1, 0)], outputs[max(k - whole, 0)]
        weight = whole - share
        voltage = weight * later.voltage_V + (1.0 - weight) * earlier.voltage_V
        out.append(outputs[k]._replace(voltage_V=voltage))
    return out


def seen_as(rig: Rig, current: FloatArray, chamber: FloatArray, initial_soc: float, other: Rig) -> FloatArray:
    """(n,) noise-free voltage that a perfect model of `rig` gives for what the sensors of `other` read."""
    cell = Cell(rig.cell, float(np.clip(initial_soc + other.stated_soc_error, 0.0, 1.0)), float(chamber[0]))
    read = (1.0 + other.sensors.current_gain) * current + other.sensors.current_offset_A
    return np.array(_outputs(cell, read, chamber))[:, 0]


def true_V(rig: Rig, current: FloatArray, chamber: FloatArray, initial_soc: float) -> tuple[FloatArray, FloatArray]:
    """(n,) noise-free voltage as a sensor with the rig's offset and delay reads it, and (n,) temperature reading."""
    outputs = _outputs(Cell(rig.cell, initial_soc, float(chamber[0])), current, chamber)
    if rig.delay_s:
        outputs = _late(outputs, rig.delay_s)
    values = np.array(outputs)[:, :2]
    rise = rig.sensors.temperature_gain * (values[:, 1] - chamber) + rig.sensors.temperature_offset_K
    return (1.0 + rig.sensors.voltage_gain) * values[:, 0] + rig.sensors.voltage_offset_V, chamber + rise


def _outputs(cell: Cell, current: FloatArray, chamber: FloatArray) -> list:
    outputs = []
    for k, (each, ambient) in enumerate(zip(current.tolist(), chamber.tolist(), strict=True)):
        cell.ambient_degC = ambient
        outputs.append(cell.step(each, DT_S if k else 0.0))
    return outputs


# Effects that no parameter of the simulated cell or of its sensors stands for.
RIG_SIZES = {
    "dead_time": Size(0.2, 1.5),
    "initial_soc": Size(0.01, 0.06, sign="either"),
    "ocv_shape": Size(0.02, 0.08, sign="either"),
}
ALL_SIZES = {**SIZES, **RIG_SIZES}
THERMAL = {name for name, effect in effects().items() if effect.warmth is not None}
CHAMBER_MOVES = {name for name, effect in effects().items() if effect.needs_temperature}


def changed(rig: Rig, name: str, x: float) -> Rig:
    """The rig with an effect of a signed size."""
    if name == "dead_time":
        return replace(rig, delay_s=x)
    if name == "initial_soc":
        return replace(rig, stated_soc_error=-x)
    if name == "ocv_shape":
        curve = rig.cell.open_circuit
        step = replace(curve.steps[0], centre=curve.steps[0].centre + x)
        return replace(rig, cell=replace(rig.cell, open_circuit=replace(curve, steps=(step, *curve.steps[1:]))))
    value = SIZES[name].value(x, own_value(name, rig.cell), rig.cell.capacity_Ah)
    cell, sensors = apply_effects(rig.cell, rig.sensors, {name: value})
    return replace(rig, cell=cell, sensors=sensors)


def true_parameter(name: str, before: Rig, after: Rig, x: float) -> float:
    """What the diagnosis should give as the effect's primary parameter, in the unit of the public contract."""
    if name == "capacity":
        return after.cell.capacity_Ah
    if name == "heat_transfer":
        return after.cell.heat_transfer_W_per_K
    if name in ("charge_transfer", "relaxation"):
        return own_value(name, after.cell) - own_value(name, before.cell)
    size = ALL_SIZES[name]
    return x * (before.cell.capacity_Ah if size.per == "capacity" else 1.0)
