"""The resistance seen t seconds after a step of the current, to be compared with a pulse of that length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network import signals
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import run_recursion, sensitivity_block
from models.network.regression import VOLTAGE, axis_lag, normalise
from models.readouts.steady_state import OperatingPoints, settled_voltage, standard_deviation
from models.uncertainty.spread import LocalFactor


@dataclass(frozen=True)
class StepResponse:
    """Resistance over the time since a step of the current.

    Attributes
    ----------
    soc, temperature_degC : where the step was made
    from_A, to_A : the step
    direction_before : direction of the current that the cell had settled from
    time_s : (n,) multiples of the model's sampling time, from the first one after the step on
    resistance_Ohm : (n,) (V(t) - V(0)) / (to_A - from_A)
    std_Ohm : (n,) or None where no parameter covariance was given
    reservations : what a person should know before trusting the numbers
    """

    soc: float
    temperature_degC: float
    from_A: float
    to_A: float
    direction_before: float
    time_s: FloatArray
    resistance_Ohm: FloatArray
    std_Ohm: FloatArray | None = None
    reservations: tuple[str, ...] = ()

    def at(self, time_s: float) -> float:
        """Resistance in ohm after a time.

        Raises
        ------
        ModelError
            The time lies before the first sample after the step or beyond the last: the model does not show it.
        """
        if not self.time_s[0] * (1.0 - 1e-9) <= time_s <= self.time_s[-1] * (1.0 + 1e-9):
            raise ModelError(
                f"step response: {time_s:g} s lies outside {self.time_s[0]:g}..{self.time_s[-1]:g} s; "
                "the model's sampling time is the shortest that it can show"
            )
        return float(np.interp(time_s, self.time_s, self.resistance_Ohm))

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {
            "schema_version": 1,
            "kind": "step_response",
            "soc": self.soc,
            "temperature_degC": self.temperature_degC,
            "from_A": self.from_A,
            "to_A": self.to_A,
            "direction_before": self.direction_before,
            "time_s": self.time_s.tolist(),
            "resistance_Ohm": self.resistance_Ohm.tolist(),
            "std_Ohm": None if self.std_Ohm is None else self.std_Ohm.tolist(),
            "reservations": list(self.reservations),
        }


@dataclass(frozen=True, kw_only=True)
class CurrentStep:
    """A step of the current, from a settled state.

    Attributes
    ----------
    soc : fraction, held
    to_A, from_A : currents after and before the step, positive charges
    temperature_degC : held
    direction_before : +1 or -1; by default that of `from_A`, or of `to_A` where the step begins at rest, which leaves
        hysteresis out of the resistance. A pulse against the last direction shows hysteresis as resistance: give that
        direction for it
    soc_moves : let the SoC follow the current, as it does in a real pulse
    """

    soc: float
    to_A: float
    temperature_degC: float = 25.0
    from_A: float = 0.0
    direction_before: float | None = None
    soc_moves: bool = False

    @property
    def before(self) -> float:
        """Direction of the current that the cell had settled from."""
        return float(np.sign(self.from_A or self.to_A)) if self.direction_before is None else self.direction_before

    @property
    def change_A(self) -> float:
        """Height of the step."""
        return self.to_A - self.from_A


def step_response(
    network: LocalModelNetwork, step: CurrentStep, duration_s: float, local: LocalFactor | None = None
) -> StepResponse:
    """Run the network's recursion through a step of the current, from a settled state.

    Parameters
    ----------
    network : any structure
    step : where, from which current to which
    duration_s : how long to run; rounded up to samples
    local : factor of the covariance of the network's parameters in normalised units, for the band

    Returns
    -------
    StepResponse

    Raises
    ------
    ModelError
        The step is none, the time is not positive, or the network does not settle where the step begins.
    """
    if step.to_A == step.from_A or not duration_s > 0.0:
        raise ModelError(f"step response: from {step.from_A:g} A to {step.to_A:g} A for {duration_s:g} s is no step")
    order, dt_s = network.structure.output_order, network.structure.dt_s
    n = int(np.ceil(duration_s / dt_s - 1e-9))
    start = settled_voltage(network, OperatingPoints.grid(step.soc, step.from_A, step.before, step.temperature_degC))
    if np.isnan(start.voltage_V[0]):
        raise ModelError(f"step response: the network does not settle at {step.from_A:g} A, SoC {step.soc:g}")
    # As many settled samples before the step as the recursion needs past outputs; sample `lead` is the first after it.
    lead = max(order, 1)
    since = np.maximum(np.arange(lead + n) - lead + 1, 0)
    u, z = _regressors(
        network, since, step.soc, step.from_A, step.to_A, step.before, step.temperature_degC, step.soc_moves
    )
    y0 = float(normalise(start.voltage_V, network.scaling[VOLTAGE])[0])
    run = _run(network, u, network.partition.validity(z), y0)
    resistance = network.voltage_span_V * (run.y[lead:] - y0) / step.change_A
    std = None if local is None else _std(network, run, start.gradient_V[0], lead, step.change_A, local)
    return StepResponse(
        step.soc,
        step.temperature_degC,
        step.from_A,
        step.to_A,
        step.before,
        dt_s * np.arange(1, n + 1),
        resistance,
        std,
        tuple(_reservations(resistance)),
    )


class _Run(NamedTuple):
    """The recursion through the step: regressors, validity, blended output coefficients, outputs; normalised."""

    u: FloatArray
    validity: FloatArray
    a: FloatArray
    y: FloatArray


def _run(network: LocalModelNetwork, u: FloatArray, validity: FloatArray, y0: float) -> _Run:
    order, blended = network.structure.output_order, validity @ network.theta
    a, f = np.ascontiguousarray(blended[:, :order]), np.einsum("kp,kp->k", blended[:, order:], u)
    return _Run(u, validity, a, run_recursion(a, f, np.full(len(u), y0), np.array([0])))


def _std(
    network: LocalModelNetwork,
    run: _Run,
    gradient_V: FloatArray,
    lead: int,
    change_A: float,
    local: LocalFactor,
) -> FloatArray:
    """(n,) standard deviation of the resistance; `gradient_V` is that of the settled voltage before the step."""
    settled, n = gradient_V / network.voltage_span_V, len(run.y) - lead
    carry, rows = np.tile(settled, (lead, 1)), np.empty((n, len(settled)))
    sensitivity_block(lead, run.validity, run.u, run.y, run.a, np.zeros(len(run.y), np.uint8), carry, rows)
    return standard_deviation(network.voltage_span_V / change_A * (rows - settled), local)


def _regressors(
    network: LocalModelNetwork,
    since: np.ndarray,
    soc: float,
    from_A: float,
    to_A: float,
    before: float,
    temperature_degC: float,
    soc_moves: bool,
) -> tuple[FloatArray, FloatArray]:
    """Input taps and partition variables around the step; `since` counts samples from the step, 0 before it."""
    structure, cell, dt_s = network.structure, network.cell, network.structure.dt_s
    stepped = since > 0
    current, temperature = np.where(stepped, to_A, from_A), np.full(len(since), temperature_degC)
    turned = float(np.sign(to_A)) if abs(to_A) > cell.rest_A else before
    per_sample = to_A * dt_s / (3600.0 * cell.capacity_Ah)
    counted = soc + (since * per_sample * (cell.efficiency if to_A > 0.0 else 1.0) if soc_moves else 0.0 * since)
    direction = np.where(stepped, turned, before)
    step = signals.Step(current, temperature, counted, direction, since, dt_s, cell.capacity_Ah)
    parsed = [signals.parse_signal(name) for name in structure.signals]
    physical = {each.name: each.definition.after_step(each, step) for each in parsed}
    value = {name: normalise(values, network.scaling[name]) for name, values in physical.items()}
    columns = [_delayed(value[signal], lag) for signal, lag in structure.taps()]
    u = np.column_stack([*columns, np.ones(len(since))])
    z = np.column_stack([_delayed(value[axis.signal], axis_lag(axis.signal)) for axis in structure.axes])
    return u, z


def _delayed(values: FloatArray, lag: int) -> FloatArray:
    """Return values(k - lag); the first value is the settled one."""
    return values[np.maximum(np.arange(len(values)) - lag, 0)]


def _reservations(resistance: FloatArray) -> list[str]:
    if np.isnan(resistance).any() or (resistance <= 0.0).any():
        return [f"resistance is not positive at {int((~(resistance > 0.0)).sum())} of {len(resistance)} samples"]
    return []
