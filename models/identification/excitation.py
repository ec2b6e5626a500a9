"""Whether runs can determine a model at all, and what they leave open, in physical words."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numba import njit

from models.data.errors import NotIdentifiableError
from models.data.lost_temperature import lost_temperature
from models.data.metrics import Metrics
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray, TimeSeries
from models.network.regression import CellContext
from models.network.signals import soc_by_counting

_MIN_SAMPLES = 200
# Moves of the current by this share of its largest value are steps; a sensor's noise is none.
_STEP_SHARE = 0.1
_MIN_STEPS = 5
_SOC_LIMITS = (-0.2, 1.2)
# Narrower ranges than these show one operating point, not a dependence.
_ONE_SOC = 0.05
_ONE_TEMPERATURE_K = 3.0
# Two quantities whose correlation is beyond this cannot be told apart.
_SAME = 0.999
_NEARLY_SAME = 0.98
# Grid points for each sample beyond which the time stamps jump rather than the log being sparse.
_MOST_POINTS_PER_SAMPLE = 1000.0
_MOST_POINTS = 5e7
# A pause of this many typical intervals is a jump of the clock or a gap, even when the current is alike around it.
_PAUSE_FACTOR = 600.0
_GAP_FACTOR = 30.0
_LARGEST_GAP_CHARGE = 0.5
_MOST_MISSING_CURRENT = 0.2
# Standard errors beyond which a sign is certain.
_CERTAIN = 4.0


def check_series(runs: list[TimeSeries], dt_s: float, capacity_Ah: float) -> list[str]:
    """Refuse runs whose time stamps or missing values leave the counted charge open.

    Parameters
    ----------
    runs : as measured
    dt_s : sampling time that they are to be put on
    capacity_Ah : cell capacity

    Returns
    -------
    Reservations, one sentence each.

    Raises
    ------
    NotIdentifiableError
        Time stamps jump so far, or so much of the current is missing, that the state of charge is not known.
    """
    found: list[str] = []
    for run in runs:
        points = run.duration_s / dt_s
        if points > max(_MOST_POINTS_PER_SAMPLE * len(run), _MIN_SAMPLES) or points > _MOST_POINTS:
            raise NotIdentifiableError(
                f"{run.name}: {len(run)} samples lie {run.duration_s:g} s apart from first to last, {points:.3g} times "
                f"the sampling time of {dt_s:g} s: its time stamps jump. Split the run there or give the sampling time"
            )
        if np.isnan(run.voltage_V).all():
            raise NotIdentifiableError(f"{run.name}: no usable samples, none has a voltage; leave this run out")
        missing = float(np.isnan(run.current_A).mean())
        if missing > _MOST_MISSING_CURRENT:
            raise NotIdentifiableError(
                f"{run.name}: the current is missing at {100 * missing:.0f} % of the samples; at most "
                f"{100 * _MOST_MISSING_CURRENT:.0f} % can be bridged, or the charge that flowed is not known"
            )
        if missing > 0.0:
            found.append(
                f"{run.name}: the current is missing at {int(np.isnan(run.current_A).sum())} samples and was taken to "
                "stay as it was"
            )
        found += [*lost_temperature(run), *_pauses(run, capacity_Ah)]
    return found


def check_excitation(grid: list[GridRun], soc: list[float], cell: CellContext) -> list[str]:
    """Refuse data that cannot determine any model.

    Parameters
    ----------
    grid : training runs on the model's grid
    soc : fraction 0..1 at the start of each
    cell : capacity and efficiency

    Returns
    -------
    Reservations, one sentence each: what the data leave open.

    Raises
    ------
    NotIdentifiableError
        The message names the weak direction in physical words.
    """
    known = sum(int(run.measured.sum()) for run in grid)
    if known < _MIN_SAMPLES:
        raise NotIdentifiableError(
            f"{known} usable samples at {grid[0].dt_s:g} s; at least {_MIN_SAMPLES} are needed. Record a longer run"
        )
    _check_current(np.concatenate([run.current_A for run in grid]), cell)
    counted = [
        soc_by_counting(r.charge_Ah, s, cell.capacity_Ah, cell.efficiency) for r, s in zip(grid, soc, strict=True)
    ]
    _check_soc(counted, cell)
    reservations = [*_coverage(grid, counted, cell), *_voltage_answer(grid), *_reference_soc(grid, counted, cell)]
    return reservations + _weak_directions(grid, counted)


def fit_reservations(train: Metrics, n_missing: int, n_samples: int) -> list[str]:
    """Say where a finished fit explains its own training runs badly.

    Parameters
    ----------
    train : free-run figures of the training runs
    n_missing, n_samples : grid points without voltage, and all
    """
    found = []
    if n_missing > 0.01 * n_samples:
        found.append(f"the voltage is missing at {100 * n_missing / n_samples:.0f} % of the model's grid")
    if train["nrmse"] > 0.05:
        found.append(
            f"the free run misses its own training runs by {train['rmse_mV']:.0f} mV, {100 * train['nrmse']:.0f} % of "
            "the voltage's range: capacity, initial SoC or time stamps are wrong, or the structure lacks an effect"
        )
    return found


def _pauses(run: TimeSeries, capacity_Ah: float) -> list[str]:
    """Charge that may have flowed while nothing was logged."""
    step, current = np.diff(run.time_s), np.nan_to_num(run.current_A)
    typical = float(np.median(step))
    scale = max(float(np.abs(current).max()), 1e-9)
    differs = np.abs(np.diff(current)) > 0.01 * scale
    pause = (step > _PAUSE_FACTOR * typical) | ((step > _GAP_FACTOR * typical) & differs)
    charge_Ah = np.where(pause, np.maximum(np.abs(current[1:]), np.abs(current[:-1])) * step, 0.0) / 3600.0
    share = float(charge_Ah.sum()) / capacity_Ah
    k = int(np.argmax(charge_Ah))
    where = f"{run.name}: time jumps by {step[k]:g} s at sample {k + 1}, with {current[k]:g} A before and "
    if share > _LARGEST_GAP_CHARGE:
        raise NotIdentifiableError(
            f"{where}{current[k + 1]:g} A after it: up to {100 * share:.0f} % of the capacity flowed unseen, so the "
            "state of charge is not known. Split the run there and give each part its initial SoC"
        )
    if share > 0.005:
        return [f"{where}{current[k + 1]:g} A after it: up to {100 * share:.1f} % of the capacity flowed unseen"]
    return []


def _check_current(current_A: FloatArray, cell: CellContext) -> None:
    largest = float(np.abs(current_A).max())
    if largest <= cell.rest_A:
        raise NotIdentifiableError(
            f"the current never exceeds {cell.rest_A:g} A: neither resistance nor open-circuit curve can be seen. "
            "Record pulses"
        )
    steps = _moves(current_A, _STEP_SHARE * largest)
    if steps < _MIN_STEPS:
        raise NotIdentifiableError(
            f"the current changes only {steps} times by more than {_STEP_SHARE * largest:g} A: the resistance cannot "
            "be told from the open-circuit curve at constant current. Record pulses and rests"
        )


@njit(cache=True)
def _moves(current: np.ndarray, threshold: float) -> int:
    """How many times a current has left the value that it had moved to before by more than a threshold."""
    anchor, count = current[0], 0
    for k in range(current.shape[0]):
        if abs(current[k] - anchor) > threshold:
            anchor = current[k]
            count += 1
    return count


def _check_soc(counted: list[FloatArray], cell: CellContext) -> None:
    low, high = min(float(s.min()) for s in counted), max(float(s.max()) for s in counted)
    if low < _SOC_LIMITS[0] or high > _SOC_LIMITS[1]:
        raise NotIdentifiableError(
            f"counted SoC runs from {low:.2f} to {high:.2f} with a capacity of {cell.capacity_Ah:g} Ah: "
            "capacity, initial SoC or the unit of the current is wrong"
        )


def _coverage(grid: list[GridRun], counted: list[FloatArray], cell: CellContext) -> list[str]:
    """Ranges that the runs do not span."""
    found = []
    low, high = min(float(s.min()) for s in counted), max(float(s.max()) for s in counted)
    if high - low < _ONE_SOC:
        found.append(
            f"counted SoC stays within {low:.3f}..{high:.3f}: the open-circuit voltage is known at this level only, "
            f"and its slope hardly; or the capacity of {cell.capacity_Ah:g} Ah is too large"
        )
    current = np.concatenate([run.current_A for run in grid])
    if float(current.max()) <= cell.rest_A:
        found.append("the cell is never charged: resistance while charging and hysteresis are not known")
    if float(current.min()) >= -cell.rest_A:
        found.append("the cell is never discharged: resistance while discharging and hysteresis are not known")
    temperature = np.concatenate([run.temperature_degC for run in grid])
    if np.isnan(temperature).any():
        found.append("no temperature was measured in some run: its effect is not known")
    elif float(np.ptp(temperature)) < _ONE_TEMPERATURE_K:
        found.append(
            f"temperature stays within {temperature.min():.1f}..{temperature.max():.1f} degC: nothing is known of "
            "other temperatures"
        )
    return found


def _voltage_answer(grid: list[GridRun]) -> list[str]:
    """Whether the voltage answers steps of the current, and in the direction that a cell's voltage does.

    Raises
    ------
    NotIdentifiableError
        It does not move at all, or it falls when charge begins.
    """
    change = [(np.diff(run.current_A), np.diff(run.voltage_V)) for run in grid]
    current, voltage = (np.concatenate(part) for part in zip(*change, strict=True))
    largest = float(max(np.abs(run.current_A).max() for run in grid))
    step = (np.abs(current) > _STEP_SHARE * largest) & ~np.isnan(voltage)
    measured = np.concatenate([run.voltage_V[run.measured] for run in grid])
    if float(np.ptp(measured)) < 1e-4:
        raise NotIdentifiableError(
            f"the voltage stays at {measured[0]:.4f} V while the current changes by up to {largest:g} A: it is not "
            "measured, or it is not this cell's"
        )
    if step.sum() < _MIN_STEPS:
        return []
    x, y = current[step], voltage[step]
    resistance = float(x @ y / (x @ x))
    error = float(np.sqrt(np.sum((y - resistance * x) ** 2) / max(len(x) - 1, 1) / (x @ x)))
    if resistance < -_CERTAIN * error:
        raise NotIdentifiableError(
            f"the voltage falls when the current rises ({1e3 * resistance:.3g} mOhm at {len(x)} steps): the sign of "
            "the current is wrong; positive current charges"
        )
    if resistance < _CERTAIN * error:
        return [
            f"the voltage hardly answers steps of the current ({1e3 * resistance:.3g} mOhm, standard error "
            f"{1e3 * error:.2g} mOhm): resistance is not known, or voltage and current are not logged at the same time"
        ]
    return []


def _reference_soc(grid: list[GridRun], counted: list[FloatArray], cell: CellContext) -> list[str]:
    """Compare the runs' reference SoC, where they have one throughout, with the counted one."""
    products = np.zeros(2)
    for run, soc in zip(grid, counted, strict=True):
        if run.soc_ref is None or np.isnan(run.soc_ref).any():
            continue
        own, reference = soc - soc[0], run.soc_ref - run.soc_ref[0]
        if float(np.ptp(reference)) > _ONE_SOC:
            products += (own @ reference, own @ own)
    if products[1] <= 0.0:
        return []
    slope = products[0] / products[1]
    if abs(slope - 1.0) <= 0.05:
        return []
    text = f"the runs' reference SoC moves {slope:.2f} times as far as the SoC counted with {cell.capacity_Ah:g} Ah"
    if not 0.5 <= slope <= 2.0:
        raise NotIdentifiableError(f"{text}: capacity, or the sign or unit of the current, is wrong")
    return [f"{text}: the capacity would be {cell.capacity_Ah / slope:.3g} Ah"]


def _weak_directions(grid: list[GridRun], counted: list[FloatArray]) -> list[str]:
    """Pairs of quantities that rise and fall together, so that their effects cannot be told apart.

    Raises
    ------
    NotIdentifiableError
        Current and state of charge do: not even resistance and open-circuit curve can be told apart.
    """
    measured = np.concatenate([run.measured for run in grid])
    columns = {
        "current": np.concatenate([run.current_A for run in grid])[measured],
        "state of charge": np.concatenate(counted)[measured],
        "temperature": np.concatenate([run.temperature_degC for run in grid])[measured],
    }
    smallest = {"current": 0.0, "state of charge": 0.002, "temperature": 0.5}
    varied = {name: x for name, x in columns.items() if np.ptp(x) > smallest[name]}
    found = []
    for a, b in combinations(varied, 2):
        correlation = float(np.corrcoef(varied[a], varied[b])[0, 1])
        text = f"{a} and {b} rise and fall together (correlation {correlation:.4f})"
        if abs(correlation) > _SAME and a == "current":
            raise NotIdentifiableError(f"{text}: what either does to the voltage cannot be told. Vary them apart")
        if abs(correlation) > _NEARLY_SAME:
            found.append(f"{text}: what either does to the voltage can hardly be told")
    return found
