"""A hidden cell of the bounded form is found, to the noise and with the network that says the same."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.identification.bounded.best_variant import best_variant
from models.identification.bounded.fitted import BoundedFit, fit_variant, held_out_error, network_parts, simulated
from models.identification.bounded.layout import soc_over
from models.identification.bounded.problem import fold_of, regressors
from models.identification.bounded.variants import Trials, Variant
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import CellContext, SignalBank
from models.network.signals import parse_signal
from tests.unit.models.identification.bounded.bank import bank

NOISE_V = 1e-3


def hidden(swing_K: float | None = None) -> SignalBank:
    """Curve, resistance that falls with SoC, one pair, hysteresis, and all of it without error but the noise."""
    known = bank(n=4000, swing_K=swing_K)
    rng, runs = np.random.default_rng(5), []
    for k, run in enumerate(known.runs):
        soc = known.values("soc")[k]
        voltage = 3.4 + 0.6 * soc + 0.04 * np.sin(8.0 * soc) + (0.03 - 0.01 * soc) * run.current_A
        voltage += 0.01 * known.values("low_pass:60/3500")[k] + 0.015 * known.values("hysteresis_state:40")[k]
        runs.append(replace(run, voltage_V=voltage + NOISE_V * rng.standard_normal(len(run))))
    return SignalBank(runs, known.initial_soc, known.cell)


@pytest.fixture(scope="module")
def found() -> BoundedFit:
    return fit_variant(Trials(hidden()), Variant())


def test_held_out_error_is_the_noise(found: BoundedFit) -> None:
    assert NOISE_V < found.held_out_rmse_V < 1.04 * NOISE_V
    error = held_out_error(found, fold_of(found.bank))
    assert float(np.sqrt(np.mean(error**2))) < 1.04 * NOISE_V


def test_a_knee_that_one_block_alone_saw_does_not_decide_how_strong_penalties_are() -> None:
    plain = hidden()
    knee_V = [-0.2 * (np.maximum(0.48 - soc, 0.0) / 0.04) ** 2 for soc in plain.values("soc")]
    runs = [replace(run, voltage_V=run.voltage_V + more) for run, more in zip(plain.runs, knee_V, strict=True)]
    trials = Trials(replace(plain, runs=runs))
    fit = fit_variant(trials, best_variant(trials))
    assert fit.variant.surface is None
    rows, soc = regressors(fit.bank, fit.layout.basis, fit.layout.scale), np.concatenate(fit.bank.values("soc"))
    left = np.concatenate([run.voltage_V for run in runs]) - simulated(fit.layout, fit.coefficients, rows, soc)
    assert float(np.sqrt(np.mean(left[soc > 0.48] ** 2))) < 1.2 * NOISE_V


def test_gains_are_not_negative_and_what_comes_out_as_nothing_is_gone(found: BoundedFit) -> None:
    layout = found.layout
    gains = np.split(found.coefficients, layout.first.tolist())[1:-1]
    bounded = [part for part, term in zip(gains, layout.basis.terms, strict=True) if term.bounded]
    assert all(part.min() >= 0.0 < part.max() for part in bounded)
    assert (np.diff(found.coefficients[: layout.n_curve]) >= 0.0).all()


def test_the_network_says_the_same(found: BoundedFit) -> None:
    structure, partition, theta, scaling = network_parts(found, "bounded")
    network = LocalModelNetwork(structure, partition, theta, scaling, found.bank.cell)
    rows = regressors(found.bank, found.layout.basis, found.layout.scale)
    soc = np.concatenate(soc_over(found.bank, found.layout.basis.axis))
    own = simulated(found.layout, found.coefficients, rows, soc)
    starts = found.bank.initial_soc
    free = np.concatenate([free_run_V(network, run, soc) for run, soc in zip(found.bank.runs, starts, strict=True)])
    np.testing.assert_allclose(free, own, atol=1e-9)
    assert network.structure.kernel == "hat" and network.structure.output_order == 0


def test_an_effect_left_out_is_missed() -> None:
    bare = fit_variant(Trials(hidden(), ("hysteresis",)), Variant())
    assert not any("hysteresis" in term.parts for term in bare.layout.basis.terms)
    assert bare.held_out_rmse_V > 2.0 * NOISE_V


def test_temperature_that_says_nothing_gets_little() -> None:
    warm = fit_variant(Trials(hidden(swing_K=4.0)), Variant())
    assert warm.held_out_rmse_V < 1.06 * NOISE_V
    assert parse_signal(warm.layout.basis.terms[-1].signal).kind == "temperature"
    assert np.abs(warm.coefficients[warm.layout.first[-2] :]).max() < 5e-3


def test_a_curve_hardly_goes_on_beyond_the_temperatures_of_its_runs() -> None:
    signals = hidden(swing_K=10.0)
    drifting = [replace(run, voltage_V=run.voltage_V + 3e-3 * (run.temperature_degC - 25.0)) for run in signals.runs]
    fit = fit_variant(Trials(SignalBank(drifting, signals.initial_soc, signals.cell)), Variant())
    network = LocalModelNetwork(*network_parts(fit, "bounded"), signals.cell)
    highest = max(float(run.temperature_degC.max()) for run in drifting)
    rest = replace(drifting[0], current_A=np.zeros(len(drifting[0])))
    at = {
        degC: float(free_run_V(network, replace(rest, temperature_degC=np.full(len(rest), degC)), 0.5)[-1])
        for degC in (highest - 6.0, highest, highest + 6.0, highest + 50.0)
    }
    inside, near, far = np.diff([at[degC] for degC in sorted(at)])
    assert inside > 0.012
    assert near == pytest.approx(inside * (1.0 - np.exp(-1.0)), rel=0.03)
    assert near + far == pytest.approx(inside, rel=0.03)


def test_runs_that_only_charge_say_of_the_discharge_what_the_charge_has_shown() -> None:
    """The sensor's noise about zero is all that ever flows out: it is no measure of what a discharge is."""
    rng, n, capacity_Ah = np.random.default_rng(8), 1500, 0.5
    runs = []
    for number in range(2):
        flowing_A = np.where((np.arange(n) > 60) & (np.arange(n) < 1400), 1.2 + 0.1 * number, 0.0)
        current_A = flowing_A + 2e-3 * rng.standard_normal(n)
        soc = np.cumsum(current_A) / 3600.0 / capacity_Ah
        resistance_Ohm = 0.05 + 0.15 * np.exp(-soc / 0.04)
        voltage_V = 3.5 + 0.5 * soc + resistance_Ohm * current_A + NOISE_V * rng.standard_normal(n)
        run = TimeSeries(
            time_s=np.arange(n, dtype=np.float64),
            current_A=current_A,
            voltage_V=voltage_V,
            temperature_degC=np.full(n, 25.0),
        )
        runs.append(to_grid(run, 1.0))
    charged = fit_variant(Trials(SignalBank(runs, [0.0, 0.0], CellContext(capacity_Ah))), Variant())
    structure, partition, theta, scaling = network_parts(charged, "bounded")
    network = LocalModelNetwork(structure, partition, theta, scaling, charged.bank.cell)
    discharge = replace(runs[0], current_A=-2.0 * runs[0].current_A, charge_Ah=-runs[0].charge_Ah)
    falls_V = free_run_V(network, discharge, 0.95)
    assert falls_V.min() > 2.5, "at most half an Ohm, of a cell that has a twentieth of an Ohm"
