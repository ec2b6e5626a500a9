"""Truth physics of one cell: equations of the simulator's own, shared with no model of the product.

Terminal voltage with positive current charging (Plett, Battery Management Systems I, 2015, chapter 2; Bernardi,
Pawlikowski and Newman, J. Electrochem. Soc. 132, 1985, for the heat):

    v = U(soc) + dU/dT (T - 25 degC) + M h + R_ohm i + v_1 + v_2 + v_slow + A asinh(i a / (2 i0)) + R_series i

with first-order states v_k of resistance R_k and time constant tau_k, one-state hysteresis dh/dt = -g |i| (h -
sign i) / Q, and one factor a on R_ohm, R_k and 1 / i0: Arrhenius in the cell's temperature, growth with throughput,
and the ratio of charge to discharge. Every state moves by the exact solution for constant current, so any step is
stable. The factor a depends on the state, and is held over sub-steps of at most `MAX_SUBSTEP_S`.
"""

import math
from typing import NamedTuple, Protocol

from simulators.cell_parameters import Branch, CellParameters

__all__ = [
    "Branch",
    "Cell",
    "CellOutput",
    "CellParameters",
    "CellState",
    "TruthCell",
    "advance",
    "initial_state",
    "observe",
]

ZERO_DEGC_K = 273.15
REFERENCE_K = 298.15
MAX_SUBSTEP_S = 1.0  # the cell warms by well under 0.1 K and moves by under 0.3 % of charge at 10C in this time
CORE_S = 120.0  # a core of some 60 J/K behind some 2 K/W (Lin et al., J. Power Sources 257, 2014)
# A contact is bad while the sum of these swings, periods in s, is above the level: for 3 to 12 min, unevenly.
CONTACT_S, CONTACT_LEVEL = (1900.0, 733.0), 0.75
SOC_SCALE = 0.15  # how far from empty the extra ohmic resistance reaches


class CellState(NamedTuple):
    """What the cell remembers; `heat_J`, `throughput_Ah` and `time_s` are counted since the start."""

    soc: float
    overpotentials_V: tuple[float, ...]
    hysteresis: float
    temperature_K: float
    throughput_Ah: float = 0.0
    heat_J: float = 0.0
    core_rise_K: float = 0.0
    time_s: float = 0.0


class CellOutput(NamedTuple):
    """Noise-free truth at the end of a step."""

    voltage_V: float
    temperature_degC: float
    soc: float
    open_circuit_V: float
    hysteresis_V: float
    heat_J: float


class TruthCell(Protocol):
    """What a cycler needs of a cell, so that another one can be handed in."""

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """Hold a current (positive charges) for a time and return the truth at its end; 0 s only looks."""
        ...


def initial_state(soc: float, temperature_degC: float) -> CellState:
    """Return a fully rested cell.

    Parameters
    ----------
    soc : float
        State of charge, 0..1.
    temperature_degC : float

    Raises
    ------
    ValueError
        If the state of charge lies outside 0..1 or the temperature is not finite.
    """
    if not 0.0 <= soc <= 1.0:
        raise ValueError(f"initial state of charge is {soc}; it must lie in 0..1")
    if not math.isfinite(temperature_degC) or temperature_degC <= -ZERO_DEGC_K:
        raise ValueError(f"initial temperature is {temperature_degC} degC; a finite one above absolute zero is needed")
    return CellState(soc, (0.0, 0.0, 0.0), 0.0, temperature_degC + ZERO_DEGC_K)


def _resistance_factor(p: CellParameters, state: CellState, current_A: float) -> float:
    factor = math.exp(p.activation_K * (1.0 / (state.temperature_K + state.core_rise_K) - 1.0 / REFERENCE_K))
    factor *= 1.0 + p.resistance_growth_per_Ah * state.throughput_Ah
    return factor * p.charge_resistance_ratio if current_A > 0.0 else factor


def _instant_V(p: CellParameters, state: CellState, current_A: float, factor: float) -> float:
    """Ohmic and charge-transfer overpotential inside the cell."""
    ohmic = p.ohmic_Ohm + p.ohmic_at_empty_Ohm * math.exp(-max(state.soc, 0.0) / SOC_SCALE)
    transfer = p.charge_transfer_V * math.asinh(current_A * factor / (2.0 * p.exchange_current_A))
    return ohmic * factor * current_A + transfer


def _branch_step(
    branch: Branch, overpotential_V: float, current_A: float, factor: float, dt_s: float
) -> tuple[float, float]:
    """Return overpotential in volt and heat in joule (integral of v^2 / R) after a constant current."""
    tau, resistance = branch.time_constant_s, branch.resistance_Ohm * factor
    end = resistance * current_A
    gap = overpotential_V - end
    decay = math.exp(-dt_s / tau)
    moved = end + gap * decay
    if resistance <= 0.0:
        return moved, 0.0
    lost = -math.expm1(-dt_s / tau) * tau
    squares = end * end * dt_s + 2.0 * end * gap * lost + 0.5 * gap * gap * lost * (1.0 + decay)
    return moved, squares / resistance


def _hysteresis_step(p: CellParameters, h: float, current_A: float, dt_s: float) -> tuple[float, float]:
    """Return the hysteresis state and its heat in joule.

    With stored energy M Q h^2 / (2 g) the Plett equation dissipates |i| M h^2, which is never negative.
    """
    if current_A == 0.0:
        return h, 0.0
    size = abs(current_A)
    target = math.copysign(1.0, current_A)
    rate = p.hysteresis_rate * size / (3600.0 * p.capacity_Ah)
    gap = h - target
    decay = math.exp(-rate * dt_s)
    lost = -math.expm1(-rate * dt_s) / rate if rate > 0.0 else dt_s
    squares = dt_s + 2.0 * target * gap * lost + 0.5 * gap * gap * lost * (1.0 + decay)
    return target + gap * decay, size * p.hysteresis_amplitude_V * squares


