from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from models.readouts.rest_start import soc_from_rest
from tests.unit.models import synthetic


@pytest.fixture(scope="module")
def network() -> LocalModelNetwork:
    runs = [synthetic.run(4000, seed=s, noise_V=1e-3, name=str(s)) for s in (2, 5)]
    return fit_network(runs, capacity_Ah=synthetic.CAPACITY_AH, structure="minimal").network


def rested(soc: float, rest_s: int = 900, left_V: float = 0.0) -> TimeSeries:
    n = rest_s + 100
    current = np.concatenate([np.zeros(rest_s), np.full(100, -2.0)])
    relaxing = left_V * np.exp(-np.arange(n) / 600.0)
    voltage = synthetic.ocv_V(np.full(n, soc)) + 0.02 * current + relaxing
    return TimeSeries(np.arange(n) * 1.0, current, voltage, np.full(n, 25.0))


@pytest.mark.parametrize("soc", [0.62, 0.7, 0.8])
def test_the_open_circuit_voltage_gives_the_start_with_its_band(network: LocalModelNetwork, soc: float) -> None:
    estimate, std = soc_from_rest(rested(soc), network)
    assert abs(estimate - soc) < 0.01
    assert abs(estimate - soc) < 3.0 * std
    assert 1e-4 < std < 0.02


def test_a_voltage_that_still_drifts_widens_the_band(network: LocalModelNetwork) -> None:
    still, moving = soc_from_rest(rested(0.7), network), soc_from_rest(rested(0.7, left_V=0.05), network)
    assert moving[1] > 2.0 * still[1]
    assert abs(moving[0] - 0.7) < 3.0 * moving[1]


def test_a_short_rest_and_a_foreign_cell_are_refused(network: LocalModelNetwork) -> None:
    with pytest.raises(ModelError, match="300 s|299 s"):
        soc_from_rest(rested(0.7, rest_s=300), network)
    run = rested(0.7)
    with pytest.raises(ModelError, match="outside the open-circuit table"):
        soc_from_rest(replace(run, voltage_V=run.voltage_V + 1.0), network)
    with pytest.raises(ModelError, match="no voltage"):
        soc_from_rest(replace(run, voltage_V=np.full(len(run), np.nan)), network)


def test_a_fit_takes_the_start_of_a_run_that_judges_from_its_rest(network: LocalModelNetwork) -> None:
    """As a comparison does; a reference is taken before, and a run that tells neither is refused before the fit."""
    runs = [synthetic.run(4000, seed=s, noise_V=1e-3, name=str(s)) for s in (2, 5)]
    judged = [replace(rested(0.7), name="rested"), synthetic.run(600, seed=8)]
    options = {"capacity_Ah": synthetic.CAPACITY_AH, "structure": "minimal"}
    found = fit_network(runs, validate=judged, **options)
    soc, std = soc_from_rest(judged[0], network)
    assert found.validation is not None
    assert [each["initial_soc"] for each in found.validation_runs] == [
        {"value": pytest.approx(soc), "std": pytest.approx(std)},
        {"value": pytest.approx(0.6), "std": None},
    ]
    told: list[str] = []
    with pytest.raises(ModelError, match="rest that it begins with|s of rest; 600 s are needed"):
        fit_network(
            runs, validate=[rested(0.7, rest_s=300)], progress=lambda _share, text: told.append(text), **options
        )
    assert told == []
