import json

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.identification.progress import silent
from models.identification.search.auto import AutoCandidate
from models.identification.search.candidate import Candidate
from models.identification.search.search import Search
from models.identification.stored_sums import StoredSums
from models.network.free_run import free_run_V
from models.network.lineage import chain, document_sha256, run_sha256, version_of
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.regression import CellContext
from models.pipeline.refitting import refit, stored_sums
from tests.unit.models import synthetic

CELL = CellContext(synthetic.CAPACITY_AH)
OLD = [synthetic.run(4000, seed=s, noise_V=1e-3, name=f"old {s}") for s in (1, 2, 3)]
CANDIDATES = {
    "no past outputs": AutoCandidate(synthetic.CAPACITY_AH, time_constants_s=(3.0, 20.0), n_models=6),
    "one past output": Candidate("minimal", (20.0,), 1, n_models=6),
}


def fitted(candidate: Candidate | AutoCandidate) -> LocalModelNetwork:
    runs = [to_grid(run, 1.0) for run in OLD]
    found = Search(runs, [0.6] * len(runs), CELL, silent).fitted(candidate)
    domain = {"soc": (0.55, 0.8), "current_A": (-3.0, 3.0)}
    record = ModelRecord(train={"rmse_mV": 1.0}, domain=domain, tables={})
    return LocalModelNetwork(found.structure, found.partition, found.theta, found.scaling, CELL, record)


def rmse_mV(network: LocalModelNetwork, runs: list[TimeSeries]) -> float:
    errors = [free_run_V(network, to_grid(run, 1.0), 0.6) - run.voltage_V for run in runs]
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


@pytest.mark.parametrize("candidate", CANDIDATES.values(), ids=CANDIDATES)
def test_an_aged_cell_is_fitted_again_from_a_short_run(candidate, monkeypatch: pytest.MonkeyPatch) -> None:
    network = fitted(candidate)
    sums = stored_sums(network, OLD)
    monkeypatch.setattr(synthetic, "R0_OHM", 1.5 * synthetic.R0_OHM)
    new, later = synthetic.run(2500, seed=11, noise_V=1e-3), [synthetic.run(4000, seed=13, noise_V=1e-3)]
    found = refit(network, [new], old=sums)
    assert rmse_mV(network, later) > 15.0
    assert rmse_mV(found.network, later) < 0.3 * rmse_mV(network, later)
    version = version_of(found.network)
    assert version is not None
    assert version.settings["old_weight"] < 1.0
    assert version.errors["train"]["rmse_mV"] < 0.2 * version.errors["parent"]["rmse_mV"]


@pytest.mark.parametrize("candidate", CANDIDATES.values(), ids=CANDIDATES)
def test_a_short_run_of_an_unchanged_cell_does_not_undo_what_was_known(candidate) -> None:
    network = fitted(candidate)
    short = synthetic.run(400, seed=21, noise_V=1e-3)
    with_old = refit(network, [short], old=stored_sums(network, OLD), old_weight=1.0).network
    assert rmse_mV(with_old, OLD) < rmse_mV(network, OLD) + 0.03
    assert rmse_mV(refit(network, [short], old=stored_sums(network, OLD)).network, OLD) < rmse_mV(network, OLD) + 1.0


def test_without_past_outputs_stored_sums_stand_for_the_runs_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    # The pull between neighbours begins at other parameters in the two ways.
    monkeypatch.setattr("models.pipeline.refit_problem._ALIKE", (1e-9,))
    network = fitted(CANDIDATES["no past outputs"])
    new = synthetic.run(3000, seed=12, noise_V=1e-3)
    least_squares = refit(network, OLD, old_weight=0.0).network
    from_sums = refit(least_squares, [new], old=stored_sums(least_squares, OLD), old_weight=1.0).network
    together = refit(least_squares, [*OLD, new], old_weight=0.0).network
    probe = to_grid(synthetic.run(2000, seed=30), 1.0)
    apart = free_run_V(from_sums, probe, 0.6) - free_run_V(together, probe, 0.6)
    assert np.abs(apart).max() < 1e-5
    assert np.abs(free_run_V(least_squares, probe, 0.6) - free_run_V(together, probe, 0.6)).max() > 5e-5


def test_the_record_names_parent_data_settings_and_errors() -> None:
    network = fitted(CANDIDATES["one past output"])
    new = synthetic.run(1500, seed=11, noise_V=1e-3, name="new")
    found = refit(network, [new], old=stored_sums(network, OLD), old_weight=0.3, code_version="9.9")
    again = refit(found.network, [new], old=found.sums, old_weight=0.3)
    assert [n.theta.tolist() for n in chain(again.network, [network, found.network])] == [
        again.network.theta.tolist(),
        found.network.theta.tolist(),
        network.theta.tolist(),
    ]
    version = version_of(found.network)
    assert version is not None
    assert (version.made_by, version.number, version.code_version) == ("refit", 2, "9.9")
    assert version.runs[0].sha256 == run_sha256(new)
    assert version.sums_sha256 == document_sha256(found.sums.to_json())
    assert version.settings["old_samples"] == pytest.approx(3 * 4000 - 3)
    assert "tables" not in found.network.to_json()["record"]
    low, high = found.network.record.domain["current_A"]
    assert low < -3.0 and high > 3.0
    json.dumps(found.network.to_json(), allow_nan=False)


def test_stored_sums_survive_their_document() -> None:
    network = fitted(CANDIDATES["one past output"])
    sums = stored_sums(network, OLD)
    again = StoredSums.from_json(json.loads(json.dumps(sums.to_json())))
    np.testing.assert_array_equal(again.information, sums.information)
    assert (again.n_samples, again.squared_error) == (sums.n_samples, sums.squared_error)
    for damage in ({"kind": "x"}, {"schema_version": 0}, {"size": 3}, {"information": 5}, {"n_samples": float("nan")}):
        with pytest.raises(ModelError):
            StoredSums.from_json(sums.to_json() | damage)


def test_what_cannot_be_refitted_is_refused() -> None:
    network = fitted(CANDIDATES["one past output"])
    with pytest.raises(ModelError, match="no new run"):
        refit(network, [])
    with pytest.raises(ModelError, match="0..1"):
        refit(network, OLD, old_weight=2.0)
    with pytest.raises(ModelError, match="stored sums are of 2 parameters"):
        refit(network, OLD, old=StoredSums(np.eye(2), 1.0, 1.0))