def _substep(p: CellParameters, state: CellState, current_A: float, ambient_K: float, dt_s: float) -> CellState:
    factor = _resistance_factor(p, state, current_A)
    v_1, heat_1 = _branch_step(p.fast_1, state.overpotentials_V[0], current_A, factor, dt_s)
    v_2, heat_2 = _branch_step(p.fast_2, state.overpotentials_V[1], current_A, factor, dt_s)
    v_3, heat_3 = _branch_step(p.slow, state.overpotentials_V[2], current_A, factor, dt_s)
    hysteresis, heat_h = _hysteresis_step(p, state.hysteresis, current_A, dt_s)
    reversible = state.temperature_K * (p.dU_dT_V_per_K + p.reversible_heat_V_per_K)
    power = current_A * (_instant_V(p, state, current_A, factor) + reversible)
    if p.leakage_A != 0.0:
        power += p.leakage_A * p.open_circuit.voltage_V(state.soc)
    heat = heat_1 + heat_2 + heat_3 + heat_h + power * dt_s
    settled_K = p.core_K_per_W * heat / dt_s
    return CellState(
        soc=state.soc + (current_A - p.leakage_A) * dt_s / (3600.0 * p.capacity_Ah),
        overpotentials_V=(v_1, v_2, v_3),
        hysteresis=hysteresis,
        temperature_K=_temperature_step_K(p, state.temperature_K, ambient_K, heat / dt_s, dt_s),
        throughput_Ah=state.throughput_Ah + abs(current_A) * dt_s / 3600.0,
        heat_J=state.heat_J + heat,
        core_rise_K=settled_K + (state.core_rise_K - settled_K) * math.exp(-dt_s / CORE_S),
        time_s=state.time_s + dt_s,
    )


def contact_is_bad(time_s: float) -> bool:
    """Whether a contact that comes and goes is bad."""
    slow_s, quick_s = CONTACT_S
    return math.sin(2.0 * math.pi * time_s / slow_s) + math.sin(2.0 * math.pi * time_s / quick_s + 1.0) > CONTACT_LEVEL


def _temperature_step_K(
    p: CellParameters, temperature_K: float, ambient_K: float, power_W: float, dt_s: float
) -> float:
    if p.heat_transfer_W_per_K <= 0.0:
        return temperature_K + power_W * dt_s / p.heat_capacity_J_per_K
    end = ambient_K + power_W / p.heat_transfer_W_per_K
    rate = p.heat_transfer_W_per_K / p.heat_capacity_J_per_K
    return end + (temperature_K - end) * math.exp(-rate * dt_s)


def advance(
    parameters: CellParameters, state: CellState, current_A: float, ambient_degC: float, dt_s: float
) -> CellState:
    """Hold a current for a time.

    Parameters
    ----------
    parameters : CellParameters
    state : CellState
    current_A : float
        Positive charges; finite.
    ambient_degC : float
    dt_s : float
        Not negative; split into equal sub-steps of at most `MAX_SUBSTEP_S`.

    Returns
    -------
    CellState
        Exact where resistances do not move with temperature, charge or throughput; elsewhere first order in the
        sub-step.
    """
    if dt_s <= 0.0:
        return state
    ambient_K = ambient_degC + ZERO_DEGC_K
    if dt_s <= MAX_SUBSTEP_S:
        return _substep(parameters, state, current_A, ambient_K, dt_s)
    count = math.ceil(dt_s / MAX_SUBSTEP_S)
    for _ in range(count):
        state = _substep(parameters, state, current_A, ambient_K, dt_s / count)
    return state


def observe(parameters: CellParameters, state: CellState, current_A: float) -> CellOutput:
    """Return the terminal quantities in volt and degC while a current flows."""
    p = parameters
    factor = _resistance_factor(p, state, current_A)
    open_circuit = p.open_circuit.voltage_V(state.soc) + p.dU_dT_V_per_K * (state.temperature_K - REFERENCE_K)
    hysteresis = p.hysteresis_amplitude_V * state.hysteresis
    v_1, v_2, v_3 = state.overpotentials_V
    inner = _instant_V(p, state, current_A, factor) + v_1 + v_2 + v_3
    outer_Ohm = p.series_resistance_Ohm + (p.contact_Ohm if contact_is_bad(state.time_s) else 0.0)
    return CellOutput(
        voltage_V=open_circuit + hysteresis + inner + outer_Ohm * current_A,
        temperature_degC=state.temperature_K - ZERO_DEGC_K,
        soc=state.soc,
        open_circuit_V=open_circuit,
        hysteresis_V=hysteresis,
        heat_J=state.heat_J,
    )


class Cell:
    """A cell with its state, for callers that play a current in time.

    Parameters
    ----------
    parameters : CellParameters
    soc : float
        State of charge at the start, 0..1.
    ambient_degC : float
        Constant ambient temperature; the cell starts at it.
    """

    def __init__(self, parameters: CellParameters, soc: float = 0.5, ambient_degC: float = 25.0) -> None:
        self.parameters = parameters
        self.ambient_degC = ambient_degC
        self.state = initial_state(soc, ambient_degC)

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """Hold `current_A` (positive charges) for `dt_s` and return the noise-free truth at its end.

        Raises
        ------
        ValueError
            If the current is not finite or the time negative or not finite.
        """
        if not (math.isfinite(current_A) and 0.0 <= dt_s < math.inf):
            raise ValueError(f"cell step: current {current_A} A for {dt_s} s; finite values and time >= 0 are needed")
        self.state = advance(self.parameters, self.state, current_A, self.ambient_degC, dt_s)
        return observe(self.parameters, self.state, current_A)
