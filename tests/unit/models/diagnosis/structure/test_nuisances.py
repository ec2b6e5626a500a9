from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.diagnosis.structure.nuisances import slips_V, starts_V, time_constants_V
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from simulators.cell import Branch
from tests.unit.models.diagnosis.cells import SOC, measured
from tests.unit.models.diagnosis.structure.test_structure import BARE, CELL

TRAIN = measured(CELL, 1)
INDEX = np.arange(0, 3000, 50)


@pytest.fixture(scope="module")
def network_and_run() -> tuple[LocalModelNetwork, GridRun]:
    fit = fit_network([TRAIN], capacity_Ah=CELL.capacity_Ah, structure=BARE, initial_soc=[SOC], dt_s=1.0)
    return fit.network, to_grid(TRAIN, 1.0)


def test_each_time_constant_has_its_derivative(network_and_run: tuple[LocalModelNetwork, GridRun]) -> None:
    network, run = network_and_run
    columns = time_constants_V(network, run, SOC, INDEX)
    assert columns.shape == (len(INDEX), 2)
    # A network whose second constant is a little longer differs by just the second column's share.
    longer = f"low_pass:{25.0 * np.exp(0.01):.9g}"
    inputs = tuple(
        replace(each, signal=longer) if each.signal == "low_pass:25" else each for each in network.structure.inputs
    )
    moved = replace(
        network,
        structure=replace(network.structure, inputs=inputs),
        scaling=network.scaling | {longer: network.scaling["low_pass:25"]},
    )
    difference = (free_run_V(moved, run, SOC) - free_run_V(network, run, SOC))[INDEX]
    assert np.corrcoef(columns[:, 1], difference)[0, 1] > 0.99


def test_where_a_run_begins_fades_and_a_slip_lasts(network_and_run: tuple[LocalModelNetwork, GridRun]) -> None:
    network, run = network_and_run
    late = np.array([0, len(run) - 1])
    starts = np.abs(starts_V(network, run, SOC, late, 0.005))
    # All but the state of charge; the slowest has a time constant of 3000 s.
    assert (starts[1, 1:] < 0.2 * starts[0, 1:]).all()
    slips = slips_V(network, run, SOC, late)
    assert abs(slips[1, -1]) > 0.0
    assert slips[1, 0] == 0.0


def test_time_constants_that_are_nearly_right_are_no_effect() -> None:
    off = replace(CELL, fast_1=Branch(CELL.fast_1.resistance_Ohm, 2.0), fast_2=Branch(CELL.fast_2.resistance_Ohm, 18.0))
    train, run = measured(off, 1), measured(off, 2)
    fit = fit_network([train], capacity_Ah=off.capacity_Ah, structure=BARE, initial_soc=[SOC], dt_s=1.0)
    answer = diagnose(fit.network, [run], [SOC], train=[train], train_soc=[SOC], mode="structure")
    assert answer.verdict == "nothing_missing"


def test_a_log_that_begins_under_load_lacks_nothing(network_and_run: tuple[LocalModelNetwork, GridRun]) -> None:
    network, run = network_and_run[0], measured(CELL, 2)
    first = int(np.argmax(np.abs(run.current_A[500:2000]))) + 500
    soc = SOC + float(run.current_A[1 : first + 1].sum()) / (3600.0 * CELL.capacity_Ah)
    rest = TimeSeries(
        run.time_s[first:] - run.time_s[first],
        run.current_A[first:],
        run.voltage_V[first:],
        run.temperature_degC[first:],
        name="late",
    )
    answer = diagnose(network, [rest], [soc], train=[TRAIN], train_soc=[SOC], mode="structure")
    assert answer.verdict == "nothing_missing"


def test_a_start_that_nobody_is_sure_of_is_open_as_far_as_is_said(
    network_and_run: tuple[LocalModelNetwork, GridRun],
) -> None:
    network, run = network_and_run
    careful, vague = (starts_V(network, run, SOC, INDEX, std) for std in (0.005, 0.05))
    np.testing.assert_allclose(vague[:, 0], 10.0 * careful[:, 0])
    np.testing.assert_array_equal(vague[:, 1:], careful[:, 1:])
