"""The reference model of a design: where an experiment with a network begins, and what is known already.

No model yet is the normal first day: a bounded pre-test is played, a bounded network is fitted to it, and the design
goes on from there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError
from models.data.timeseries import FloatArray, TimeSeries
from models.design.constraints.feasible import TemperatureOf
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.information.coarse_network import coarse_copy
from models.design.information.experiment import DEFAULT_TEMPERATURE_DEGC, SENSITIVITIES, Experiment
from models.design.sequence.profile import Profile
from models.design.sequence.step_profile import StepProfileRequest, step_profile
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from models.thermal.cell_temperature import thermal_of
from models.thermal.closed_loop import simulate_closed
from models.uncertainty.model_uncertainty import uncertainty_of

# The pre-test uses the whole current that is allowed: a model that has never seen it says nothing of the voltage there,
# and the design that follows would have to keep away from it. The bench guards the voltage, which cannot be predicted.
PRE_TEST_SHARE = 1.0
_PRE_TEST_LEVELS = 3
# Sensors of benches read a cell's voltage to about this.
_LEAST_NOISE_V = 1e-3
# Relative to the best known combination of parameters; what is known better yet (shared poles are known to be equal)
# counts as this.
_BEST_KNOWN = 1e-9
# What a thermal model's prediction may be wrong by, in K, with the model's own error.
_TEMPERATURE_MARGIN_K = 1.0


def experiment_with(
    network: LocalModelNetwork,
    initial_soc: float,
    *,
    sensitivity: str = SENSITIVITIES[0],
    use_prior: bool = True,
    temperature_degC: float | None = None,
    noise_V: float | None = None,
    coarse: bool = True,
) -> Experiment:
    """Experiment with a fitted network.

    Parameters
    ----------
    network : the reference model
    initial_soc : where the cell stands
    sensitivity : see `Experiment`
    use_prior : count what the training runs have told already, as far as the network's record says it
    temperature_degC : of the cell; by default the middle of the trained range
    noise_V : white noise of this size; by default what the model's record says of its error on samples that it was not
        fitted to, its size near each local model and how it hangs together, at least 1 mV
    coarse : ask for a coarse copy's parameters where the network is a large one by hats; it still predicts the voltage
    """
    degC = _middle_degC(network) if temperature_degC is None else float(temperature_degC)
    uncertainty = uncertainty_of(network) if noise_V is None else None
    asked, covariance = coarse_copy(network) if coarse else (network, _covariance(network))
    prior = _information(covariance) if use_prior and covariance is not None else None
    predictor = None if asked is network else network
    found = Experiment(asked, initial_soc, noise_V or _noise_V(network), degC, sensitivity, prior, predictor=predictor)
    if temperature_degC is None:
        found = replace(found, coldest_degC=_coldest_degC(network))
    if uncertainty is None:
        return found
    level_V = np.maximum(_levels_V(network, asked, uncertainty.level_V), _LEAST_NOISE_V)
    rms_V = float(np.sqrt(np.mean(level_V**2)))
    return replace(found, noise_V=rms_V, memory=uncertainty.correlation, level_V=level_V)


def _noise_V(network: LocalModelNetwork) -> float:
    """What the record says of the error, where it does not say how it hangs together."""
    record = network.record
    figures = record.validation or record.train or {}
    return max(_LEAST_NOISE_V, 1e-3 * float(record.noise_floor_mV or 0.0), 1e-3 * float(figures.get("rmse_mV") or 0.0))


def _levels_V(network: LocalModelNetwork, asked: LocalModelNetwork, level_V: FloatArray) -> FloatArray:
    """Of the network's local models at those of its coarse copy, which is one by hats."""
    if asked is network:
        return level_V
    return np.interp(asked.partition.centres[:, 0], network.partition.centres[:, 0], level_V)


def _middle_degC(network: LocalModelNetwork) -> float:
    domain = network.record.domain.get("temperature_degC")
    return DEFAULT_TEMPERATURE_DEGC if domain is None else float(0.5 * (domain[0] + domain[1]))


def _coldest_degC(network: LocalModelNetwork) -> float | None:
    domain = network.record.domain.get("temperature_degC")
    return None if domain is None else float(domain[0])


def known_information(network: LocalModelNetwork) -> FloatArray | None:
    """(M p, M p) information on the parameters that the training runs gave; None where the record does not say."""
    covariance = _covariance(network)
    return None if covariance is None else _information(covariance)


def _covariance(network: LocalModelNetwork) -> FloatArray | None:
    uncertainty = uncertainty_of(network)
    return None if uncertainty is None else uncertainty.parameters.covariance


def _information(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(covariance)
    least = _BEST_KNOWN * max(float(values[-1]), 1e-300)
    return (vectors / np.maximum(values, least)) @ vectors.T


def predicted_temperature(
    network: LocalModelNetwork, initial_soc: float, ambient_degC: float, margin_K: float = _TEMPERATURE_MARGIN_K
) -> TemperatureOf | None:
    """Temperature of a current by the network's thermal model, a margin for its error added; None: it has none."""
    found = thermal_of(network)
    if found is None:
        return None
    thermal, losses = found

    def temperature_of(current_A: FloatArray) -> FloatArray:
        played = np.concatenate([[0.0], current_A])
        closed = simulate_closed(network, thermal, losses, played, ambient_degC, initial_soc=initial_soc)
        return np.maximum(closed.temperature_degC, closed.core_degC) + margin_K

    return temperature_of


def pre_test(
    limits: Limits, capacity_Ah: float, initial_soc: float, duration_s: float, dt_s: float, seed: int
) -> Profile:
    """Return a bounded first test for a cell of which nothing is known: steps, pulses and rests within its limits.

    Raises
    ------
    InfeasibleError
        The limits leave no room, or the time does not suffice.
    """
    low_A, high_A = limits.current_A
    request = StepProfileRequest(
        capacity_Ah=capacity_Ah,
        current_A=(PRE_TEST_SHARE * low_A, PRE_TEST_SHARE * high_A),
        soc=limits.soc,
        initial_soc=initial_soc,
        duration_s=duration_s,
        dt_s=dt_s,
        n_levels=_PRE_TEST_LEVELS,
    )
    try:
        return step_profile(request, np.random.default_rng(seed))
    except InfeasibleError:
        raise
    except ModelError as error:
        raise InfeasibleError(f"pre-test: {error}") from None


def bounded_reference(
    runs: list[TimeSeries], capacity_Ah: float, dt_s: float | None = None, initial_soc: list[float] | None = None
) -> LocalModelNetwork:
    """Bounded network of whatever was measured so far; one local model where the runs tell too little for it."""
    try:
        return fit_network(
            runs, capacity_Ah=capacity_Ah, structure="bounded", dt_s=dt_s, initial_soc=initial_soc
        ).network
    except NotIdentifiableError:
        return first_reference(runs, capacity_Ah, dt_s, initial_soc)


def first_reference(
    runs: list[TimeSeries], capacity_Ah: float, dt_s: float | None = None, initial_soc: list[float] | None = None
) -> LocalModelNetwork:
    """Network of one local model, fitted to whatever was measured so far (ch. 2.3.1)."""
    structure = Structure(
        output_order=1,
        inputs=(InputChannel("soc", delay=1), InputChannel("current", order=1)),
        axes=(PartitionAxis("soc", splittable=False),),
        dt_s=dt_s or 1.0,
        name="linear",
    )
    return fit_network(runs, capacity_Ah=capacity_Ah, structure=structure, dt_s=dt_s, initial_soc=initial_soc).network
