"""What differs from group to group of a module, and which one is weak.

A group in series carries the module's current, so that it can differ in what it holds, in where it stands and in its
resistance. The three are estimated from the difference between the group's voltage and the mean of all groups: what the
cell's model is wrong by is in both, and falls out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.module.log import LEAST_SAMPLES, ModuleLog
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json
from models.uncertainty.correlated_errors import least_squares_covariance

_ROUNDS = 6
# Steps of the derivatives: relative capacity, fraction of SoC.
_MOVED = (0.005, 0.003)
# A group is weak where it holds less than the mean by so many standard deviations, and by this share of the capacity.
_SURE_SIGMA, _LEAST_SHARE = 3.0, 0.01
# Beyond these the group is no cell of this kind.
_LARGEST = np.array([0.5, 0.3])


@dataclass(frozen=True)
class Group:
    """What is different in one group, each value with its standard deviation.

    Attributes
    ----------
    number : from 1, as the columns count
    capacity_Ah : what it holds, at the module's current
    soc_offset : by how much more it is charged than the mean when the mean is full, fraction of its capacity
    resistance_Ohm : beyond the mean's, of the whole group
    until_empty_Ah : what it gives from full modules down to its own empty
    lowest_V, mean_lowest_V : its lowest voltage, and the lowest of the groups' mean
    rmse_mV : what the three leave of its difference from the mean
    """

    number: int
    capacity_Ah: tuple[float, float]
    soc_offset: tuple[float, float]
    resistance_Ohm: tuple[float, float]
    until_empty_Ah: tuple[float, float]
    lowest_V: float
    mean_lowest_V: float
    rmse_mV: float

    def to_json(self) -> Json:
        """Return a document of plain types."""
        pairs = {name: getattr(self, name) for name in ("capacity_Ah", "soc_offset", "resistance_Ohm")}
        return {
            "group": self.number,
            **{name: {"value": value, "std": std} for name, (value, std) in pairs.items()},
            "until_empty_Ah": {"value": self.until_empty_Ah[0], "std": self.until_empty_Ah[1]},
            "lowest_V": self.lowest_V,
            "mean_lowest_V": self.mean_lowest_V,
            "rmse_mV": self.rmse_mV,
        }


def judge_groups(
    network: LocalModelNetwork, parallel: int, logs: Sequence[ModuleLog], initial_soc: Sequence[float]
) -> list[Group]:
    """Estimate what differs in each group.

    Parameters
    ----------
    network : of the mean cell
    parallel : cells in each group
    logs : runs with voltages of all groups; others take no part
    initial_soc : fraction of the mean at the start of each

    Returns
    -------
    One for each group in series whose voltage tells it (see `left_out`); none where no run has the groups' voltages.
    """
    known = [(log, soc) for log, soc in zip(logs, initial_soc, strict=True) if log.groups_V is not None]
    if not known:
        return []
    # One mean for all runs: of the groups that every run has, contacts and cables beside the groups never in it.
    leads = np.all([log.sensed for log, _ in known], axis=0)
    if not leads.any():
        return []
    of_mean = [(_mean_of(log, leads, parallel), soc) for log, soc in known]
    means = [(to_grid(run, network.dt_s), soc) for run, soc in of_mean]
    judged = [_judged(network, parallel, number, known, means) for number in range(len(leads))]
    return [each for each in judged if each is not None]


def left_out(groups: Sequence[Group], logs: Sequence[ModuleLog]) -> list[str]:
    """Say of which groups in series nothing could be told, though runs have groups' voltages."""
    count = max((len(log.sensed) for log in logs), default=0)
    missing = sorted(set(range(1, count + 1)) - {each.number for each in groups})
    return [
        f"group {number}: its voltage is there in too few samples, or in none under a load that tells capacity, place "
        "and resistance apart; it is left out: look at its sense lead"
        for number in missing
    ]


def weak_group(groups: Sequence[Group]) -> Json | None:
    """Return the group that ends a discharge first, where one surely does, with the reason in words."""
    if len(groups) < 2:
        return None
    least = min(groups, key=lambda each: each.until_empty_Ah[0])
    others = [each for each in groups if each is not least]
    mean_Ah = float(np.mean([each.until_empty_Ah[0] for each in others]))
    short_Ah = mean_Ah - least.until_empty_Ah[0]
    if short_Ah < max(_SURE_SIGMA * least.until_empty_Ah[1], _LEAST_SHARE * mean_Ah):
        return None
    lacks = [
        f"holds {least.capacity_Ah[0]:.2f} Ah against {np.mean([each.capacity_Ah[0] for each in others]):.2f}",
        f"stands {100 * least.soc_offset[0]:+.1f} points of SoC from the mean when that is full",
        f"has {1e3 * least.resistance_Ohm[0]:+.2f} mOhm more than the mean",
    ]
    text = (
        f"group {least.number} is empty after {least.until_empty_Ah[0]:.2f} +- {least.until_empty_Ah[1]:.2f} Ah, "
        f"{short_Ah:.2f} Ah before the others: it {', '.join(lacks)}; at the end of discharge it stood at "
        f"{least.lowest_V:.3f} V, the mean at {least.mean_lowest_V:.3f} V"
    )
    return {"group": least.number, "short_Ah": short_Ah, "text": text}


