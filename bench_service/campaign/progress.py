"""What the stages of a campaign have produced so far, and the result that is made of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import NotRequired, TypedDict

from bench_service.campaign.request import OBSERVER_OFFSET_SOC
from bench_service.jobs.results import ComparisonResult, FitMetrics, Metrics, SocFigures, VersionAnswer
from bench_service.store.records import Json, RunRecord


@dataclass(slots=True)
class Round:
    """One round of a campaign: a training run more, and the model of all of them so far."""

    role: str
    model_id: str
    fit: FitMetrics
    design: Json | None = None
    held_out: Metrics | None = None

    @property
    def validation_rmse_mV(self) -> float:
        """Error on the run that no fit saw; known once the models have been compared."""
        assert self.held_out is not None
        return self.held_out["rmse_mV"]


@dataclass(slots=True)
class Progress:
    """What the stages have produced so far; `parts` are the runs of each role, more than one where it was cut off."""

    profiles: dict[str, str] = field(default_factory=dict)
    parts: dict[str, list[RunRecord]] = field(default_factory=dict)
    designs: dict[str, Json] = field(default_factory=dict)
    rounds: list[Round] = field(default_factory=list)
    comparison_id: str = ""
    comparison: ComparisonResult | None = None
    diagnosis: Json | None = None
    addition: VersionAnswer | None = None
    result: Json = field(default_factory=dict)

    @property
    def runs(self) -> dict[str, RunRecord]:
        """Of each role that has been played the last run."""
        return {role: parts[-1] for role, parts in self.parts.items() if parts}

    def ids(self, role: str) -> list[str]:
        """Runs of a role, in their order."""
        return [run.id for run in self.parts[role]]

    def longest(self, role: str) -> RunRecord:
        """Of the runs of a role the one with the most samples."""
        return max(self.parts[role], key=lambda run: run.n_samples or 0)

    def to_json(self) -> Json:
        """Return what a later service goes on from; the runs it finds in the store."""
        return {
            "profiles": self.profiles,
            "designs": self.designs,
            "rounds": [asdict(each) for each in self.rounds],
            "comparison_id": self.comparison_id,
            "comparison": self.comparison,
            "diagnosis": self.diagnosis,
            "addition": self.addition,
            "completed": sum(run.state == "completed" for run in self.runs.values()),
        }

    @classmethod
    def from_json(cls, document: Json, parts: dict[str, list[RunRecord]]) -> Progress:
        """Read what `to_json` wrote, with the runs that were played."""
        names = ("profiles", "designs", "comparison_id", "comparison", "diagnosis", "addition")
        fields: Json = {name: document[name] for name in names if name in document}
        return cls(**fields, rounds=[Round(**each) for each in document.get("rounds", [])], parts=parts)

    @property
    def model_id(self) -> str:
        """Of the last round."""
        return self.rounds[-1].model_id

    @property
    def learned(self) -> list[str]:
        """Runs that the last model was made from."""
        return [run_id for each in self.rounds for run_id in self.ids(each.role)]


class PlayedRound(TypedDict):
    """One round in the result."""

    round: int
    run_id: str
    model_id: str
    train_rmse_mV: float
    validation_rmse_mV: float
    design: Json | None


class ChainLink(TypedDict):
    """One version of the model in the result; an added effect has its parameters."""

    model: str
    effect: str | None
    validation_rmse_mV: float
    parameters: NotRequired[Json]


def campaign_result(done: Progress, soc: SocFigures | None) -> Json:
    """Return the result of a campaign as far as its stages have come: what they did not reach is left out.

    Parameters
    ----------
    done : what they produced
    soc : figures of the live observer on the last run; None: there are none
    """
    played = [(role, run) for role, parts in done.parts.items() for run in parts]
    result: Json = {
        "runs": [
            {
                "run_id": run.id,
                "role": role,
                "initial_soc": run.initial_soc,
                "n_samples": run.n_samples,
                "missed_ticks": run.missed_ticks,
            }
            for role, run in played
        ],
        "samples": sum(run.n_samples or 0 for _, run in played),
        "missed_ticks": sum(run.missed_ticks or 0 for _, run in played),
        "diagnosis": done.diagnosis,
    }
    if done.rounds:
        result |= {"model_id": done.model_id, "train": done.rounds[-1].fit["train"]}
    if done.comparison is not None:
        result |= {
            "validation": done.comparison["overall"],
            "sensor_noise_mV": done.comparison["noise_floor_mV"],
            "rounds": _rounds(done),
            "model_chain": _model_chain(done),
            "comparison_id": done.comparison_id,
        }
    return result if soc is None else result | {"soc": _soc(soc)}


def _soc(soc: SocFigures) -> Json:
    return {
        "rmse": soc["soc_rmse"],
        "max_error": soc["soc_max_error"],
        "end_error": soc["soc_end_error"],
        "converged_after_s": soc["converged_after_s"],
        "coverage_95": soc["coverage_95"],
        "started_off_by": OBSERVER_OFFSET_SOC,
    }


def _rounds(done: Progress) -> list[PlayedRound]:
    """What each round played, and the error that its model makes on the run that no fit saw."""
    return [
        {
            "round": number,
            "run_id": done.runs[each.role].id,
            "model_id": each.model_id,
            "train_rmse_mV": each.fit["train"]["rmse_mV"],
            "validation_rmse_mV": each.validation_rmse_mV,
            "design": each.design,
        }
        for number, each in enumerate(done.rounds, 1)
    ]


def _model_chain(done: Progress) -> list[ChainLink]:
    """Every version with its error on runs that it never saw; an added effect with that before and after it."""
    added = done.addition
    chain: list[ChainLink] = [
        {"model": each.model_id, "effect": None, "validation_rmse_mV": each.validation_rmse_mV} for each in done.rounds
    ]
    if added is not None:
        chain[-1]["validation_rmse_mV"] = added["error_before_mV"]
        chain.append(
            {
                "model": added["model"],
                "effect": added["effect"],
                "validation_rmse_mV": added["error_after_mV"],
                "parameters": added["parameters"],
            }
        )
    return chain
