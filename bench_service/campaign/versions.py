"""Versions of a model: the line they descend by, what each was worth on runs it never saw, and which runs judge."""

from __future__ import annotations

from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES, Json, ModelRecord

_MOST_RUNS = 100


def chain(store: MetadataStore, model_id: str) -> Json:
    """Give a model's line of descent and everything that was ever tried beside it.

    Returns
    -------
    dict
        ``model_id``; ``chain``: ids from the first version to this one; ``noise_floor_mV``; ``models``: every
        version that descends from the same first one, oldest first, each with ``held_out`` (``rmse_mV``,
        ``before_mV`` of its parent on the same runs, ``run_ids``) or null where it was never judged.

    Raises
    ------
    NotFoundError
        No such model.
    """
    members = {member.id: member for member in store.models.family(model_id)}
    line = [model_id]
    while (parent_id := members[line[-1]].parent_id) is not None:
        line.append(parent_id)
    held_out = {each.id: _held_out(store, each, members) for each in members.values()}
    floors = [found["noise_floor_mV"] for k in reversed(list(members)) if (found := held_out[k])]
    return {
        "model_id": model_id,
        "chain": line[::-1],
        "noise_floor_mV": next((floor for floor in floors if floor is not None), None),
        "models": [_version(each, held_out[each.id], each.id in line) for each in members.values()],
    }


def _held_out(store: MetadataStore, model: ModelRecord, members: dict[str, ModelRecord]) -> Json | None:
    metrics = model.metrics or {}
    if "error_after_mV" in metrics:
        return {
            "rmse_mV": metrics["error_after_mV"],
            "before_mV": metrics["error_before_mV"],
            "noise_floor_mV": metrics.get("noise_floor_mV"),
            "run_ids": [run.run_id for run in model.validate],
        }
    return _judged_by_children(model, members) or _judged_by_comparison(store, model)


def _judged_by_children(model: ModelRecord, members: dict[str, ModelRecord]) -> Json | None:
    """A version is judged on the runs that its first child was, so that the steps can be set side by side."""
    child = next((each for each in members.values() if each.parent_id == model.id and each.metrics), None)
    if child is None or child.metrics is None or "error_before_mV" not in child.metrics:
        return None
    return {
        "rmse_mV": child.metrics["error_before_mV"],
        "before_mV": None,
        "noise_floor_mV": child.metrics.get("noise_floor_mV"),
        # A version that was learned from a run has first shown on it what its parent was worth.
        "run_ids": [run.run_id for run in child.validate or child.train],
    }


def _judged_by_comparison(store: MetadataStore, model: ModelRecord) -> Json | None:
    learned = {run.run_id for run in model.train}
    for record in store.comparisons.page(model.id):
        if not learned & set(record.run_ids):
            return {
                "rmse_mV": record.result["overall"]["rmse_mV"],
                "before_mV": None,
                "noise_floor_mV": record.result["noise_floor_mV"],
                "run_ids": list(record.run_ids),
            }
    return None


def judging_runs(store: MetadataStore, model: ModelRecord) -> list[str]:
    """Runs that judge a model where nobody names any: its own, else those of its campaign that it has not seen."""
    if model.validate:
        return [run.run_id for run in model.validate]
    learned = {run.run_id for run in model.train}
    if model.campaign_id is not None:
        found = store.runs.page(campaign_id=model.campaign_id, limit=_MOST_RUNS)
        runs = [run.id for run in reversed(found) if run.state not in OPEN_RUN_STATES and run.n_samples]
        if unseen := [run_id for run_id in runs if run_id not in learned]:
            return unseen
    judged = _judged_by_comparison(store, model)
    return [] if judged is None else judged["run_ids"]


def _version(model: ModelRecord, held_out: Json | None, on_path: bool) -> Json:
    metrics = model.metrics or {}
    return {
        "id": model.id,
        "name": model.name,
        "parent_id": model.parent_id,
        "effect": metrics.get("effect"),
        "structure": model.structure,
        "created_utc": model.created_utc,
        "parameters": metrics.get("parameters"),
        "remark": metrics.get("remark"),
        "held_out": held_out,
        "in_chain": on_path,
    }
