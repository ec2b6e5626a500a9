"""A bounded network follows an aged cell from a short run, keeps its bounds, and forgets nothing without need."""

import json
from dataclasses import replace

import numpy as np
import pytest

from models.comparison.placed_runs import free_run_metrics
from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.lineage import version_of
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.bounded_refit import remembers, solved_bounded
from models.pipeline.refitting import refit
from models.readouts.ocv import ocv_table
from models.uncertainty.bands import prediction_band
from models.uncertainty.model_uncertainty import uncertainty_of
from simulators.cell import CellParameters
from tests.unit.models.diagnosis.cells import SOC, measured
from tests.unit.models.pipeline.bounded_cell import CELL, fitted, run

AGED: CellParameters = replace(CELL, ohmic_Ohm=CELL.ohmic_Ohm + 0.01)


def rmse_mV(network: LocalModelNetwork, *runs: TimeSeries) -> float:
    return free_run_metrics(network, list(runs), [SOC] * len(runs))["rmse_mV"]


def test_an_aged_cell_is_followed_from_a_short_run() -> None:
    network, later = fitted().network, measured(AGED, 9, 3000)
    found = refit(network, [measured(AGED, 4, 1200)], initial_soc=[SOC]).network
    assert rmse_mV(network, later) > 10.0
    assert rmse_mV(found, later) < 0.2 * rmse_mV(network, later)
    version = version_of(found)
    assert version is not None and (version.number, version.made_by) == (2, "refit")
    assert version.settings["old_weight"] < 1.0
    assert version.errors["train"]["rmse_mV"] < 0.2 * version.errors["parent"]["rmse_mV"]


def test_bounds_hold_again_and_it_can_be_refitted_once_more() -> None:
    found = fitted().network
    for seed in (4, 12):
        found = refit(found, [measured(AGED, seed, 1200)], initial_soc=[SOC]).network
        assert found.structure.kernel == "hat" and remembers(found)
        inputs = [channel.signal for channel in found.structure.inputs]
        gains = np.delete(
            found.theta[:, :-1], [k for k, name in enumerate(inputs) if name.startswith("temperature")], axis=1
        )
        assert gains.min() >= -1e-12
        assert (np.diff(ocv_table(found).voltage_V, axis=-1) >= -1e-9).all()


def test_a_short_run_of_an_unchanged_cell_does_not_undo_what_was_known() -> None:
    network = fitted().network
    short = measured(CELL, 12, 400)
    for weight, more_mV in ((1.0, 0.05), (None, 0.5)):
        found = refit(network, [short], initial_soc=[SOC], old_weight=weight).network
        assert rmse_mV(found, run(9)) < rmse_mV(network, run(9)) + more_mV


@pytest.mark.proof
def test_old_and_new_runs_together_say_what_a_refit_with_full_weight_says() -> None:
    """The covariance stands for the old runs."""
    network, new = fitted().network, run(12)
    both = refit(network, [new], initial_soc=[SOC], old_weight=1.0).network
    assert rmse_mV(both, new) < rmse_mV(network, new) + 0.01
    assert rmse_mV(both, run(2), run(4)) < rmse_mV(network, run(2), run(4)) + 0.05


def test_from_a_file_it_is_the_same() -> None:
    """The document's digits of the covariance are enough."""
    network, new = fitted().network, measured(AGED, 4, 1200)
    read = LocalModelNetwork.from_json(json.loads(json.dumps(network.to_json())))
    one, other = (refit(each, [new], initial_soc=[SOC]).network for each in (network, read))
    assert abs(rmse_mV(one, run(9)) - rmse_mV(other, run(9))) < 1e-3


def test_bands_hold_after_it() -> None:
    found = refit(fitted().network, [measured(AGED, 4, 2500)], initial_soc=[SOC]).network
    known, later = uncertainty_of(found), to_grid(measured(AGED, 9, 3000), 1.0)
    assert known is not None
    band = prediction_band(found, later, SOC, known)
    assert 0.9 <= band.coverage_95(later.voltage_V) <= 1.0
    assert np.sqrt(np.mean(band.std_V**2)) < 4e-3


def test_runs_beyond_its_knots_are_refused() -> None:
    network = fitted().network
    low = replace(measured(CELL, 3, 400), soc_ref=None)
    with pytest.raises(ModelError, match="no sample of the new runs lies between SoC"):
        solved_bounded(network, [to_grid(low, 1.0)], [0.05], None)
