"""What to say of diagnosed runs that go beyond what the model was made from."""

from __future__ import annotations

import numpy as np

from models.comparison.reach import inside_by
from models.diagnosis.answer.findings import Mode
from models.diagnosis.reference.record import Record
from models.network.local_model_network import LocalModelNetwork
from models.network.signals.charge_counting import soc_by_counting

# A few samples out there decide nothing.
_TOLD_SHARE = 0.02
_NAMES = {
    "soc": ("states of charge", ""),
    "current_A": ("currents", " A"),
    "temperature_degC": ("temperatures", " degC"),
}


def beyond_remarks(network: LocalModelNetwork, record: Record, mode: Mode) -> list[str]:
    """Tell of the samples whose state of charge, current or temperature no training run had, in words.

    Change mode leaves samples beyond the trained state of charge out, and says so itself.
    """
    cell = network.cell
    soc = [
        soc_by_counting(run.charge_Ah, start, cell.capacity_Ah, cell.efficiency)
        for run, start in zip(record.runs, record.soc, strict=True)
    ]
    inside = [inside_by(network, run, counted) for run, counted in zip(record.runs, soc, strict=True)]
    said = []
    for name, (called, unit) in _NAMES.items():
        if name not in network.record.domain or (name == "soc" and mode == "change"):
            continue
        outside = ~np.concatenate([each[name] for each in inside])
        if outside.mean() < _TOLD_SHARE:
            continue
        values = np.concatenate(soc if name == "soc" else [getattr(run, name) for run in record.runs])[outside]
        low, high = network.record.domain[name]
        said.append(
            f"{100.0 * outside.mean():.0f} % of the samples are at {called} ({values.min():.3g} to "
            f"{values.max():.3g}{unit}) that no training run had ({low:.3g} to {high:.3g}{unit}): what is named may be "
            "the model's own error there; train on a run of such samples too"
        )
    return said
