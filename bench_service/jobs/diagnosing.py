"""What worker processes do to find what a model lacks; arguments and results are plain data, as in `jobs.modelling`.

The models are imported inside the functions: the service names these functions without ever calling them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.refitting import version_errors
from bench_service.jobs.results import DesignResult, Document, VersionResult
from bench_service.jobs.series import RunInput, noise_floor_mV, read_series
from bench_service.store.records import Json
from models.data.seal import sealed


def diagnose_runs(
    report: Reporter,
    data_dir: Path,
    document: Document,
    runs: Sequence[RunInput],
    train: Sequence[RunInput],
    mode: Literal["structure", "change"],
    initial_soc_std: float | None = None,
) -> Json:
    """Diagnose stored runs; gives the ``diagnose`` object of the public contract."""
    # Lazy: numba and scipy take 890 ms.
    from models.diagnosis import diagnose
    from models.network.local_model_network import LocalModelNetwork

    report(0.0, "reading samples")
    series, learned = _read(data_dir, runs), _read(data_dir, train)
    report(0.0, "holding every known effect against the error")
    network = LocalModelNetwork.from_json(document)
    diagnosis = diagnose(
        network,
        series,
        _soc(runs),
        train=learned or None,
        train_soc=_soc(train) or None,
        mode=mode,
        soc_std=None if initial_soc_std is None else [initial_soc_std] * len(runs),
    )
    return plain(diagnosis.to_json() | {"usability": network.record.usability})


def add_effect_to(
    report: Reporter,
    data_dir: Path,
    document: Document,
    effect: str,
    train: Sequence[RunInput],
    validate: Sequence[RunInput],
) -> VersionResult:
    """Put an effect into a model and refit it to stored runs.

    Returns
    -------
    dict
        ``document`` (MODEL.json of the new version), ``structure`` and ``capacity_Ah`` of it, and ``metrics``:
        ``effect``, ``error_before_mV`` and ``error_after_mV`` over the validation runs, the same apart ``inside`` and
        ``outside`` of the ranges that the model was trained in, ``parameters``, ``remark``, ``noise_floor_mV`` (null
        where it cannot be told).
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.network.local_model_network import LocalModelNetwork
    from models.observer.tuning.tuning import with_tuned_observer
    from models.pipeline.addition import add_effect

    report(0.02, "reading samples")
    learned, judged = _read(data_dir, train), _read(data_dir, validate)
    parent = LocalModelNetwork.from_json(document)
    report(0.05, f"sizing {effect} on the training runs")
    added = add_effect(
        parent,
        effect,
        learned,
        _soc(train),
        judged,
        _soc(validate),
        progress=lambda share, text="": report(0.1 + 0.8 * share, text),
    )
    report(0.92, "tuning the observer")
    network = with_tuned_observer(added.network, learned, _soc(train))
    parameters = {
        name: {"value": each.value, "std": each.std, "unit": each.unit} for name, each in added.parameters.items()
    }
    metrics = {
        "effect": added.effect,
        **version_errors(added.before, added.after),
        "parameters": parameters,
        "remark": added.remark,
        "usability": network.record.usability,
        "noise_floor_mV": noise_floor_mV(judged, parent.structure.dt_s),
    }
    return plain(
        {
            "document": sealed(plain(network.to_json())),
            "structure": network.structure.name,
            "capacity_Ah": network.cell.capacity_Ah,
            "metrics": metrics,
        }
    )


def design_between(
    report: Reporter,
    data_dir: Path,
    document: Document,
    request: Json,
    train: Sequence[RunInput],
    runs: Sequence[RunInput],
) -> DesignResult:
    """Design the profile on which two effects differ most: each is put into the model, the two are told apart.

    Parameters
    ----------
    document : dict
        MODEL.json.
    request : dict
        As a diagnosis gives it in ``next_experiment``; ``rivals`` are two effects.
    train : sequence of RunInput
        Runs that both are refitted to.
    runs : sequence of RunInput
        Runs that the diagnosis was about.

    Returns
    -------
    dict
        ``time_s`` and ``current_A`` of the profile, and ``figures``: the ``design`` object of the public contract.
    """
    # Lazy: numba and scipy take 1.1 s.
    from models.design.answer import Material, answer
    from models.design.request import read_request
    from models.network.local_model_network import LocalModelNetwork
    from models.pipeline.addition import add_effect

    report(0.0, "reading samples")
    learned, judged = _read(data_dir, train), _read(data_dir, runs)
    parent, rivals = LocalModelNetwork.from_json(document), []
    for number, effect in enumerate(request["rivals"]):
        report(0.25 * number, f"refitting the model with {effect}")
        rivals.append(add_effect(parent, effect, learned, _soc(train), judged, _soc(runs)).network)
    found = answer(
        read_request(request),
        Material(rivals=tuple(rivals)),
        lambda share, text="": report(0.5 + 0.5 * share, text),
    )
    return plain({"time_s": found.profile.time_s, "current_A": found.profile.current_A, "figures": found.figures})


def map_errors(report: Reporter, data_dir: Path, document: Document, runs: Sequence[RunInput]) -> Json:
    """Say where a model is off on stored runs, see `models.comparison.where.error_map`."""
    # Lazy: numba and scipy take 1.1 s.
    from models.comparison.placed_runs import place_runs
    from models.comparison.where import error_map
    from models.module.network import model_from_json

    network = model_from_json(document)
    return plain(error_map(network, place_runs(network, _read(data_dir, runs), _soc(runs))))


def _read(data_dir: Path, runs: Sequence[RunInput]) -> list[Any]:
    return read_series(data_dir, runs) if runs else []


def _soc(runs: Sequence[RunInput]) -> list[float]:
    return [run.initial_soc for run in runs]
