import json
from dataclasses import replace

import numpy as np
import pytest

from models.comparison.figures import compare
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.pipeline.fit import fit_network
from models.thermal.cell_temperature import compare_temperature, thermal_of, thermal_record
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.models import simulated_cells

TRUTH = CELLS["nmc"].parameters


def run(seed: int) -> TimeSeries:
    current = simulated_cells.pulses_A(5000, TRUTH.capacity_Ah, seed, rest=800)
    return simulated_cells.record(Cell(TRUTH, 0.6, simulated_cells.AMBIENT_DEGC), current, seed)


@pytest.fixture(scope="module")
def network() -> LocalModelNetwork:
    fitted = fit_network([run(1), run(2)], capacity_Ah=TRUTH.capacity_Ah, structure="minimal").network
    return LocalModelNetwork.from_json(json.loads(json.dumps(fitted.to_json(), allow_nan=False)))


def test_a_fit_identifies_the_heat_balance_of_the_simulated_cell(network: LocalModelNetwork) -> None:
    found = thermal_of(network)
    assert found is not None
    assert found[0].heat_capacity_J_per_K == pytest.approx(TRUTH.heat_capacity_J_per_K, rel=0.1)
    assert found[0].heat_transfer_W_per_K == pytest.approx(TRUTH.heat_transfer_W_per_K, rel=0.1)


def test_compare_simulates_temperature_from_current_and_ambient(network: LocalModelNetwork) -> None:
    result = compare(network, [run(3)], [0.6])["temperature"]
    assert result["rmse_K"] < 0.3
    # This structure does not know temperature: its closed voltage is its free run but for the first values.
    assert result["voltage_rmse_mV"] == pytest.approx(compare(network, [run(3)], [0.6])["overall"]["rmse_mV"], rel=0.05)
    assert result["reservations"] == [] and len(result["runs"]) == 1
    json.dumps(result, allow_nan=False)


def test_the_measured_temperature_is_not_used_but_for_its_start(network: LocalModelNetwork) -> None:
    grid = to_grid(run(3), 1.0)
    later = np.where(np.arange(len(grid)) < 10, 0.0, 5.0)
    warmer = replace(grid, temperature_degC=grid.temperature_degC + later)
    wrong = compare_temperature(network, [warmer], [0.6])
    assert wrong is not None and wrong["rmse_K"] == pytest.approx(5.0, abs=0.3)


def test_without_ambient_there_is_nothing(network: LocalModelNetwork) -> None:
    grid = replace(to_grid(run(1), 1.0), ambient_degC=None)
    assert thermal_record(network, [grid], [0.6]) is None
    assert compare_temperature(network, [grid], [0.6]) is None
    assert compare_temperature(replace(network, record=ModelRecord()), [to_grid(run(1), 1.0)], [0.6]) is None


def test_what_cannot_be_identified_is_a_reservation(network: LocalModelNetwork) -> None:
    grid = to_grid(run(1), 1.0)
    flat = replace(grid, temperature_degC=np.full(len(grid), 23.0))
    record = thermal_record(network, [flat], [0.6])
    assert record is not None and record["model"] is None
    assert "moves by 0.00 K only" in record["reservations"][0]
    copied = replace(grid, temperature_degC=grid.ambient_degC)
    record = thermal_record(network, [copied], [0.6])
    assert record is not None and "was not measured" in record["reservations"][0]


def test_a_run_that_cannot_be_simulated_is_a_reservation(network: LocalModelNetwork) -> None:
    tables = json.loads(json.dumps(network.record.tables))
    tables["ocv"]["voltage_V"][0][0][3] = None
    holed = replace(network, record=replace(network.record, tables=tables))
    result = compare_temperature(holed, [to_grid(run(3), 1.0)], [0.6])
    assert result is not None and result["rmse_K"] is None
    assert "does not settle" in result["reservations"][0]
