"""A current that keeps bounds, ramp, state of charge and net charge together: a linear program."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.limiter import FlatLimits
from models.design.constraints.limits import CurrentBounds, InfeasibleError, Limits


def linear_anchor(
    limits: Limits, bounds: CurrentBounds, flat: FlatLimits, soc_per_A: float, initial_soc: float, dt_s: float
) -> FloatArray:
    """Find such a current, with the state of charge as unknowns beside the current.

    Raises
    ------
    InfeasibleError
        There is none; the message names the limits that stand against each other.
    """
    n = len(flat.low_A)
    low, high = bounds.at(np.full(n, initial_soc))
    solution = _solve(low, high, flat, soc_per_A, initial_soc, limits.ramp_A_per_s is not None)
    if solution is not None:
        return solution
    against = ["soc"] if limits.net_charge_Ah is None else ["soc", "net_charge_Ah"]
    if limits.ramp_A_per_s is not None and _solve(low, high, flat, soc_per_A, initial_soc, False) is not None:
        against.append("ramp_A_per_s")
    raise InfeasibleError(
        f"limits {', '.join(against)} and current_A are in conflict: no current keeps them together from SoC "
        f"{initial_soc:g} over {n * dt_s:g} s"
    )


def _solve(
    low: FloatArray, high: FloatArray, flat: FlatLimits, soc_per_A: float, initial_soc: float, ramp: bool
) -> FloatArray | None:
    """Unknowns: N currents, then N states of charge after each; any solution will do."""
    # Lazy: 0.6 s of processor time.
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, diags_array, hstack, vstack

    n = len(low)
    eye = diags_array(np.ones(n))
    before = diags_array(-np.ones(n - 1), offsets=-1, shape=(n, n)) if n > 1 else csr_array((1, 1))
    balance = hstack([-soc_per_A * eye, eye + before])
    start = np.zeros(n)
    start[0] = initial_soc
    inequality, right = None, None
    if ramp:
        change = hstack([eye + before, csr_array((n, n))])
        inequality = vstack([change, -change])
        right = np.concatenate([np.full(n, flat.rise_A), np.full(n, flat.fall_A)])
    limits_of = [*zip(low, high, strict=True), *zip(flat.soc_low[1:], flat.soc_high[1:], strict=True)]
    found = linprog(
        np.zeros(2 * n), A_ub=inequality, b_ub=right, A_eq=balance, b_eq=start, bounds=limits_of, method="highs"
    )
    return found.x[:n] if found.status == 0 else None
