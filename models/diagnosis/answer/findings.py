"""What a diagnosis answers: frozen data, and its form in the public contract."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from models.diagnosis.evidence.parameters import Value

Verdict = Literal["missing", "nothing_missing", "ambiguous", "unknown_effect"]
Mode = Literal["structure", "change"]


@dataclass(frozen=True)
class Finding:
    """One effect with its evidence.

    Attributes
    ----------
    effect : name
    rank : 1 is what the verdict names
    error_before_mV, error_after_mV : free-run RMSE over the diagnosed runs as they are, and with the effect beside
        those named before it
    confidence : probability that the effect is right
    parameters : by name
    confounded_with : effects that these data cannot tell from it
    explanation : in words
    evidence : further figures, of the reference model and of the temperature; `beside`: effects named before it
    """

    effect: str
    rank: int
    error_before_mV: float
    error_after_mV: float
    confidence: float
    parameters: dict[str, Value]
    confounded_with: tuple[str, ...]
    explanation: str
    evidence: dict[str, Any] = field(default_factory=dict)

    @property
    def explained_share(self) -> float:
        """Share of the squared error that the effect explains."""
        if not self.error_before_mV > 0.0:
            return 0.0
        return 1.0 - (self.error_after_mV / self.error_before_mV) ** 2

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {
            "effect": self.effect,
            "rank": self.rank,
            "error_before_mV": self.error_before_mV,
            "error_after_mV": self.error_after_mV,
            "explained_share": self.explained_share,
            "confidence": self.confidence,
            "parameters": {
                name: {"value": each.value, "std": each.std, "unit": each.unit}
                for name, each in self.parameters.items()
            },
            "confounded_with": list(self.confounded_with),
            "explanation": self.explanation,
            "evidence": self.evidence,
        }


class Shown(NamedTuple):
    """The smallest size of an effect that would have been seen with 90 %, as it is told.

    Attributes
    ----------
    effect, size, unit : of its first parameter; None: no size would
    rms_mV, rms_K : what that makes of the runs' voltage, and of their temperature where that is looked at
    """

    effect: str
    size: float | None
    unit: str
    rms_mV: float | None = None
    rms_K: float | None = None


@dataclass(frozen=True)
class Diagnosis:
    """The answer.

    Attributes
    ----------
    verdict, mode : as in the public contract
    findings : by rank
    noise_floor_mV : of the measurement; None where it cannot be told
    unexplained_mV : what remains with everything that was found
    depends_on : variables that an unexplained error depends on, with strengths 0..1
    next_experiment : request for a profile that would settle what is open
    seconds : time it took
    remarks : what a person should know
    power : the smallest size of each effect that would have been seen with 90 %
    hides_best : the effects that could hide best where nothing was found
    """

    verdict: Verdict
    mode: Mode
    findings: tuple[Finding, ...]
    noise_floor_mV: float | None
    unexplained_mV: float
    depends_on: tuple[tuple[str, float], ...]
    next_experiment: dict[str, Any] | None
    seconds: float
    remarks: tuple[str, ...] = ()
    power: tuple[Shown, ...] = ()
    hides_best: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the `diagnose` object of the public contract."""
        return {
            "verdict": self.verdict,
            "mode": self.mode,
            "findings": [finding.to_json() for finding in self.findings],
            "noise_floor_mV": self.noise_floor_mV,
            "unexplained_mV": self.unexplained_mV,
            "depends_on": [{"variable": name, "strength": strength} for name, strength in self.depends_on],
            "next_experiment": self.next_experiment,
            "power": [each._asdict() for each in self.power],
            "hides_best": list(self.hides_best),
            "seconds": self.seconds,
            "remarks": list(self.remarks),
        }
