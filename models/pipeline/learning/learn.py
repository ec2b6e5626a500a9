"""One run after the other into a model: each makes a version of its own, or says why it made none.

A run is first simulated as the model is: it has not seen it. Then it tells what the cell holds now, and the recursive
update (`models.recursive`) moves the local models sample by sample, held near what they were: a cell does not change
much from run to run, and one run does not excite everything. What came out is kept only where it simulates the run
better than before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from models.comparison.placed_runs import place_runs
from models.comparison.simulated_runs import RunComparison, beside
from models.data.metrics import Metrics, metrics
from models.data.timeseries import TimeSeries
from models.identification.progress import Progress, silent
from models.network.lineage import with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json
from models.pipeline.learning.capacity import Capacity, capacity_from, with_capacity
from models.pipeline.refitting import kept_record
from models.readouts.tables import read_out
from models.recursive.settings import UpdateSettings
from models.recursive.update import RecursiveUpdate

# How far one run may move a model; tried in this order, until the run is simulated better.
SETTINGS = (
    UpdateSettings(resistance_std=0.05, ocv_std_V=0.001),
    UpdateSettings(resistance_std=0.02, ocv_std_V=0.0003),
)
# Parts of the record that speak of other parameters than the new ones.
_STALE = ("tables", "residuals", "refinement", "candidates", "validation", "sums")


@dataclass(frozen=True)
class Learned:
    """What came of one run.

    Attributes
    ----------
    network : the next version, or the model as it was
    run : its name
    before, after : free-run figures on the run; before, the model had not seen it
    capacity : as the run shows it
    learned : whether there is a new version
    reason : in words
    """

    network: LocalModelNetwork
    run: str
    before: Metrics
    after: Metrics
    capacity: Capacity
    learned: bool
    reason: str

    def to_json(self) -> Json:
        """Return a document of plain types."""
        return {
            "run": self.run,
            "learned": self.learned,
            "reason": self.reason,
            "error_before_mV": self.before["rmse_mV"],
            "error_after_mV": self.after["rmse_mV"],
            "capacity_Ah": {"value": self.capacity.value_Ah, "std": self.capacity.std_Ah or None},
        }


def learn_from_runs(
    network: LocalModelNetwork,
    runs: Sequence[TimeSeries],
    initial_soc: Sequence[float],
    *,
    code_version: str = "unknown",
    progress: Progress | None = None,
) -> list[Learned]:
    """Learn from each run in turn.

    Parameters
    ----------
    network : the model to begin with
    runs : of the same cell, in time's order
    initial_soc : fraction of what the cell holds then at the start of each, taken as known
    code_version, progress : for the record; called with a share 0..1 and a short text

    Returns
    -------
    One for each run; each begins with the version of the one before.
    """
    report, found = progress or silent, []
    for number, (run, soc) in enumerate(zip(runs, initial_soc, strict=True)):
        report(number / len(runs), f"learning from {run.name}")
        found.append(learn_from_run(found[-1].network if found else network, run, soc, code_version))
    report(1.0, "done")
    return found


def learn_from_run(
    network: LocalModelNetwork, run: TimeSeries, initial_soc: float, code_version: str = "unknown"
) -> Learned:
    """Learn from one run; see `learn_from_runs`."""
    (seen,) = place_runs(network, [run], [initial_soc])
    before = _figures(seen)
    capacity = capacity_from(network, seen.run, seen.start, SETTINGS[0])
    holding = with_capacity(network, capacity.value_Ah)
    for settings in SETTINGS:
        made = _updated(holding, seen, settings)
        after = _figures(beside(made, seen.run, seen.start))
        if after["rmse_mV"] < before["rmse_mV"]:
            break
    else:
        reason = "nothing that the run says makes the model simulate it better; the model stays as it was"
        return Learned(network, run.name, before, before, capacity, False, reason)
    kept = kept_record(made, [run], [initial_soc], _STALE)
    made = replace(made, record=replace(kept, train=after))
    made = replace(made, record=replace(made.record, tables=dict(read_out(made))))
    made = with_version(
        made,
        "update",
        [run],
        parent=network,
        settings={"update": asdict(settings), "capacity_Ah": capacity.value_Ah, "capacity_std_Ah": capacity.std_Ah},
        errors={"train": after, "parent": before},
        code_version=code_version,
    )
    return Learned(made, run.name, before, after, capacity, True, _in_words(network, before, after, capacity))


def _updated(network: LocalModelNetwork, seen: RunComparison, settings: UpdateSettings) -> LocalModelNetwork:
    update, run = RecursiveUpdate(network, settings), seen.run
    degC = run.temperature_degC[np.isfinite(run.temperature_degC)]
    state = update.initial(seen.start.initial_soc, float(degC[0]) if len(degC) else 25.0)
    state, _ = update.replay(state, run.current_A, run.voltage_V, run.temperature_degC)
    return update.updated(state)


def _figures(compared: RunComparison) -> Metrics:
    return metrics(compared.run.voltage_V, compared.simulated_V)


def _in_words(network: LocalModelNetwork, before: Metrics, after: Metrics, capacity: Capacity) -> str:
    moved = capacity.value_Ah / network.cell.capacity_Ah - 1.0
    holds = (
        f"capacity {capacity.value_Ah:.3f} +- {capacity.std_Ah:.3f} Ah ({100 * moved:+.2f} %)"
        if capacity.std_Ah
        else "the run does not tell the capacity"
    )
    return f"{before['rmse_mV']:.2f} mV on the run before it was seen, {after['rmse_mV']:.2f} mV after; {holds}"
