"""Which of the module models S1 to S4 to take: the smallest that is as good as any on runs that it did not see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.errors import NotIdentifiableError
from models.data.metrics import Metrics, metrics
from models.data.timeseries import FloatArray
from models.module.models import KINDS, ModuleModel, ModuleRun, identify_module
from models.network.model_record import Json

# A larger model has to be better by this share.
_WORTH = 0.02
# Where no run can be left out, of each run every one of so many parts is left out in turn.
_PARTS = 4


@dataclass(frozen=True)
class Candidate:
    """One module model and how well it does.

    Attributes
    ----------
    model : identified from all training runs
    train, validation : free-run figures of the module's voltage; `validation` is None without runs to judge
    held_out_rmse_mV : on training runs that R and V_0 were not identified from; on parts of them where there is one
        run, or one alone of its direction
    """

    model: ModuleModel
    train: Metrics
    validation: Metrics | None
    held_out_rmse_mV: float

    def to_json(self) -> Json:
        """Return a document of plain types; R and V_0 while charging, and while resting or discharging."""
        model = self.model
        return {
            "kind": model.kind,
            "train": self.train,
            "validation": self.validation,
            "held_out_rmse_mV": self.held_out_rmse_mV,
            "resistance_Ohm": _both(model.resistance_Ohm, model.resistance_std_Ohm),
            "offset_V": _both(model.offset_V, model.offset_std_V),
        }


def candidates(
    train: list[ModuleRun], validate: list[ModuleRun], layout: tuple[int, int], rest_A: float
) -> tuple[list[Candidate], list[str]]:
    """Identify all module models.

    Returns
    -------
    Those that the data determine, the smallest first, and for the others why not.
    """
    models, reservations = {}, []
    for kind in KINDS:
        try:
            models[kind] = identify_module(kind, train, *layout, rest_A)
        except NotIdentifiableError as reason:
            reservations.append(str(reason))
    left_out_mV, open_reasons = _all_held_out_mV(list(models), train, layout, rest_A)
    found = []
    for kind, rmse_mV in left_out_mV.items():
        model = models[kind]
        judged = figures(model, validate) if validate else None
        found.append(Candidate(model, figures(model, train), judged, rmse_mV))
    return found, [*reservations, *open_reasons]


def chosen(found: list[Candidate]) -> Candidate:
    """Return the smallest that is as good as any on what it did not see."""
    least = min(each.held_out_rmse_mV for each in found)
    return next(each for each in found if each.held_out_rmse_mV <= (1.0 + _WORTH) * least)


def figures(model: ModuleModel, runs: list[ModuleRun]) -> Metrics:
    """Figures of a module model over runs."""
    simulated = [model.voltage_V(run.cell_voltage_V, run.current_A) for run in runs]
    return metrics(np.concatenate([run.voltage_V for run in runs]), np.concatenate(simulated))


def _all_held_out_mV(
    kinds: list[str], runs: list[ModuleRun], layout: tuple[int, int], rest_A: float
) -> tuple[dict[str, float], list[str]]:
    """Held-out error of each kind, all on the same runs or parts, and why others have none."""
    cut = [part for run in runs for part in _parts(run)]
    found = []
    for parts in (runs, cut) if len(runs) > 1 else (cut,):
        errors_mV, reasons = {}, []
        for kind in kinds:
            try:
                errors_mV[kind] = _held_out_mV(kind, parts, layout, rest_A)
            except NotIdentifiableError as reason:
                reasons.append(f"{reason}. That is so where a part of the runs is left out to judge the model by")
        found.append((errors_mV, reasons))
        if not reasons:
            break
    # Parts of one run are more alike than runs: only where they judge a kind that runs cannot.
    return max(found, key=lambda each: len(each[0]))


def _held_out_mV(kind: str, parts: list[ModuleRun], layout: tuple[int, int], rest_A: float) -> float:
    measured, simulated = [], []
    for number, part in enumerate(parts):
        others = [each for k, each in enumerate(parts) if k != number]
        model = identify_module(kind, others, *layout, rest_A)
        measured.append(part.voltage_V)
        simulated.append(model.voltage_V(part.cell_voltage_V, part.current_A))
    return metrics(np.concatenate(measured), np.concatenate(simulated))["rmse_mV"]


def _parts(run: ModuleRun) -> list[ModuleRun]:
    edges = np.linspace(0, len(run.voltage_V), _PARTS + 1).astype(int)

    def cut(values: FloatArray, k: int) -> FloatArray:
        return values[edges[k] : edges[k + 1]]

    return [
        ModuleRun(cut(run.voltage_V, k), cut(run.current_A, k), cut(run.cell_voltage_V, k), run.name)
        for k in range(_PARTS)
    ]


def _both(values: tuple[float, float], stds: tuple[float, float]) -> Json:
    names = ("charge", "discharge")
    return {name: {"value": v, "std": s} for name, v, s in zip(names, values, stds, strict=True)}
