"""How good an estimated state of charge was, against a reference."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray

# An estimate has converged from the moment on after which its error stays below this.
CONVERGED_SOC = 0.03
_TWO_SIDED_95 = 1.959963984540054
FIGURES = ("soc_rmse", "soc_max_error", "soc_end_error", "converged_after_s", "coverage_95")


def soc_figures(
    time_s: FloatArray, soc: FloatArray, soc_std: FloatArray, soc_ref: FloatArray | None
) -> dict[str, float | None]:
    """Judge estimates by a reference.

    Parameters
    ----------
    time_s, soc, soc_std : (n,)
    soc_ref : (n,) NaN where unknown, or None

    Returns
    -------
    dict
        `soc_rmse`, `soc_max_error` and `coverage_95` (share within 1.96 standard deviations) count from
        `converged_after_s` on, or the whole run where it never converges; all are None without a reference.
    """
    if soc_ref is None or np.isnan(soc_ref).all():
        return dict.fromkeys(FIGURES)
    known = ~np.isnan(soc_ref) & ~np.isnan(soc)
    if not known.any():
        return dict.fromkeys(FIGURES)
    error = soc[known] - soc_ref[known]
    off = np.flatnonzero(np.abs(error) >= CONVERGED_SOC)
    first = 0 if len(off) == 0 else int(off[-1]) + 1
    converged_after_s = None if first == len(error) else float(time_s[known][first] - time_s[0])
    counted = slice(0 if converged_after_s is None else first, None)
    inside = np.abs(error[counted]) <= _TWO_SIDED_95 * soc_std[known][counted]
    values = (
        float(np.sqrt(np.mean(error[counted] ** 2))),
        float(np.max(np.abs(error[counted]))),
        float(error[-1]),
        converged_after_s,
        float(np.mean(inside)),
    )
    return dict(zip(FIGURES, values, strict=True))
