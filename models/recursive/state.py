"""What a recursive update carries from sample to sample, and what a sample said."""

from __future__ import annotations

from dataclasses import dataclass

from models.data.timeseries import FloatArray
from models.recursive import update_step


@dataclass(frozen=True, slots=True)
class UpdateState:
    """Everything that the next sample needs.

    Attributes
    ----------
    theta : (M, p) parameters in normalised units
    covariance : (M, p, p) of each local model's parameters
    filters, history : memory of the signals
    past, sensitivity : simulated outputs, newest first, and their derivatives
    held : last current, direction, SoC, temperature, samples seen
    """

    theta: FloatArray
    covariance: FloatArray
    filters: FloatArray
    history: FloatArray
    past: FloatArray
    sensitivity: FloatArray
    held: FloatArray

    def copy(self) -> UpdateState:
        """Return an independent copy."""
        return UpdateState(
            self.theta.copy(),
            self.covariance.copy(),
            self.filters.copy(),
            self.history.copy(),
            self.past.copy(),
            self.sensitivity.copy(),
            self.held.copy(),
        )

    @property
    def soc(self) -> float:
        """Counted or given state of charge after the last sample."""
        return float(self.held[update_step.SOC])

    @property
    def n_samples(self) -> int:
        """Samples that the state has seen."""
        return int(self.held[update_step.SEEN])


@dataclass(frozen=True, slots=True)
class UpdateOutput:
    """What a sample said: the free run before the update, its error (NaN where nothing was measured), its std."""

    model_voltage_V: float
    error_V: float
    error_std_V: float
