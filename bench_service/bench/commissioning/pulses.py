"""What pulses of current tell: the sign of the current, and what is connected. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from bench_service.bench.commissioning.check import Check
from bench_service.bench.plausibility import CellBand

_SIGMAS = 4.0
_LEAST_NOISE_V = 1e-4
_RESISTOR_SHARE = 0.1
_LONGEST_FOR_STEP = 3  # samples on either side of a step that its size is taken from

Window = tuple[float, float]


@dataclass(frozen=True, slots=True)
class PulseRow:
    """One sample: time in s, current in A, voltage in V, and the set-point in force in A."""

    time_s: float
    current_A: float
    voltage_V: float
    setpoint_A: float


@dataclass(frozen=True, slots=True)
class StepSize:
    """A step of the current and the voltage's answer, with the latter's standard deviation."""

    current_A: float
    voltage_V: float
    std_V: float

    @property
    def resistance_Ohm(self) -> float:
        """The answer for each ampere."""
        return self.voltage_V / self.current_A


def steps_of(rows: Sequence[PulseRow], settle_s: float) -> list[StepSize]:
    """Find the steps: the last samples before each against the first ones after it that have settled."""
    changes = [k for k in range(1, len(rows)) if rows[k].setpoint_A != rows[k - 1].setpoint_A]
    ends = [*changes[1:], len(rows)]
    found = []
    for first, end in zip(changes, ends, strict=True):
        before = rows[max(0, first - _LONGEST_FOR_STEP) : first]
        settled = [row for row in rows[first:end] if row.time_s - rows[first].time_s >= settle_s]
        after = (settled or rows[end - 1 : end])[:_LONGEST_FOR_STEP]
        noise_V = max(_noise_V(before), _noise_V(after), _LEAST_NOISE_V)
        change_A = fmean(row.current_A for row in after) - fmean(row.current_A for row in before)
        change_V = fmean(row.voltage_V for row in after) - fmean(row.voltage_V for row in before)
        found.append(StepSize(change_A, change_V, noise_V * math.sqrt(1.0 / len(before) + 1.0 / len(after))))
    return found


def _noise_V(rows: Sequence[PulseRow]) -> float:
    return stdev([row.voltage_V for row in rows]) if len(rows) > 1 else 0.0


def judge_sign(steps: Sequence[StepSize], commanded_A: Sequence[float], tolerance_A: float) -> Check:
    """Say whether the measured current follows the command, in size and sign."""
    for step, told_A in zip(steps, commanded_A, strict=True):
        if abs(step.current_A - told_A) > 2.0 * tolerance_A + 0.01 * abs(told_A):
            turned = abs(step.current_A + told_A) <= 2.0 * tolerance_A + 0.01 * abs(told_A)
            why = ": its sign is turned in the map" if turned else ""
            text = f"told to change by {told_A:+.4g} A the device measured {step.current_A:+.4g} A{why}"
            return Check("current_follows", "failed", f"{text}; check scale and sign in the map")
    shown = ", ".join(f"{step.current_A:+.4g}" for step in steps)
    return Check("current_follows", "passed", f"measured steps of {shown} A as commanded")


def judge_cell(steps: Sequence[StepSize], band: CellBand) -> Check:
    """Say whether the voltage rises with a charging current, by as much as a cell's does."""
    if doubt := _unseen(steps):
        return doubt
    resistances = [step.resistance_Ohm for step in steps]
    values = {"resistance_least_Ohm": min(resistances), "resistance_most_Ohm": max(resistances)}
    shown = f"dV/dI {min(resistances):.3g} to {max(resistances):.3g} Ohm"
    low, high = band.possible_Ohm
    if min(resistances) < 0.0:
        text = f"{shown}: the voltage falls when the cell is charged; check the current's sign in the map, and polarity"
        return Check("sign", "failed", text, values)
    if min(resistances) < low or max(resistances) > high:
        text = f"{shown}, possible for this cell are {low:.2g} to {high:.2g} Ohm; check scales, leads and contacts"
        return Check("sign", "failed", text, values)
    return Check("sign", "passed", f"{shown}: a positive current charges", values)


def judge_resistor(steps: Sequence[StepSize], resistor_Ohm: float) -> Check:
    """Say whether voltage and current have the ratio of a known resistor."""
    if doubt := _unseen(steps):
        return doubt
    value = fmean(step.resistance_Ohm for step in steps)
    values = {"resistance_Ohm": value, "stated_Ohm": resistor_Ohm}
    if abs(value - resistor_Ohm) > _RESISTOR_SHARE * resistor_Ohm:
        text = f"voltage over current is {value:.4g} Ohm where {resistor_Ohm:g} Ohm is stated"
        return Check("sign", "failed", f"{text}; check the scales in the map, the sign, and the resistor", values)
    return Check("sign", "passed", f"voltage over current is {value:.4g} Ohm ({resistor_Ohm:g} Ohm stated)", values)


def _unseen(steps: Sequence[StepSize]) -> Check | None:
    for step in steps:
        if abs(step.voltage_V) < _SIGMAS * step.std_V:
            text = f"a step of {step.current_A:+.3g} A moved the voltage by {1e3 * step.voltage_V:+.3g} mV"
            noise = f"not to be told from its noise of {1e3 * step.std_V:.2g} mV"
            return Check("sign", "failed", f"{text}, {noise}; take a larger current, or check the sense leads")
    return None if steps else Check("sign", "failed", "no step of the current was seen")
