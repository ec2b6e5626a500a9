"""Training runs whose voltage and current were not logged at the same time, put in step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from models.data.resampling import to_grid, typical_interval_s
from models.effects import effects
from models.effects.input_correction import corrected
from models.identification.dead_time import dead_time
from models.identification.excitation import check_series
from models.network.model_record import AddedEffect, EffectValue
from models.pipeline.request.fit_request import FitRequest


@dataclass(frozen=True)
class InStep:
    """A request with training runs whose voltage answers the current at once.

    Attributes
    ----------
    request : its training runs put right
    effects : what a model of them says of every further run; empty where nothing was to be put right
    remarks : what is to be said
    """

    request: FitRequest
    effects: tuple[AddedEffect, ...] = ()
    remarks: tuple[str, ...] = ()


def in_step(request: FitRequest) -> InStep:
    """Find a delay of whole samples between voltage and current, and take it out of the training runs.

    Raises
    ------
    NotIdentifiableError, ModelError
        The runs cannot be read as measurements of a cell.
    """
    if request.in_step or not request.train or not (math.isfinite(request.capacity_Ah) and request.capacity_Ah > 0.0):
        return InStep(request)
    dt_s = request.dt_s if request.dt_s is not None else typical_interval_s(request.train)
    check_series(request.train, dt_s, request.capacity_Ah)
    found = dead_time([to_grid(run, dt_s) for run in request.train])
    if found is None or found.samples == 0:
        return InStep(request)
    delay_s = found.samples * dt_s
    chosen = next(each for each in effects().values() if each.correction and each.correction.delay_s)
    (parameter,) = chosen.parameters
    train = [corrected(run, chosen, {parameter.name: delay_s}) for run in request.train]
    # Told to the nearest sample.
    value: EffectValue = {"value": delay_s, "std": dt_s / math.sqrt(12.0), "unit": parameter.unit}
    entry: AddedEffect = {
        "effect": chosen.name,
        "parameters": {parameter.name: value},
        "correction": True,
        "error_before_mV": 1e3 * found.before_V,
        "error_after_mV": 1e3 * found.after_V,
    }
    side = "after" if delay_s > 0.0 else "before"
    count = f"{abs(found.samples)} sample{'s' if abs(found.samples) > 1 else ''}"
    remark = (
        f"the voltage comes {abs(delay_s):g} s {side} the current ({count}): the runs were put in step, and every "
        "further run of this rig is read so"
    )
    return InStep(replace(request, train=train), (entry,), (remark,))
