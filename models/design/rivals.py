"""Rival models of a test that is to tell them apart: given as they are, or by the effects that a model may lack."""

from __future__ import annotations

from collections.abc import Sequence

from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.design.optimise.ascent import Progress
from models.design.request import RequestError
from models.effects import effects
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.addition import add_effect


def is_effect(name: str) -> bool:
    """Whether a rival's name is that of an effect; any other names a model."""
    return name in effects()


def rival_models(
    rivals: Sequence[LocalModelNetwork | str],
    parent: LocalModelNetwork | None,
    runs: Sequence[TimeSeries],
    runs_soc: Sequence[float],
    progress: Progress | None = None,
) -> tuple[LocalModelNetwork, LocalModelNetwork]:
    """Two models; an effect is put into the parent and refitted.

    Parameters
    ----------
    rivals : two models or names of effects, in any mixture
    parent : model that the effects are added to
    runs, runs_soc : that they are refitted to; no states of charge: the first reference value of each
    progress : called with a share 0..1 and a short text

    Raises
    ------
    RequestError
        Not two, twice the same, or an effect without a model and runs.
    ModelError
        An effect that the model has already.
    """
    report = progress or (lambda share, text: None)
    if len(rivals) != 2:
        raise RequestError(
            f"criterion discriminate tells two models apart, but rivals names {len(rivals)}: name two models, two "
            "effects, or a model and an effect"
        )
    names = [each for each in rivals if isinstance(each, str)]
    if len(names) == 2 and names[0] == names[1]:
        raise RequestError(f"rivals names {names[0]!r} twice; name two that differ")
    if names and (parent is None or not runs):
        lacking = "model" if parent is None else "runs"
        raise RequestError(
            f"rivals names the effect {names[0]!r}, but {lacking} is missing: an effect is put into model and refitted "
            "to runs"
        )
    soc = list(runs_soc) or [start_soc(run) for run in runs]
    found = []
    for number, rival in enumerate(rivals):
        if isinstance(rival, str):
            assert parent is not None  # checked above
            report(0.5 * number, f"refitting the model with {rival}")
            rival = add_effect(parent, rival, list(runs), soc, list(runs), soc).network
        found.append(rival)
    return found[0], found[1]
