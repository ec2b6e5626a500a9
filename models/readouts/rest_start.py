"""State of charge at the start of a run that begins with a rest, from the model's open-circuit voltage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from models.data.errors import ModelError
from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.effects.input_correction import as_read
from models.network.local_model_network import LocalModelNetwork
from models.readouts.ocv import ocv_table, soc_from_rest_voltage

# A rest shorter than this says more of what the cell did before than of its state of charge.
SUFFICIENT_REST_S = 600.0
# Share of the rest, at its end, that is averaged and whose drift tells what has not relaxed yet.
_LAST_SHARE = 0.2
# What is left of an exponential approach, over what passed in that last share: this much where its time constant is two
# thirds of the rest, less where it is shorter.
_STILL_TO_COME = 3.0


def known_starts(
    runs: Sequence[TimeSeries], stated: Sequence[float] | None, network: LocalModelNetwork
) -> list[tuple[float, float | None]]:
    """State of charge at the start of each run: as stated, without a deviation; where nothing is, see `known_start`."""
    return [(soc, None) for soc in stated] if stated else [known_start(run, network) for run in runs]


def known_start(run: TimeSeries, network: LocalModelNetwork) -> tuple[float, float | None]:
    """State of charge at the start of a run: its first reference, else what the rest says that it begins with.

    Returns
    -------
    (soc, std)
        `std` is None for a reference; see `soc_from_rest` for that of a rest.

    Raises
    ------
    ModelError
        Neither tells it; see `soc_from_rest`.
    """
    try:
        return start_soc(run), None
    except ModelError:
        return soc_from_rest(run, network)


def check_start_known(run: TimeSeries, rest_A: float) -> None:
    """Refuse a run whose start `known_start` will not tell, before there is a network to ask; raises ModelError.

    Parameters
    ----------
    run : as measured
    rest_A : current magnitude up to which the cell counts as resting
    """
    try:
        start_soc(run)
    except ModelError:
        _end_of_rest(run, rest_A)


def soc_from_rest(run: TimeSeries, network: LocalModelNetwork) -> tuple[float, float]:
    """State of charge at the start of a run, with its standard deviation.

    Parameters
    ----------
    run : begins with a rest of at least SUFFICIENT_REST_S
    network : a model of the cell

    Returns
    -------
    (soc, std)
        The band covers the model's error, what the voltage still drifted, and both directions of the current before.

    Raises
    ------
    ModelError
        The run does not begin with such a rest, its voltage is missing there, or it lies outside the model's
        open-circuit curve.
    """
    run = as_read(network.record, run)
    last = _end_of_rest(run, network.cell.rest_A)
    known = last & ~np.isnan(run.voltage_V)
    time_s, voltage = run.time_s[known], run.voltage_V[known]
    slope_V_per_s = float(np.polyfit(time_s - time_s[-1], voltage, 1)[0])
    drift_V = _STILL_TO_COME * abs(slope_V_per_s) * (time_s[-1] - time_s[0])
    model_V = 1e-3 * network.record.train_rmse_mV(10.0)
    temperature = run.temperature_degC[last]
    measured = temperature[~np.isnan(temperature)]
    return soc_from_rest_voltage(
        ocv_table(network),
        float(np.mean(voltage)),
        float(np.hypot(max(model_V, 1e-3), drift_V)),
        temperature_degC=float(np.mean(measured)) if len(measured) else None,
    )


def _end_of_rest(run: TimeSeries, rest_A: float) -> NDArray[np.bool_]:
    """(n,) samples at the end of the rest that a run begins with; see `soc_from_rest`."""
    loaded = np.abs(np.nan_to_num(run.current_A, nan=np.inf)) > rest_A
    n = int(np.argmax(loaded)) if loaded.any() else len(run)
    rest_s = float(run.time_s[n - 1] - run.time_s[0]) if n > 1 else 0.0
    if rest_s < SUFFICIENT_REST_S:
        raise ModelError(
            f"{run.name}: it begins with {rest_s:.0f} s of rest; {SUFFICIENT_REST_S:.0f} s are needed for its state of "
            "charge to be read from the open-circuit voltage. Give it with --initial-soc"
        )
    last = (np.arange(len(run)) < n) & (run.time_s >= run.time_s[n - 1] - _LAST_SHARE * rest_s)
    if (last & ~np.isnan(run.voltage_V)).sum() < 2:
        raise ModelError(f"{run.name}: no voltage was measured in the rest that it begins with; give --initial-soc")
    return last
