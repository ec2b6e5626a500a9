import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.identification.search.auto import AutoCandidate
from models.identification.search.fitted import fitted_choice
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.regression import CellContext, SignalBank
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import FitResult, fit_network
from models.readouts.ocv import ocv_table
from models.uncertainty.bands import prediction_band
from models.uncertainty.held_out import fit_uncertainty
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of
from models.uncertainty.spread import LocalFactor
from tests.unit.models import synthetic

NOISE_V = 1e-3


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    runs = [synthetic.run(3000, seed=s, noise_V=NOISE_V, drift_A=d) for s, d in ((2, -0.2), (3, 0.2))]
    return fit_network(runs, capacity_Ah=synthetic.CAPACITY_AH, structure="minimal")


@pytest.fixture(scope="module")
def known(fitted: FitResult) -> Uncertainty:
    found = uncertainty_of(fitted.network)
    assert found is not None
    return found


def grid(seed: int, **options: float) -> GridRun:
    return to_grid(synthetic.run(3000, seed=seed, noise_V=NOISE_V, **options), 1.0)


def test_the_document_is_json_and_comes_back(fitted: FitResult, known: Uncertainty) -> None:
    document = json.loads(json.dumps(fitted.network.to_json(), allow_nan=False))
    again = uncertainty_of(LocalModelNetwork.from_json(document))
    assert again is not None
    np.testing.assert_array_equal(again.parameters.covariance, known.parameters.covariance)
    np.testing.assert_array_equal(again.level_V, known.level_V)
    assert again.to_json() == known.to_json()


def test_rounding_the_factor_keeps_every_band(fitted: FitResult, known: Uncertainty) -> None:
    """The document's digits are enough although open-circuit voltage is a small difference of large numbers."""
    size = len(known.parameters.factor)
    noise = 1.0 + 5e-8 * np.random.default_rng(0).uniform(-1, 1, (size, size))
    shaken = replace(known.parameters, factor=known.parameters.factor * noise)
    first = ocv_table(fitted.network, local=LocalFactor(known.parameters.theta_factor)).std_V
    second = ocv_table(fitted.network, local=LocalFactor(shaken.theta_factor)).std_V
    assert first is not None and second is not None
    np.testing.assert_allclose(second, first, rtol=1e-3)


def test_bands_hold_on_runs_that_the_fit_did_not_see(fitted: FitResult, known: Uncertainty) -> None:
    # The errors of a run hang together: how wide a band is shows over several of them, how low one may lie in each.
    held = []
    for seed in range(11, 17):
        run = grid(seed)
        band = prediction_band(fitted.network, run, 0.6, known)
        held.append(band.coverage_95(run.voltage_V))
        assert (band.std_V >= band.parameter_std_V).all()
        np.testing.assert_allclose(band.voltage_V, free_run_V(fitted.network, run, 0.6))
    assert min(held) >= 0.90
    assert 0.93 <= np.mean(held) <= 0.98


def test_bands_grow_outside_the_trained_domain(fitted: FitResult, known: Uncertainty) -> None:
    run = grid(11)
    inside = prediction_band(fitted.network, run, 0.6, known)
    far = prediction_band(fitted.network, replace(run, temperature_degC=run.temperature_degC + 20.0), 0.6, known)
    more = prediction_band(fitted.network, replace(run, current_A=2.0 * run.current_A), 0.6, known)
    # Where the SoC is beyond the trained one the band is wide whatever the temperature.
    trained = inside.std_V < 1.5 * NOISE_V
    assert trained.sum() > 1000
    assert (far.std_V[trained] > 5.0 * inside.std_V[trained]).all()
    assert (far.std_V > inside.std_V).all()
    # Where only the current lies outside, and not the SoC already.
    loaded = (np.abs(2.0 * run.current_A) > 6.0) & (inside.std_V < 1.5 * NOISE_V)
    assert loaded.sum() > 100
    assert (more.std_V[loaded] > 2.0 * inside.std_V[loaded]).all()


