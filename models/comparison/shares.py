"""How a model's squared error and its time are shared out over one variable after the other."""

from __future__ import annotations

from typing import Any, TypedDict

import numpy as np

from models.comparison.samples import ErrorSamples, spread
from models.data.timeseries import FloatArray

_SOC_EDGES = np.concatenate([[-np.inf], np.linspace(0.1, 0.9, 9), [np.inf]])
_C_RATE_EDGES = np.array([-np.inf, -3.0, -2.0, -1.0, -0.5, -0.005, 0.005, 0.5, 1.0, 2.0, 3.0, np.inf])
_SINCE_STEP_EDGES_S = np.array([0.0, 10.0, 60.0, 600.0, np.inf])
_TEMPERATURE_STEP_K = 5.0
_PARTS = 5

Variable = tuple[str, str, FloatArray, FloatArray]

ErrorShare = TypedDict(
    "ErrorShare",
    {
        "variable": str,
        "from": float,
        "to": float,
        "unit": str,
        "rmse_mV": float,
        "bias_mV": float,
        "share_of_squared_error": float,
        "share_of_time": float,
    },
)
"""Error and time in one range of one variable."""


def error_shares(samples: ErrorSamples) -> list[ErrorShare]:
    """RMSE, share of the squared error and share of the time by each variable, the most telling range first.

    Returns
    -------
    list of dict
        Each with ``variable``, ``from``, ``to``, ``unit``, ``rmse_mV``, ``bias_mV`` (measured minus simulated, as in
        the overall figures), ``share_of_squared_error`` and ``share_of_time``. Variables: ``soc``, ``current_A``,
        ``direction`` of the last current, ``since_step_s``, ``throughput_Ah`` and ``time_h`` since the start of the
        first run and, where it was measured, ``temperature_degC``.
    """
    squared, total = samples.error_V**2, max(float((samples.error_V**2).sum()), 1e-300)
    rows: list[ErrorShare] = []
    for variable, unit, values, edges in _variables(samples):
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            chosen = (values >= low) & (values < high)
            if not chosen.any():
                continue
            rows.append(
                {
                    "variable": variable,
                    "from": float(max(low, values[chosen].min())),
                    "to": float(min(high, values[chosen].max())),
                    "unit": unit,
                    "rmse_mV": 1e3 * float(np.sqrt(squared[chosen].mean())),
                    "bias_mV": 1e3 * float(samples.error_V[chosen].mean()),
                    "share_of_squared_error": float(squared[chosen].sum() / total),
                    "share_of_time": float(chosen.mean()),
                }
            )
    return sorted(rows, key=_by_telling)


def telling(error_share: Any, time_share: Any) -> Any:
    """Scan statistic s ln(s/t) + (1-s) ln((1-s)/(1-t)) of shares of the squared error and of the time.

    It weighs how much error lies in a place against how little time; Kulldorff, Communications in Statistics 26, 1997,
    1481.
    """
    # In single precision the largest share below 1 would be 1.
    s, t = (np.clip(np.asarray(share, np.float64), 1e-12, 1.0 - 1e-9) for share in (error_share, time_share))
    return s * np.log(s / t) + (1.0 - s) * np.log((1.0 - s) / (1.0 - t))


def _by_telling(row: ErrorShare) -> float:
    """Sort key; where less error lies than time, the other way round."""
    score = float(telling(row["share_of_squared_error"], row["share_of_time"]))
    return -score if row["share_of_squared_error"] > row["share_of_time"] else score


def _variables(samples: ErrorSamples) -> list[Variable]:
    found: list[Variable] = [
        ("soc", "1", samples.soc, _SOC_EDGES),
        ("current_A", "A", samples.c_rate * samples.capacity_Ah, _C_RATE_EDGES * samples.capacity_Ah),
        ("direction", "sign", samples.direction, np.array([-1.5, 0.0, 1.5])),
        ("since_step_s", "s", samples.since_step_s, _SINCE_STEP_EDGES_S),
    ]
    time_h = samples.progress * samples.total_s / 3600.0
    for variable, unit, values in (("throughput_Ah", "Ah", samples.throughput_Ah), ("time_h", "h", time_h)):
        if spread(values) > 0.0:
            found.append((variable, unit, values, _even_parts(values)))
    temperature = samples.temperature_degC
    if not np.isnan(temperature).all():
        low = np.floor(np.nanmin(temperature) / _TEMPERATURE_STEP_K) * _TEMPERATURE_STEP_K
        edges = np.arange(low, np.nanmax(temperature) + _TEMPERATURE_STEP_K, _TEMPERATURE_STEP_K)
        found.append(("temperature_degC", "degC", temperature, np.append(edges, np.inf)))
    return found


def _even_parts(values: FloatArray) -> FloatArray:
    return np.append(np.linspace(values.min(), values.max(), _PARTS + 1)[:-1], np.inf)
