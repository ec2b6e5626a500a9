"""All reasons together."""

from __future__ import annotations

from collections.abc import Iterable

from models.data.metrics import Metrics
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json
from models.pipeline.training import Training
from models.pipeline.usability.coverage import not_covered
from models.pipeline.usability.direction import one_direction
from models.pipeline.usability.error import misses_runs
from models.pipeline.usability.lost import lost_samples
from models.pipeline.usability.offset import suspected_offset
from models.pipeline.usability.reason import Reason, Verdict, usability
from models.pipeline.usability.resistance import bad_resistance
from models.pipeline.usability.resolution import coarse_values
from models.pipeline.usability.rests import no_rest
from models.pipeline.usability.sampling import logged_too_slowly
from models.pipeline.usability.start import soc_on_trust
from models.pipeline.usability.steps import no_steps
from models.pipeline.usability.temperature import interrupted_temperature, no_temperature


def judged_model(
    network: LocalModelNetwork,
    data: Training,
    train: Metrics,
    validation: Metrics | None,
    remarks: Iterable[str] = (),
) -> Json:
    """Verdict on a model, with its reasons: the `usability` object of the public contract.

    Parameters
    ----------
    network : with its tables read out
    data : that it was made from
    train, validation : its free-run figures
    remarks : what else is to be said, without bearing on the verdict
    """
    said = [Reason(Verdict.USABLE, text) for text in remarks]
    return usability([*misses_runs(train, validation), *bad_resistance(network), *judged_data(data), *said])


def judged_data(data: Training) -> list[Reason]:
    """What the runs themselves leave open, whatever is made from them."""
    kinds = (
        one_direction,
        no_steps,
        no_rest,
        not_covered,
        logged_too_slowly,
        coarse_values,
        suspected_offset,
        lost_samples,
        no_temperature,
        interrupted_temperature,
        soc_on_trust,
    )
    return [reason for kind in kinds for reason in kind(data)]
