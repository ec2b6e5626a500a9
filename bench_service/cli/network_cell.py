"""An identified model as a battery: one sample at a time, at any pace, where a simulator has its truth cell."""

from __future__ import annotations

import math

import numpy as np

from models.data.lookup import surface
from models.module.models import ModuleModel
from models.network.compiled_network import flat_network, step_output, step_signals
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import VOLTAGE, normalise
from models.network.signals import KELVIN
from models.readouts.ocv import OcvTable
from models.thermal.model import ThermalModel
from simulators.cell import CellOutput, TruthCell

_WHOLE_STEP = 1e-9  # of the sampling time


class NetworkCell:
    """A cell that behaves like its local model network.

    The network moves in its own sampling time with the mean current of each step, so that no charge is lost. Between
    two samples the voltage is the one that the present current would lead to at the next: the step of the current is
    there at once, the slow parts are ahead by less than one sample.

    Parameters
    ----------
    network : LocalModelNetwork
    initial_soc : float
        Fraction; the cell is settled at rest there.
    temperature_degC : float
        Of the cell at the start, and of the room; held where there is no heat balance.
    heat : (ThermalModel, OcvTable) or None
        Heat balance and the open-circuit voltage that its losses I (V - U) come from, see
        `models.thermal.cell_temperature.thermal_of`.
    """

    def __init__(
        self,
        network: LocalModelNetwork,
        initial_soc: float,
        temperature_degC: float,
        heat: tuple[ThermalModel, OcvTable] | None = None,
    ) -> None:
        self._heat = None if heat is None else _HeatBalance(*heat, network.dt_s, temperature_degC)
        self._net, self._network = flat_network(network), network
        self._dt_s = network.dt_s
        self._temperature_degC = temperature_degC
        self._soc = initial_soc
        depth = 1 + int(max(self._net.tap_lag.max(), self._net.axis_lag.max()))
        n_signals = len(self._net.form)
        self._filters, self._history = np.zeros((n_signals, 3)), np.zeros((depth, n_signals))
        self._weight = np.zeros(len(self._net.theta))
        self._direction, self._last_A = -1.0, 0.0
        self._into_s = self._charge_As = 0.0
        self._signals(self._filters, self._history[0], 0.0, 0.0)
        self._history[1:] = self._history[0]
        first = np.zeros((self._net.order + 1, 1))
        settled = step_output(self._net, self._history, self._weight, first, 0, math.nan)
        self._past = np.full((self._net.order, 1), settled)
        self._shown = settled

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """See `simulators.cell.TruthCell`."""
        left_s = dt_s
        while left_s > self._dt_s * _WHOLE_STEP:
            part_s = min(left_s, self._dt_s - self._into_s)
            self._into_s += part_s
            self._charge_As += current_A * part_s
            left_s -= part_s
            if self._into_s >= self._dt_s * (1.0 - _WHOLE_STEP):
                self._commit(self._charge_As / self._into_s)
                self._into_s = self._charge_As = 0.0
        if dt_s > 0.0 and self._into_s > 0.0:
            self._shown = self._looked_ahead(current_A)
        volts = float(self._network.to_volts(np.array([self._shown]))[0])
        soc = self._soc + self._charge_As * self._net.soc_per_A / self._dt_s
        return CellOutput(volts, self._temperature_degC, soc, math.nan, 0.0, 0.0)

    def _commit(self, current_A: float) -> None:
        """Move by one sample."""
        self._direction = self._turned(current_A)
        self._history[1:] = self._history[:-1].copy()
        self._soc += (self._net.efficiency if current_A > 0.0 else 1.0) * current_A * self._net.soc_per_A
        if self._heat is not None:
            # The overpotential is taken as it is before the cell has warmed, as in the closed simulation.
            self._signals(self._filters.copy(), self._history[0], current_A, current_A - self._last_A)
            volts = self._net.voltage_low + self._net.voltage_span * self._output(self._history)
            self._temperature_degC = self._heat.warm(current_A, volts, self._soc, self._temperature_degC)
        self._signals(self._filters, self._history[0], current_A, current_A - self._last_A)
        self._last_A = current_A
        self._shown = self._output(self._history)
        self._past = np.concatenate([self._past, [[self._shown]]])[1:] if self._net.order else self._past

    def _looked_ahead(self, current_A: float) -> float:
        """Output of the next sample if the present current went on, without moving anything."""
        history, direction, soc = np.empty_like(self._history), self._direction, self._soc
        history[1:] = self._history[:-1]
        self._direction = self._turned(current_A)
        self._soc += (self._net.efficiency if current_A > 0.0 else 1.0) * current_A * self._net.soc_per_A
        self._signals(self._filters.copy(), history[0], current_A, current_A - self._last_A)
        self._direction, self._soc = direction, soc
        return self._output(history)

    def _turned(self, current_A: float) -> float:
        if abs(current_A) <= self._net.rest_A:
            return self._direction
        return math.copysign(1.0, current_A)

    def _signals(self, filters: np.ndarray, now: np.ndarray, current_A: float, change_A: float) -> None:
        step_signals(self._net, filters, now, current_A, change_A, self._soc, self._direction, self._temperature_degC)

    def _output(self, history: np.ndarray) -> float:
        past = np.concatenate([self._past, np.zeros((1, 1))])
        return step_output(self._net, history, self._weight, past, self._net.order, math.nan)

    def start_at(self, voltage_V: float) -> None:
        """Begin from a measured voltage instead of the settled one."""
        first = float(normalise(np.array([voltage_V]), self._network.scaling[VOLTAGE])[0])
        self._past[:] = self._shown = first


class _HeatBalance:
    """Moves the temperatures of a cell by one sample; the closed simulation's balance, step by step."""

    def __init__(self, thermal: ThermalModel, ocv: OcvTable, dt_s: float, temperature_degC: float) -> None:
        self._thermal, self._ocv = thermal, ocv
        self._a, self._b = thermal.discrete(dt_s)
        self._ambient_degC = temperature_degC
        self._nodes = np.full(thermal.n_nodes, temperature_degC)
        self._pole = math.exp(-dt_s / thermal.polarisation_s)
        self._through_A = 0.0

    def warm(self, current_A: float, voltage_V: float, soc: float, case_degC: float) -> float:
        """Return the case's temperature after a sample."""
        table = self._ocv
        rest_V = surface(table.temperature_degC, table.soc, table.mean_V, case_degC, soc, True)
        self._through_A = self._pole * self._through_A + (1.0 - self._pole) * current_A
        heat_W = current_A * (voltage_V - rest_V)
        heat_W += self._thermal.polarisation_Ohm * self._through_A * (self._through_A - current_A)
        heat_W += current_A * float(self._thermal.entropic_V_per_K(soc)) * (self._nodes[0] + KELVIN)
        self._nodes = self._a @ self._nodes + self._b @ np.array([heat_W, self._ambient_degC])
        return float(self._nodes[-1])


class ModuleOfCells:
    """A module made of one cell's voltage, by an identified module model (S1 to S4).

    Parameters
    ----------
    cell : TruthCell
    module : ModuleModel
    """

    def __init__(self, cell: TruthCell, module: ModuleModel) -> None:
        self._cell, self._module = cell, module

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """See `simulators.cell.TruthCell`; the current is the module's."""
        one = self._cell.step(current_A / self._module.cells_in_parallel, dt_s)
        volts = self._module.voltage_V(np.array([one.voltage_V]), np.array([current_A]))
        return one._replace(voltage_V=float(volts[0]))
