"""What flowed before a run's first sample: an unknown inner state, in a few numbers that every kind of model takes in.

A log begins anywhere: in a pulse, in a relaxation, on either branch of a hysteresis loop. Whatever a model keeps in
mind (place in the loop, polarisation, surface concentration, past outputs) was made by current that flowed before, so a
start is a few mean currents of the time before it. The run is simulated with these samples put in front.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray

# Ages of the windows' edges: as fine as what is remembered of them. The oldest one turns a hysteresis loop over without
# leaving anything in branches of minutes.
_EDGES_S = (0.0, 20.0, 120.0, 600.0, 3600.0, 10_800.0)
# What flows within so long is anybody's guess, but for its mean.
_USUAL_S = 600.0
# A last window shorter than this share of what stands before it joins its neighbour.
_LEAST_GROWTH = 1.5


@dataclass(frozen=True)
class StartHistory:
    """Mean currents before a run's first sample.

    Attributes
    ----------
    edges_s : (w + 1,) ages in s that the windows lie between, 0 first
    currents_A : (w,) mean current of each window, the newest first; positive charges
    """

    edges_s: tuple[float, ...]
    currents_A: tuple[float, ...]


def going_on(run: GridRun, edges_s: tuple[float, ...]) -> StartHistory:
    """What flowed before a run that goes on as it went: in each window the mean current over as long after the start.

    Parameters
    ----------
    run : of which only current and grid count
    edges_s : of the windows, see `StartHistory`; the newest ones take the mean of ten minutes
    """
    counts = [max(1, round(max(edge, _USUAL_S) / run.dt_s)) for edge in edges_s[1:]]
    return StartHistory(edges_s, tuple(float(np.mean(run.current_A[:count])) for count in counts))


@dataclass(frozen=True)
class PlacedRun:
    """A run with its history in front.

    Attributes
    ----------
    run : on the same grid; the samples in front have no voltage and the temperature of the first measured sample
    initial_soc : at the first sample in front
    n_before : samples in front
    """

    run: GridRun
    initial_soc: float
    n_before: int


def history_edges_s(memory_s: float) -> tuple[float, ...]:
    """Edges of the windows for a model that remembers a current for `memory_s`; at least one window."""
    edges = [0.0, *(edge for edge in _EDGES_S[1:] if edge < memory_s)]
    end = min(max(memory_s, _EDGES_S[1]), _EDGES_S[-1])
    if len(edges) > 1 and end < _LEAST_GROWTH * edges[-1]:
        edges.pop()
    return (*edges, end)


def placed(
    run: GridRun,
    initial_soc: float,
    history: StartHistory,
    *,
    capacity_Ah: float,
    efficiency: float = 1.0,
    soc_range: tuple[float, float] = (0.0, 1.0),
) -> PlacedRun:
    """Put a history in front of a run.

    Parameters
    ----------
    run : on a model's grid
    initial_soc : at its first sample
    history : what flowed before
    capacity_Ah, efficiency : that count charge
    soc_range : the state of charge before the start is counted backwards, but not beyond this range: mean currents of
        hours stand for a state, not for charge that the cell could have held
    """
    before_A = _sampled(history, run.dt_s)
    n = len(before_A)
    flowing_A = np.concatenate([before_A[1:], run.current_A[:1]])
    step_Ah = flowing_A * run.dt_s / 3600.0
    moved = np.where(step_Ah > 0.0, efficiency, 1.0) * step_Ah / capacity_Ah
    low, high = min(soc_range[0], initial_soc), max(soc_range[1], initial_soc)
    soc = np.append(np.clip(initial_soc - np.cumsum(moved[::-1])[::-1], low, high), initial_soc)
    counted = np.diff(soc) * capacity_Ah
    counted = np.where(counted > 0.0, counted / efficiency, counted)
    charge_Ah = np.concatenate([[0.0], np.cumsum(counted)])
    return PlacedRun(_in_front(run, before_A, charge_Ah), float(soc[0]), n)


def _sampled(history: StartHistory, dt_s: float) -> FloatArray:
    """(n,) currents on a grid, the oldest first; at least one sample."""
    n = max(1, round(history.edges_s[-1] / dt_s))
    age_s = (np.arange(n)[::-1] + 0.5) * dt_s
    window = np.searchsorted(history.edges_s, age_s, side="right") - 1
    return np.asarray(history.currents_A, dtype=np.float64)[np.clip(window, 0, len(history.currents_A) - 1)]


def _in_front(run: GridRun, before_A: FloatArray, charge_Ah: FloatArray) -> GridRun:
    n = len(before_A)

    def padded(values: FloatArray, value: float) -> FloatArray:
        return np.concatenate([np.full(n, value), values])

    return replace(
        run,
        time_s=np.concatenate([run.time_s[0] - run.dt_s * np.arange(n, 0, -1), run.time_s]),
        current_A=np.concatenate([before_A, run.current_A]),
        voltage_V=padded(run.voltage_V, np.nan),
        temperature_degC=padded(run.temperature_degC, float(run.temperature_degC[0])),
        ambient_degC=None if run.ambient_degC is None else padded(run.ambient_degC, float(run.ambient_degC[0])),
        charge_Ah=np.concatenate([charge_Ah[:-1], charge_Ah[-1] + run.charge_Ah - run.charge_Ah[0]]),
        soc_ref=None if run.soc_ref is None else padded(run.soc_ref, np.nan),
        segment_starts=(0, *(n + start for start in run.segment_starts if start > 0)),
        measured=np.concatenate([np.zeros(n, dtype=bool), run.measured]),
        current_known=None
        if run.current_known is None
        else np.concatenate([np.ones(n, dtype=bool), run.current_known]),
    )


def first_part(run: GridRun, n: int) -> GridRun:
    """Cut a run to its first `n` samples."""
    if n >= len(run):
        return run
    return replace(
        run,
        time_s=run.time_s[:n],
        current_A=run.current_A[:n],
        voltage_V=run.voltage_V[:n],
        temperature_degC=run.temperature_degC[:n],
        ambient_degC=None if run.ambient_degC is None else run.ambient_degC[:n],
        charge_Ah=run.charge_Ah[:n],
        soc_ref=None if run.soc_ref is None else run.soc_ref[:n],
        segment_starts=tuple(start for start in run.segment_starts if start < n),
        measured=run.measured[:n],
        current_known=None if run.current_known is None else run.current_known[:n],
    )
