"""What is there in any log and no news: a little of each effect, another one in each run, and what the cell lacks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.shapes import Linear, Moving, columns_of
from models.diagnosis.likelihood.sight import Sight
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.effects import Effect, effect

ALL_RESISTANCES = "all resistances"
# The inside of a cell is warmer than its skin: part of a usual misreading that its resistances always show.
_INSIDE = 0.2


def all_resistances(sight: Sight) -> FloatArray:
    """(N, 1) V that all resistances make where they are larger by a usual share: from run to run they differ."""
    volts = [THRESHOLDS.resistance * run.points.overvoltage(run.points.run.current_A)[:, None] for run in sight.runs]
    return sight.stacked(volts)


def learned_columns(sight: Sight, shapes: Mapping[str, tuple[Linear | Moving, ...]]) -> dict[str, FloatArray]:
    """By effect of which a little may be new in any run, (n, k) V of its usual size, over all its shapes together.

    Parameters
    ----------
    sight : of the runs
    shapes : of the effects, by their names
    """
    out = {}
    for name, own in shapes.items():
        # Shapes that differ by how much they warm are one in the voltage.
        once = {(i if isinstance(shape, Moving) else shape.number): shape for i, shape in enumerate(_new(own))}
        if once and effect(name).expected.learned:
            volts = [columns_of(shape)[: sight.n_voltage] for shape in once.values()]
            out[name] = np.hstack(volts) / np.sqrt(len(volts))
    return out


def lacking(sight: Sight, shapes: Mapping[str, tuple[Linear | Moving, ...]]) -> FloatArray:
    """(N, r) what the known cell may lack in every run.

    Parameters
    ----------
    sight : of the judged runs
    shapes : of the effects, by their names
    """
    lacks, cell = sight.known.lacks, sight.known.cell
    if not sight.known.elsewhere.granted or not lacks.effects:
        return np.zeros((len(sight.own_rows[0]), 0))
    rows = np.vstack([cell.regressors(run.points.inputs, run.points.soc[run.points.index]) for run in sight.runs])
    own = {name: columns for name, columns in learned_columns(sight, shapes).items() if name in lacks.effects}
    volts = lacks.columns(own, rows)
    return np.concatenate([volts, np.zeros((len(sight.own_rows[0]) - len(volts), volts.shape[1]))])


def granted(sight: Sight, shapes: Mapping[str, tuple[Linear | Moving, ...]]) -> FloatArray:
    """(N, k) what of each effect, and of all resistances, is there in any log and no news, another one in each run.

    Parameters
    ----------
    sight : of the judged runs
    shapes : of the effects, by their names
    """
    seen = sight.known.elsewhere.granted
    if not seen:
        # The cell is known as it is: nothing differs from run to run.
        return np.zeros((len(sight.own_rows[0]), 0))
    parts = [np.sqrt(seen.get(ALL_RESISTANCES, 0.0)) * all_resistances(sight)]
    for name, every in shapes.items():
        own = _new(every)
        share = effect(name).expected.granted
        least = share(sight.runs[0].points) if share is not None else 0.0
        size = max(least, float(np.sqrt(seen.get(name, 0.0)))) / np.sqrt(max(len(own), 1))
        if size:
            parts += [size * columns_of(shape) for shape in own]
        parts += [each.untold * each.columns for each in every if isinstance(each, Linear) and each.untold]
        if _misreads(effect(name)):
            parts += [_INSIDE * np.where(_is_voltage(sight)[:, None], columns_of(shape), 0.0) for shape in own]
    columns = np.hstack(parts)
    return np.hstack([np.where(rows[:, None], columns, 0.0) for rows in sight.own_rows])


def _new(shapes: tuple[Linear | Moving, ...]) -> list[Linear | Moving]:
    """Shapes that stand for something beside what the model has."""
    return [shape for shape in shapes if isinstance(shape, Moving) or not shape.of_model]


def _misreads(one: Effect) -> bool:
    """Whether an effect is a wrong temperature, which the resistances do not follow."""
    return one.warmth is not None and one.correction is not None and one.correction.sample is not None


def _is_voltage(sight: Sight) -> np.ndarray:
    """(N,) whether a point is one of the voltage."""
    return np.arange(len(sight.own_rows[0])) < sight.n_voltage
