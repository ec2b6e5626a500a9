import numpy as np
import pytest

from models.baselines import EquivalentCircuit, fit_equivalent_circuit
from models.data.errors import ModelError
from models.observer.circuit_filters import CircuitObserver
from models.observer.tuning.accuracy import soc_figures
from tests.unit.models import synthetic


@pytest.fixture(scope="module")
def circuit() -> EquivalentCircuit:
    return fit_equivalent_circuit(
        [synthetic.run(5000, seed=2, noise_V=1e-3)], capacity_Ah=synthetic.CAPACITY_AH, n_branches=1, dt_s=1.0
    )


@pytest.mark.parametrize("kind", ["extended", "unscented"])
def test_kalman_filters_find_the_state_of_charge(circuit: EquivalentCircuit, kind: str) -> None:
    run = synthetic.run(2500, seed=11, noise_V=1e-3)
    observer = CircuitObserver(circuit, kind)
    _, rows = observer.replay(observer.initial(0.4), run.current_A, run.voltage_V, run.temperature_degC)
    figures = soc_figures(run.time_s, rows[:, 0], rows[:, 1], run.soc_ref)
    assert figures["converged_after_s"] is not None
    assert figures["soc_rmse"] is not None and figures["soc_rmse"] < 0.01


def test_counting_keeps_the_error_of_its_start(circuit: EquivalentCircuit) -> None:
    run = synthetic.run(500, seed=11)
    observer = CircuitObserver(circuit, "counting")
    _, rows = observer.replay(observer.initial(0.4), run.current_A, run.voltage_V, run.temperature_degC)
    assert run.soc_ref is not None
    np.testing.assert_allclose(rows[:, 0], run.soc_ref - 0.2, atol=1e-9)


def test_on_a_straight_line_both_filters_are_the_same(circuit: EquivalentCircuit) -> None:
    extended, unscented = (CircuitObserver(circuit, kind) for kind in ("extended", "unscented"))
    args = (1.0, 3.8, 25.0)
    one = extended.step(extended.initial(0.6, 1e-4), *args)[1]
    other = unscented.step(unscented.initial(0.6, 1e-4), *args)[1]
    np.testing.assert_allclose(one, other, rtol=1e-4)


def test_an_unknown_filter_is_refused(circuit: EquivalentCircuit) -> None:
    with pytest.raises(ModelError, match="unknown"):
        CircuitObserver(circuit, "particle")