def _mean_of(log: ModuleLog, leads: np.ndarray, parallel: int) -> TimeSeries:
    """Return a run as the mean of some groups sees it."""
    assert log.groups_V is not None  # chosen so
    return replace(log, groups_V=log.groups_V[:, leads]).mean_cell(int(leads.sum()), parallel)


def _judged(
    network: LocalModelNetwork,
    parallel: int,
    number: int,
    known: list[tuple[ModuleLog, float]],
    means: list[tuple[GridRun, float]],
) -> Group | None:
    """Gauss-Newton over relative capacity, SoC and resistance of one group; None where its samples do not tell them."""
    runs = [to_grid(log.of_group(number, parallel), network.dt_s) for log, _ in known]
    at_mean = [free_run_V(network, mean, soc) for mean, soc in means]
    difference = np.concatenate([run.voltage_V - mean.voltage_V for run, (mean, _) in zip(runs, means, strict=True)])
    current = np.concatenate([run.current_A for run in runs])
    base = np.concatenate(at_mean)
    there = np.isfinite(difference) & np.isfinite(base)
    if there.sum() < LEAST_SAMPLES:
        return None
    first = _starts(runs, there)

    def simulated_V(x: FloatArray) -> FloatArray:
        smaller = replace(network, cell=replace(network.cell, capacity_Ah=network.cell.capacity_Ah * (1.0 + x[0])))
        # One offset for all runs, wherever they begin: a group that holds less leaves the mean as charge flows.
        starts = [1.0 + x[1] - (1.0 - soc) / (1.0 + x[0]) for _, soc in means]
        parts = [free_run_V(smaller, run, start) for run, start in zip(runs, starts, strict=True)]
        return np.concatenate(parts)[there] - base[there]

    x, jacobian, left = np.zeros(3), np.zeros((int(there.sum()), 3)), difference[there]
    for _ in range(_ROUNDS):
        now = simulated_V(x)
        for place, step in enumerate(_MOVED):
            moved = x.copy()
            moved[place] += step
            jacobian[:, place] = (simulated_V(moved) - now) / step
        jacobian[:, 2] = current[there]
        left = difference[there] - now
        found, *_ = np.linalg.lstsq(jacobian, left, rcond=None)
        x = np.array([*np.clip(x[:2] + found[:2], -_LARGEST, _LARGEST), found[2]])
        left = left - jacobian @ found
    if np.linalg.matrix_rank(jacobian) < len(x):
        return None
    covariance = least_squares_covariance(jacobian, left, first)
    return _as_group(network, parallel, number, (x, covariance, left), (runs, means))


def _as_group(
    network: LocalModelNetwork,
    parallel: int,
    number: int,
    found: tuple[FloatArray, FloatArray, FloatArray],
    seen: tuple[list[GridRun], list[tuple[GridRun, float]]],
) -> Group:
    x, covariance, left = found
    whole_Ah, std = parallel * network.cell.capacity_Ah, np.sqrt(np.diag(covariance))
    # From full modules: what is left when the group stands as far from the mean as it does.
    until_empty_Ah = whole_Ah * (1.0 + x[0]) * (1.0 + x[1])
    slope = whole_Ah * np.array([1.0 + x[1], 1.0 + x[0]])
    until_std_Ah = float(np.sqrt(slope @ covariance[:2, :2] @ slope))
    runs, means = seen
    return Group(
        number=number + 1,
        capacity_Ah=(whole_Ah * (1.0 + float(x[0])), whole_Ah * float(std[0])),
        soc_offset=(float(x[1]), float(std[1])),
        resistance_Ohm=(float(x[2]) / parallel, float(std[2]) / parallel),
        until_empty_Ah=(float(until_empty_Ah), until_std_Ah),
        lowest_V=_lowest_V(runs),
        mean_lowest_V=_lowest_V([mean for mean, _ in means]),
        rmse_mV=1e3 * float(np.sqrt(np.mean(left**2))),
    )


def _lowest_V(runs: list[GridRun]) -> float:
    """Lowest voltage of all runs; some may have none."""
    return float(np.nanmin(np.concatenate([run.voltage_V for run in runs])))


def _starts(runs: list[GridRun], there: np.ndarray) -> tuple[int, ...]:
    """First sample of each run among those that are there."""
    owner = np.repeat(np.arange(len(runs)), [len(run) for run in runs])[there]
    return tuple(np.unique(owner, return_index=True)[1].tolist())
