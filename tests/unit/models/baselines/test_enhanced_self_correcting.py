import json

import numpy as np
import pytest

from models.baselines import EnhancedSelfCorrecting, fit_enhanced_self_correcting, fit_equivalent_circuit
from models.data.errors import ModelError, NotIdentifiableError, StructureError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.free_run import free_run_V
from tests.unit.models.baselines import circuits

NOISE_V = 5e-4


@pytest.fixture(scope="module")
def train() -> list[TimeSeries]:
    return [circuits.run(9000, seed, with_hysteresis=True) for seed in (1, 2)]


@pytest.fixture(scope="module")
def model(train: list[TimeSeries]) -> EnhancedSelfCorrecting:
    return fit_enhanced_self_correcting(train, capacity_Ah=circuits.CAPACITY_AH, n_branches=2)


def test_recovers_the_known_model(model: EnhancedSelfCorrecting) -> None:
    assert model.hysteresis.amplitude_V.values.item() == pytest.approx(circuits.M_V, rel=0.1)
    assert model.hysteresis.jump_V.values.item() == pytest.approx(circuits.M0_V, rel=0.15)
    assert model.hysteresis.gamma.item() == pytest.approx(circuits.GAMMA, rel=0.2)
    assert model.r0_Ohm.values.item() == pytest.approx(circuits.R0_OHM, rel=0.03)
    resistances = [table.values.item() for table in model.branches.resistances_Ohm]
    np.testing.assert_allclose(resistances, [circuits.R1_OHM, circuits.R2_OHM], rtol=0.06)
    expected = [[circuits.TAU1_S], [circuits.TAU2_S]]
    np.testing.assert_allclose(model.branches.time_constants_s, expected, rtol=0.1)
    low, high = model.record.domain["soc"]
    soc = np.linspace(low + 0.05, high - 0.05, 20)
    np.testing.assert_allclose(model.ocv_V.at(soc, 25.0), circuits.ocv_V(soc), atol=3e-3)


def test_simulates_unseen_runs_to_the_noise_and_better_than_without_hysteresis(
    model: EnhancedSelfCorrecting, train: list[TimeSeries]
) -> None:
    run = to_grid(circuits.run(6000, 9, with_hysteresis=True), 1.0)
    circuit = fit_equivalent_circuit(train, capacity_Ah=circuits.CAPACITY_AH)
    rmse_V = [float(np.sqrt(np.mean((free_run_V(m, run, 0.6) - run.voltage_V) ** 2))) for m in (model, circuit)]
    assert rmse_V[0] < 1.5 * NOISE_V
    assert rmse_V[0] < 0.5 * rmse_V[1]
    assert model.name == "ESC 2RC"


def test_parameters_follow_temperature() -> None:
    factor = 1.5
    runs = [
        circuits.run(6000, 1, with_hysteresis=True),
        circuits.run(6000, 2, with_hysteresis=True, temperature_degC=5.0, factor=factor),
    ]
    model = fit_enhanced_self_correcting(runs, capacity_Ah=circuits.CAPACITY_AH, n_branches=2)
    warm, cold = (model.r0_Ohm.at(0.5, degC).item() for degC in (25.0, 5.0))
    assert cold / warm == pytest.approx(factor, rel=0.05)
    assert len(model.ocv_V.temperature_degC) == 2


def test_document_round_trip(model: EnhancedSelfCorrecting) -> None:
    again = EnhancedSelfCorrecting.from_json(json.loads(json.dumps(model.to_json())))
    run = to_grid(circuits.run(3000, 21, with_hysteresis=True), 1.0)
    np.testing.assert_array_equal(free_run_V(again, run, 0.6), free_run_V(model, run, 0.6))


@pytest.mark.parametrize(
    ("change", "said"),
    [({"kind": "equivalent_circuit"}, "kind"), ({"hysteresis": {}}, "damaged"), ({"schema_version": None}, "None")],
)
def test_refuses_damaged_documents(model: EnhancedSelfCorrecting, change: dict[str, object], said: str) -> None:
    with pytest.raises(StructureError, match=said):
        EnhancedSelfCorrecting.from_json(model.to_json() | change)


def test_refuses_hysteresis_where_the_current_never_turns() -> None:
    n = 4000
    current = np.where(np.arange(n) // 40 % 2 == 0, -0.8, 0.0)
    current[0] = 0.0
    soc = 0.9 + np.cumsum(current) / (3600.0 * circuits.CAPACITY_AH)
    voltage = circuits.ocv_V(soc) + circuits.R0_OHM * current
    series = TimeSeries(np.arange(n) * 1.0, current, voltage, np.full(n, 25.0), None, soc, "run")
    with pytest.raises(NotIdentifiableError, match="hysteresis"):
        fit_enhanced_self_correcting([series], capacity_Ah=circuits.CAPACITY_AH)


def test_refuses_bad_numbers_of_branches(train: list[TimeSeries]) -> None:
    with pytest.raises(ModelError, match="0 branches"):
        fit_enhanced_self_correcting(train, capacity_Ah=1.0, n_branches=0)
