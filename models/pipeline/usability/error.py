"""Models that miss what they were made from, or what they have not seen."""

from __future__ import annotations

from models.data.metrics import Metrics
from models.pipeline.usability.reason import Reason, limited, unusable

# Share of the voltage's range: at a twentieth, a voltage tells the charge to no better than a tenth or so; at a seventh
# the model is no better than a straight line through the charge. The mean alone is off by 0.29 of the range where the
# voltage is spread evenly.
_POOR, _USELESS = 0.05, 0.15


def misses_runs(train: Metrics, validation: Metrics | None) -> list[Reason]:
    """Whether the free run misses its training runs, or the runs that judge it."""
    found = []
    for figures, what in ((train, "the runs that it was made from"), (validation, "the runs that judge it")):
        if figures is None or not figures["nrmse"] > _POOR:
            continue
        reason = unusable if figures["nrmse"] > _USELESS else limited
        found.append(
            reason(
                f"the model misses {what} by {figures['rmse_mV']:.0f} mV, {100 * figures['nrmse']:.0f} % of the "
                "voltage's range: capacity, states of charge at the start, time stamps or the cell are not what was "
                "stated; look there first"
            )
        )
    return found
