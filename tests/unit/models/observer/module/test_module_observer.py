from dataclasses import replace

import numpy as np
import pytest

from models.module.models import KINDS, ModuleModel
from models.observer import FuzzyObserver
from models.observer.module.module_errors import CellSpread, module_settings, slow_error_V
from models.observer.module.module_observer import ModuleObserver
from tests.unit.models import synthetic

SERIES, PARALLEL = 12, 2
MODELS = {
    "S1": ModuleModel("S1", SERIES, PARALLEL),
    "S2": ModuleModel("S2", SERIES, PARALLEL, (0.01, 0.01)),
    "S3": ModuleModel("S3", SERIES, PARALLEL, (0.01, 0.01), (0.2, 0.2)),
    "S4": ModuleModel("S4", SERIES, PARALLEL, (0.012, 0.008), (0.25, 0.15)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_modules_state_of_charge_is_that_of_its_cells(fitted: FuzzyObserver, kind: str) -> None:
    run = synthetic.run(2500, seed=11, noise_V=1e-3)
    current = PARALLEL * run.current_A
    # The same sum in words of its own: cells in series, then resistance and offset of the current's direction.
    charging = current > 0.0
    ohm, volt = (np.where(charging, *pair) for pair in (MODELS[kind].resistance_Ohm, MODELS[kind].offset_V))
    module_V = SERIES * run.voltage_V + ohm * current + volt
    observer = ModuleObserver(fitted, MODELS[kind])
    _, rows = observer.replay(observer.initial(0.4), current, module_V, run.temperature_degC)
    assert run.soc_ref is not None
    assert np.abs(rows[1500:, 0] - run.soc_ref[1500:]).max() < 0.02
    mean_cell = observer.cell
    _, cell = mean_cell.replay(mean_cell.initial(0.4), run.current_A, run.voltage_V, run.temperature_degC)
    np.testing.assert_allclose(rows[:, 0], cell[:, 0], atol=1e-6)
    np.testing.assert_allclose(rows[1:, 2] + rows[1:, 3], module_V[1:], atol=1e-9)
    np.testing.assert_allclose(rows[:, 7], PARALLEL * cell[:, 7], rtol=1e-6)


def test_live_equals_replay_to_the_bit(fitted: FuzzyObserver) -> None:
    run = synthetic.run(100, seed=3)
    observer = ModuleObserver(fitted, MODELS["S4"])
    arrays = (PARALLEL * run.current_A, SERIES * run.voltage_V, run.temperature_degC)
    _, rows = observer.replay(observer.initial(0.5), *arrays)
    state = observer.initial(0.5)
    for k in range(len(run)):
        state, out = observer.step(state, *(float(values[k]) for values in arrays))
        assert (out.soc, out.soc_std, out.model_voltage_V) == (rows[k, 0], rows[k, 1], rows[k, 2])


def test_the_mean_cells_run_is_the_modules_without_what_is_beside_the_cells(fitted: FuzzyObserver) -> None:
    run = synthetic.run(300, seed=3)
    observer = ModuleObserver(fitted, MODELS["S3"])
    module_V = SERIES * run.voltage_V + 0.01 * PARALLEL * run.current_A + 0.2
    module = replace(run, current_A=PARALLEL * run.current_A, voltage_V=module_V)
    cell = observer.mean_cell_run(module)
    np.testing.assert_allclose(cell.voltage_V, run.voltage_V, atol=1e-12)
    np.testing.assert_allclose(cell.current_A, run.current_A, atol=1e-12)


def test_the_modules_offset_and_capacity_are_those_of_all_its_cells(fitted: FuzzyObserver) -> None:
    observer = ModuleObserver(fitted, MODELS["S1"])
    row = np.zeros(11)
    row[5:9] = 0.02, 1e-4, 4.0, 1e-3
    told = observer.told_sensors(row)
    assert told["current_offset_A"] == pytest.approx({"value": 0.02, "std": 1e-4})
    assert told["capacity_Ah"] == pytest.approx({"value": 4.0, "std": 1e-3})
    row[6] = 1.0
    assert observer.told_sensors(row)["current_offset_A"] is None


def test_what_is_not_known_of_a_module_widens_its_band(fitted: FuzzyObserver) -> None:
    run = synthetic.run(2500, seed=11, noise_V=1e-3)
    arrays = (PARALLEL * run.current_A, SERIES * run.voltage_V, run.temperature_degC)
    plain, usual = ModuleObserver(fitted, MODELS["S1"], None), ModuleObserver(fitted, MODELS["S1"])
    unlike = ModuleObserver(fitted, MODELS["S1"], CellSpread(soc=0.05, connectors=0.5))
    bands = [observer.replay(observer.initial(0.4), *arrays)[1][-1, 1] for observer in (plain, usual, unlike)]
    assert plain.cell is fitted
    assert bands[0] < bands[1] < bands[2]


def test_the_module_adds_bend_offset_and_resistance_and_a_single_cell_no_spread(fitted: FuzzyObserver) -> None:
    network, spread = fitted.network, CellSpread()
    offset = ModuleModel("S3", SERIES, 1, (0.01, 0.01), (0.24, 0.24), (0.006, 0.006), (0.0, 0.0))
    bend_V = slow_error_V(network, MODELS["S1"], spread)
    assert (bend_V > 0.0).all()
    assert (slow_error_V(network, MODELS["S1"], CellSpread(soc=0.03)) >= bend_V).all()
    assert slow_error_V(network, offset, CellSpread(0.0, 0.0, 0.0, 0.0)) == pytest.approx(0.24 / SERIES)
    assert (slow_error_V(network, ModuleModel("S1", 1, 1), spread) == 0.0).all()
    widened = module_settings(fitted.settings, network, offset, CellSpread(resistance=0.0))
    assert widened.series_resistance_std_Ohm == pytest.approx(0.006 / SERIES)
    assert widened.resistance_std == fitted.settings.resistance_std


def test_a_resistance_beside_the_cells_that_nobody_declared_is_lived_with(fitted: FuzzyObserver) -> None:
    run = synthetic.run(4000, seed=11, noise_V=1e-3)
    assert run.soc_ref is not None
    errors = {}
    for spread in (None, CellSpread()):
        observer = ModuleObserver(fitted, MODELS["S1"], spread)
        module_V = SERIES * (run.voltage_V + 0.005 * run.current_A)
        _, rows = observer.replay(observer.initial(0.4), PARALLEL * run.current_A, module_V, run.temperature_degC)
        errors[spread] = np.sqrt(np.mean((rows[2000:, 0] - run.soc_ref[2000:]) ** 2))
    assert errors[CellSpread()] < 0.01
    assert errors[CellSpread()] <= errors[None] + 1e-3
