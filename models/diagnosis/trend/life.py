"""What a trend answers: frozen data, and its form in the public contract."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from models.diagnosis.answer.findings import Diagnosis
from models.diagnosis.trend.answer import effect_of
from models.diagnosis.trend.estimate import State
from models.diagnosis.trend.forecast import Forecast
from models.diagnosis.trend.series import ChangePoint
from models.readouts.stages import Stages


@dataclass(frozen=True)
class Places:
    """Where the runs lie along the life of a cell.

    Attributes
    ----------
    at : of each run, never falling; None: the runs are counted
    unit : of it
    end : share of the capacity that is the end
    """

    at: list[float] | None = None
    unit: str = "run"
    end: float = 0.8


@dataclass(frozen=True)
class RunTrend:
    """One run.

    Attributes
    ----------
    run : its name
    at : its place along the life
    state : of the cell
    error_mV : of the model of the cell as it was, free run
    diagnosis : against the cell as it was; empty of findings where the series as a whole does not bear them out
    """

    run: str
    at: float
    state: State
    error_mV: float
    diagnosis: Diagnosis

    def to_json(self) -> dict[str, Any]:
        """Return an entry of `runs` of the public contract."""
        state, diagnosis = self.state, self.diagnosis
        told = zip(state.soc, state.resistance_Ohm, state.resistance_std_Ohm, strict=True)
        return {
            "run": self.run,
            "at": self.at,
            "capacity_Ah": {"value": state.capacity_Ah, "std": state.capacity_std_Ah},
            "resistance": [{"soc": float(s), "value_Ohm": float(r), "std_Ohm": float(d)} for s, r, d in told],
            "slip": {"value": state.slip, "std": state.slip_std},
            "loop_mV": {"value": 1e3 * state.loop_V, "std": 1e3 * state.loop_std_V},
            "verdict": diagnosis.verdict,
            "findings": [finding.to_json() for finding in diagnosis.findings],
            "error_mV": self.error_mV,
            "unexplained_mV": diagnosis.unexplained_mV,
            "remarks": list(diagnosis.remarks),
        }


@dataclass(frozen=True)
class Trend:
    """The answer.

    Attributes
    ----------
    runs : in the order given
    changes : where what lasts to the end began
    forecast : of the capacity; None: too few runs
    seconds : time it took
    stages : dQ/dV and dV/dQ of some runs
    fresh_Ah : capacity of the cell as it was
    unit : of the runs' places
    """

    runs: tuple[RunTrend, ...]
    changes: tuple[ChangePoint, ...]
    forecast: Forecast | None
    seconds: float
    stages: tuple[Stages, ...] = ()
    fresh_Ah: float | None = None
    unit: str = "run"

    def to_json(self) -> dict[str, Any]:
        """Return the `trend` object of the public contract."""
        names = [each.run for each in self.runs]
        changes = [
            {
                "effect": effect_of(each.change),
                "run": names[each.first],
                "at": self.runs[each.first].at,
                "between": [names[each.low], names[each.high]],
                "probability": each.probability,
            }
            for each in self.changes
        ]
        return {
            "runs": [each.to_json() for each in self.runs],
            "fresh_capacity_Ah": self.fresh_Ah,
            "unit": self.unit,
            # What the last run leaves open is open today.
            "next_experiment": self.runs[-1].diagnosis.next_experiment,
            "change_points": changes,
            "stages": [each.to_json() for each in self.stages],
            "forecast": None if self.forecast is None else self.forecast.to_json(),
            "seconds": self.seconds,
        }
