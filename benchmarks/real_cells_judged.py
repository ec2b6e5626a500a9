"""One row of the scoreboard: a model of a split's training runs, judged on its other runs; used by `real_cells.py`."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from real_cells_far import far_inside
from real_cells_table import Runs, Split, read_runs

from models.baselines import fit_enhanced_self_correcting, fit_equivalent_circuit
from models.comparison.placed_runs import free_run_metrics
from models.comparison.reach import bands, expected_rmse_mV
from models.comparison.simulated_runs import RunComparison, simulate_runs
from models.data.errors import ModelError
from models.data.metrics import metrics
from models.data.timeseries import FloatArray
from models.network.cell_model import CellModel
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import Structure
from models.pipeline.fit import fit_network
from models.readouts.tables import tables_of

Row = dict[str, Any]

WITHOUT = " without "
CIRCUITS: dict[str, Callable[..., CellModel]] = {
    "1RC circuit": lambda runs, **given: fit_equivalent_circuit(runs, n_branches=1, **given),
    "2RC circuit": lambda runs, **given: fit_equivalent_circuit(runs, n_branches=2, **given),
    "ESC 3RC (Plett)": fit_enhanced_self_correcting,
}
# A read-out that is lower by less is rounding.
_ROUNDING_V = 1e-9


def row(split: Split, structure: str) -> Row:
    """Fit and judge; raises what the fit raises.

    Parameters
    ----------
    split : what to train on and what to judge
    structure : of a network, also "full without temperature"; or one of `CIRCUITS`
    """
    train, judge = read_runs(split, split.train), read_runs(split, split.judge)
    began_s, processor_s = time.perf_counter(), time.process_time()
    model, said = fitted(split, train, structure)
    seconds = {"seconds": time.perf_counter() - began_s, "processor_seconds": time.process_time() - processor_s}
    train_rmse_mV = said.pop("train_rmse_mV", None) or free_run_metrics(model, train.series, train.soc)["rmse_mV"]
    return {
        "train_rmse_mV": train_rmse_mV,
        **said,
        **judged(model, judge, split.judge_soc),
        "impossible": impossible(model) if isinstance(model, LocalModelNetwork) else None,
        **seconds,
    }


def fitted(split: Split, train: Runs, structure: str) -> tuple[CellModel, Row]:
    """The model, and what its fit says of itself."""
    given: dict[str, Any] = {"capacity_Ah": split.capacity_Ah, "initial_soc": train.initial_soc, "dt_s": split.dt_s}
    if structure in CIRCUITS:
        return CIRCUITS[structure](train.series, **given), {"expected_rmse_mV": None}
    asked: str | Structure = structure
    if WITHOUT in structure:
        base, part = structure.split(WITHOUT)
        asked = without(fit_network(train.series, structure=base, **given).network.structure, part)
    result = fit_network(train.series, structure=asked, **given)
    return result.network, {
        "train_rmse_mV": result.train["rmse_mV"],
        "expected_rmse_mV": _finite(getattr(result, "expected_rmse_mV", None)),
        "n_local_models": result.network.partition.n_models,
        "candidates": len(result.candidates),
    }


def without(structure: Structure, part: str) -> Structure:
    """Return the structure without the axes and inputs of one kind."""

    def keeps(signal: str) -> bool:
        return signal.partition(":")[0] != part

    return replace(
        structure,
        inputs=tuple(channel for channel in structure.inputs if keeps(channel.signal)),
        axes=tuple(axis for axis in structure.axes if keeps(axis.signal)),
        name=f"{structure.name} without {part}",
    )


def judged(model: CellModel, judge: Runs, judge_soc: tuple[float, float] | None) -> Row:
    """Free-run figures of runs that no fit saw.

    Returns
    -------
    dict
        `held_out_rmse_mV` and `p999_mV` in the judged range of SoC, `runs`: the former of each run;
        `held_out_all_rmse_mV` over all samples; `expected_here_rmse_mV`: what the model says of these runs beforehand;
        `inside` and `outside` the trained box (SoC, current, temperature) with
        their bands; `worst_inside`: where the largest error inside it is;
        `far_inside`: see `real_cells_far.far_inside`.
    """
    compared = simulate_runs(model, judge.series, judge.soc)
    for each in compared:
        if not np.isfinite(each.simulated_V).all():
            raise ModelError(f"{each.run.name}: the free run does not stay finite")
    measured, simulated = (np.concatenate([_column(c, name) for c in compared]) for name in ("measured", "simulated"))
    wanted = [_wanted(each, judge_soc) for each in compared]
    if not any((each & c.run.measured).any() for each, c in zip(wanted, compared, strict=True)):
        raise ModelError(f"nothing is measured in the judged range of SoC, {judge_soc}")
    chosen, inside = np.concatenate(wanted), np.concatenate([each.inside for each in compared])
    found = bands(model, [each.run for each in compared], [each.start for each in compared])
    half_width_V = None if found is None else np.concatenate([band.upper_V - band.voltage_V for band in found])
    return {
        "held_out_rmse_mV": metrics(measured[chosen], simulated[chosen])["rmse_mV"],
        "held_out_all_rmse_mV": metrics(measured, simulated)["rmse_mV"],
        "expected_here_rmse_mV": expected_rmse_mV(found, [each.run for each in compared]),
        "p999_mV": _p999_mV((simulated - measured)[chosen]),
        "runs": {
            c.run.name: metrics(c.run.voltage_V[own], c.simulated_V[own])["rmse_mV"]
            for own, c in zip(wanted, compared, strict=True)
        },
        "inside": _part(simulated - measured, half_width_V, inside),
        "outside": _part(simulated - measured, half_width_V, ~inside),
        "worst_inside": _worst(compared),
        "far_inside": far_inside(model, judge.series, judge.soc, compared),
    }


def impossible(network: LocalModelNetwork) -> Row:
    """Read-outs that no cell has: negative resistances, and steps where the open-circuit voltage falls over SoC."""
    ocv, resistance = tables_of(network)
    known = resistance.resistance_Ohm[np.isfinite(resistance.resistance_Ohm)]
    steps = np.diff(ocv.voltage_V, axis=-1)
    steps = steps[np.isfinite(steps)]
    negative, falling = int((known < 0.0).sum()), int((steps < -_ROUNDING_V).sum())
    return {
        "resistance_points": len(known),
        "unsettled_points": int(resistance.resistance_Ohm.size - len(known)),
        "negative": negative,
        "negative_share": negative / max(len(known), 1),
        "least_resistance_mOhm": 1e3 * float(known.min()) if len(known) else None,
        "ocv_steps": len(steps),
        "falling": falling,
        "falling_share": falling / max(len(steps), 1),
        "deepest_fall_mV": -1e3 * min(float(steps.min(initial=0.0)), 0.0),
    }


def _column(compared: RunComparison, name: str) -> FloatArray:
    return compared.simulated_V if name == "simulated" else compared.run.voltage_V


def _wanted(compared: RunComparison, judge_soc: tuple[float, float] | None) -> np.ndarray:
    if judge_soc is None:
        return np.ones(len(compared.run), dtype=bool)
    return (compared.soc >= judge_soc[0]) & (compared.soc <= judge_soc[1])


def _part(error_V: FloatArray, half_width_V: FloatArray | None, part: np.ndarray) -> Row:
    """Errors and bands of the measured samples of a part."""
    part = part & ~np.isnan(error_V)
    if not part.any():
        return {"n": 0}
    size_mV = 1e3 * np.abs(error_V[part])
    figures: Row = {
        "n": int(part.sum()),
        "rmse_mV": float(np.sqrt(np.mean(size_mV**2))),
        "p999_mV": float(np.percentile(size_mV, 99.9)),
        "max_mV": float(size_mV.max()),
    }
    if half_width_V is not None:
        width_mV = 1e3 * half_width_V[part]
        figures |= {
            "coverage": float((size_mV <= width_mV).mean()),
            "half_width_mV": float(width_mV.mean()),
            "width_over_rmse": float(width_mV.mean()) / max(figures["rmse_mV"], 1e-9),
        }
    return figures


def _p999_mV(error_V: FloatArray) -> float:
    return 1e3 * float(np.percentile(np.abs(error_V[~np.isnan(error_V)]), 99.9))


def _worst(compared: list[RunComparison]) -> Row | None:
    """Where the largest error inside the trained box is, so that it can be looked at."""
    sizes = [np.where(c.inside & c.run.measured, np.abs(c.residual_V), 0.0) for c in compared]
    k = int(np.argmax([size.max(initial=0.0) for size in sizes]))
    at, run = int(np.argmax(sizes[k])), compared[k].run
    if not sizes[k][at] > 0.0:
        return None
    return {
        "run": run.name,
        "time_s": float(run.time_s[at]),
        "soc": float(compared[k].soc[at]),
        "current_A": float(run.current_A[at]),
        "temperature_degC": _finite(float(run.temperature_degC[at])),
        "error_mV": 1e3 * float(compared[k].residual_V[at]),
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None