def test_a_model_of_one_temperature_has_a_band_of_a_cell_elsewhere(fitted: FitResult, known: Uncertainty) -> None:
    record = fitted.network.record
    alone = replace(fitted.network, record=replace(record, domain={**record.domain, "temperature_degC": (25.0, 25.0)}))
    run = grid(11)
    near, far = (
        prediction_band(alone, replace(run, temperature_degC=np.full(len(run), degC)), 0.6, known).std_V
        for degC in (25.0, 45.0)
    )
    assert 5.0 < np.median((far / near)[near < 1.5 * NOISE_V]) < 20.0


def test_local_models_say_how_much_data_they_have(fitted: FitResult, known: Uncertainty) -> None:
    assert known.samples.sum() == pytest.approx(fitted.n_samples, rel=0.01)
    assert (known.effective_samples <= known.samples * (1 + 1e-9)).all()
    assert ((known.parameters.data_share > 0.0) & (known.parameters.data_share <= 1.0)).all()


def test_a_corner_that_hardly_any_sample_reaches_is_thin() -> None:
    short = synthetic.run(3000, seed=4, noise_V=NOISE_V)
    lonely = replace(short, temperature_degC=np.where(np.arange(3000) > 2990, 55.0, 20.0 + 0.001 * np.arange(3000)))
    axes = (PartitionAxis("soc", k_sigma=0.7), PartitionAxis("temperature", 3, splittable=False, k_sigma=0.6))
    structure = Structure(0, (InputChannel("soc", delay=1), InputChannel("current")), axes, 1.0)
    network = fit_network([lonely], capacity_Ah=synthetic.CAPACITY_AH, structure=structure).network
    found = uncertainty_of(network)
    assert found is not None
    hot = network.partition.lower[:, 1] > 0.6
    assert found.thin[hot].all()
    assert found.samples[hot].sum() < 0.05 * found.samples.sum()
    assert any("too little data" in text for text in network.record.tables["reservations"])


@pytest.mark.parametrize("keep_every", [1, 4])
def test_errors_hang_together_over_the_same_time_however_few_samples_are_kept(
    keep_every: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The observer and the designs count in samples of the model's grid."""
    runs = [synthetic.run(12_000, seed=seed, noise_V=NOISE_V) for seed in (2, 3)]
    rng, keep = np.random.default_rng(0), np.exp(-1.0 / 60.0)
    slow_V = [lfilter([5e-3 * np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(12_000)) for _ in runs]
    grid = [to_grid(replace(run, voltage_V=run.voltage_V + v), 1.0) for run, v in zip(runs, slow_V, strict=True)]
    monkeypatch.setattr("models.identification.search.fitted._STATIC_SAMPLES", 24_000 // keep_every)
    bank = SignalBank(grid, [0.6, 0.6], CellContext(synthetic.CAPACITY_AH))
    candidate = AutoCandidate(synthetic.CAPACITY_AH, time_constants_s=(20.0,), n_models=4)
    found = fitted_choice(candidate, bank, None)
    assert len(found.data) == 24_000 // keep_every
    lag_s = np.array([20.0, 60.0, 180.0])
    together = fit_uncertainty(found, found.theta).correlation
    np.testing.assert_allclose(together.at(lag_s) / together.shares.sum(), np.exp(-lag_s / 60.0), atol=0.1)


@pytest.mark.parametrize(
    "damage",
    [
        {"kind": "other"},
        {"schema_version": 99},
        {"covariance_factor": [1.0]},
        {"local_models": []},
        {"n_free": "many"},
        {"correlation": None},
    ],
)
def test_a_damaged_document_is_refused(fitted: FitResult, damage: dict) -> None:
    record = fitted.network.record
    broken = replace(fitted.network, record=replace(record, uncertainty=record.uncertainty | damage))
    with pytest.raises(ModelError):
        uncertainty_of(broken)


def test_a_network_without_the_record_has_no_band(fitted: FitResult) -> None:
    assert uncertainty_of(replace(fitted.network, record=ModelRecord())) is None
