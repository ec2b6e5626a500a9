"""What each effect does to both channels of judged runs: columns for a usual size, or a simulation for any size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.sight import RunSight, Sight
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.effects import Effect
from models.effects.effect import Shift, Warmth
from models.effects.expected import Form, Told
from models.effects.reading import Reading
from models.effects.view import View

# Size of the steps of derivatives, in units of the usual size.
_STEP = 0.05
# Temperatures that a cell may have had, whatever a wrong reading says.
_POSSIBLE_DEGC = (-60.0, 150.0)
# A temperature that moves less shows nothing of what temperature does.
_LEAST_SPAN_K = 1.5


@dataclass(frozen=True)
class Linear:
    """A shape that grows in proportion.

    Attributes
    ----------
    columns : (N, k) for a change of usual size, V and then K
    told : figures that a person reads
    fixed : name, unit and value of what the shape is given by
    number : of the shape among those of its effect
    scale : (k,) of the effect's regressors, where it does not say how large it usually is
    least : smallest size that the first column can have
    of_model, untold : whether it changes a part that the model has, and how much of that is open, see `Form`
    """

    columns: FloatArray
    told: tuple[Told, ...]
    fixed: tuple[tuple[str, str, float], ...]
    number: int
    scale: FloatArray | None = None
    least: float = -np.inf
    of_model: bool = False
    untold: float = 0.0


@dataclass(frozen=True)
class Moving:
    """A shape that is simulated again for each size.

    Attributes
    ----------
    simulate : (k,) sizes -> (N,) change of both channels
    size : k
    starts : sizes from which a search begins
    limits : (2, k) sizes that a search stays within
    physical : (k,) sizes -> values of the effect's parameters, as many as are known
    voltage : (k,) sizes, view -> (m,) change of a run's voltage
    of : what the name of the first parameter is followed by
    from_best : whether a search begins from the best of the starts alone
    soc : (k,) sizes, view -> (n,) state of charge that it makes of the counted one; None: it leaves it alone
    """

    simulate: Callable[[FloatArray], FloatArray]
    size: int
    starts: tuple[tuple[float, ...], ...]
    limits: FloatArray
    physical: Callable[[FloatArray], tuple[float, ...]]
    voltage: Callable[[FloatArray, View], FloatArray]
    of: str = ""
    from_best: bool = False
    soc: Callable[[FloatArray, View], FloatArray] | None = None

    def columns(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) change at sizes, and (N, k) derivatives there."""
        at = self.simulate(sizes)
        moved = [self.simulate(sizes + _STEP * unit) - at for unit in np.eye(self.size)]
        return at, np.column_stack(moved) / _STEP


def shapes_of(sight: Sight, one: Effect) -> tuple[Linear | Moving, ...]:
    """Shapes of an effect, equally likely; none where the runs cannot show it."""
    expected = one.expected
    if one.needs_temperature and not (_moves(sight) or (one.heats_as is not None and _is_warm(sight))):
        return ()
    if expected.forms is not None:
        return tuple(each for each in _linear(sight, one, expected.forms) if each.columns.any())
    if expected.width is not None and one.shift is not None:
        width = expected.width(sight.runs[0].points)
        moving = [_shifted(sight, one, each, width) for each in (one.shift, *one.or_shifts)]
        return tuple(each for each in moving if _shows(each))
    if expected.warmth and one.warmth is not None and _is_warm(sight):
        return (_warm(sight, one, one.warmth, expected.warmth),)
    return (_unsaid(sight, one),) if one.regressors is not None and not expected.warmth else ()


def _shows(shape: Moving) -> bool:
    """Whether a small one does anything at all."""
    return bool(shape.simulate(np.full(shape.size, _STEP)).any())


def columns_of(shape: Linear | Moving) -> FloatArray:
    """(N, k) columns of a shape for usual sizes; (N, 2 k), half the variance in either direction, of one that moves."""
    if isinstance(shape, Linear):
        return shape.columns
    moved = [sign * shape.simulate(sign * _STEP * unit) for sign in (1.0, -1.0) for unit in np.eye(shape.size)]
    return np.column_stack(moved) / (_STEP * np.sqrt(2.0))


def whole_V(one: Effect, shape: Linear | Moving, sizes: FloatArray, view: View) -> FloatArray:
    """(m,) voltage that an effect of some sizes stands for at any samples of a run."""
    if isinstance(shape, Moving):
        return shape.voltage(sizes, view)
    if shape.scale is not None and one.regressors is not None:
        return one.regressors(view) @ (shape.scale * sizes)
    assert one.expected.forms is not None
    return one.expected.forms(view)[shape.number].columns @ sizes


def _moves(sight: Sight) -> bool:
    degC = np.concatenate([run.every.run.temperature_degC for run in sight.runs])
    return not np.isnan(degC).any() and float(np.ptp(degC)) >= _LEAST_SPAN_K


def _is_warm(sight: Sight) -> bool:
    return any(run.warm is not None for run in sight.runs)


def unseen_shapes(sight: Sight, one: Effect) -> tuple[Linear, ...]:
    """Shapes that an effect might have had in runs in which it is not found; none where nobody can say."""
    forms = one.expected.unseen
    return () if forms is None else tuple(each for each in _linear(sight, one, forms) if each.columns.any())


def _linear(sight: Sight, one: Effect, forms_of: Callable[[View], tuple[Form, ...]]) -> tuple[Linear, ...]:
    shares = one.expected.heat_shares or (float(one.overpotential),)
    shares = shares if _is_warm(sight) else (0.0,)
    heats = any(shares)
    everywhere = heats or (one.heats_as is not None and _is_warm(sight))
    found = [forms_of(run.every if everywhere else run.points) for run in sight.runs]
    out = []
    for number, forms in enumerate(zip(*found, strict=True)):
        volts, kelvins = [], []
        for run, form in zip(sight.runs, forms, strict=True):
            volts.append(form.columns[run.place] if everywhere else form.columns)
            current_A = run.every.run.current_A[run.every.index]
            if heats:
                kelvins.append(sight.warmed(run, current_A[:, None] * form.columns))
            elif form.dU_dT_V_per_K is not None and run.warm is not None:
                reversible_W = run.warm.reversible_W[:, None] * form.dU_dT_V_per_K
                kelvins.append(sight.warmed(run, reversible_W))
            else:
                kelvins.append(np.zeros((len(run.warm_place), form.columns.shape[1])))
        for share in shares:
            warmed = [share * each if heats else each for each in kelvins]
            least, first = max(form.least for form in forms), forms[0]
            columns = sight.stacked(volts, warmed)
            of_model, untold = first.of_model, first.untold
            out.append(Linear(columns, first.told, first.fixed, number, None, least, of_model, untold))
    return tuple(out)


def _unsaid(sight: Sight, one: Effect) -> Linear:
    """An effect that does not say how large it usually is: its regressors, each of a usual voltage over these runs."""
    assert one.regressors is not None
    volts = [one.regressors(run.points) for run in sight.runs]
    scale = THRESHOLDS.usual_V / np.maximum(np.sqrt(np.mean(np.vstack(volts) ** 2, axis=0)), 1e-12)
    first = one.parameters[0]
    weights = (float(scale[0]), *(0.0 for _ in scale[1:]))
    return Linear(
        sight.stacked([scale * each for each in volts]), (Told(first.name, first.unit, weights),), (), 0, scale
    )


def _shifted(sight: Sight, one: Effect, shift: Shift, width: float) -> Moving:
    """An effect with one parameter; what it does to the temperature grows in proportion."""
    kelvins = [_heat_of_shift(sight, run, one, shift, width) for run in sight.runs]
    low, high = shift.limits(sight.runs[0].points)

    furthest = one.expected.furthest
    limits = np.clip(np.array([[low], [high]]) / width, -furthest, furthest)

    def voltage(sizes: FloatArray, view: View) -> FloatArray:
        return shift.voltage(view, float(width * sizes[0]))

    def simulate(sizes: FloatArray) -> FloatArray:
        volts = [voltage(sizes, run.points) for run in sight.runs]
        return sight.stacked(volts, [sizes[0] * each for each in kelvins])

    def physical(sizes: FloatArray) -> tuple[float, ...]:
        view, value = sight.runs[0].points, float(width * sizes[0])
        return (shift.physical(view, value), *shift.also(view, value))

    soc_of = shift.soc
    soc = None if soc_of is None else lambda sizes, view: soc_of(view, float(width * sizes[0]))
    starts = tuple((start,) for start in one.expected.starts)
    return Moving(simulate, 1, starts, limits, physical, voltage, shift.of, one.expected.from_best, soc)


def _heat_of_shift(sight: Sight, run: RunSight, one: Effect, shift: Shift, width: float) -> FloatArray:
    """(w,) K that an effect of usual size makes of a run's temperature."""
    if run.warm is None:
        return np.zeros(0)
    if one.warmth is not None:
        warmed = one.warmth.temperature(run.warm, (one.warmth.start[0] + width,))
        return (warmed - run.warm.simulated())[run.warm_place]
    view, cell = run.every, sight.known.cell
    current_A = view.run.current_A[view.index]
    if one.inner_heat_W is not None:
        heat_W = width * one.inner_heat_W(cell.open_circuit_V(view.soc[view.index]))
    elif one.overpotential:
        heat_W = current_A * shift.voltage(view, width)
    elif shift.current_A is not None and shift.soc is not None:
        was_W = _loss_W(sight, view, view.run.current_A, view.soc)
        heat_W = _loss_W(sight, view, shift.current_A(view, width), shift.soc(view, width)) - was_W
    elif shift.soc is not None:
        was, moved = (cell.loss_V(view.inputs, each[view.index]) for each in (view.soc, shift.soc(view, width)))
        heat_W = current_A * (moved - was)
    else:
        return np.zeros(len(run.warm_place))
    return sight.warmed(run, heat_W[:, None])[:, 0]


def _loss_W(sight: Sight, view: View, current_A: FloatArray, soc: FloatArray) -> FloatArray:
    """(m,) heat of a current through the model's resistances."""
    cell = sight.known.cell
    inputs = cell.inputs(view.run, view.index, current_A, view.run.temperature_degC, view.soc)
    return current_A[view.index] * cell.loss_V(inputs, soc[view.index])


def _warm(sight: Sight, one: Effect, warmth: Warmth, usual: tuple[float, ...]) -> Moving:
    """An effect on the temperature, or on its reading, which the voltage's resistances follow."""
    start, width = np.array(warmth.start), np.array(usual)
    least = np.array(warmth.least or np.full(len(start), -np.inf))

    def values_of(sizes: FloatArray) -> tuple[float, ...]:
        return tuple(np.maximum(start + width * sizes, least).tolist())

    def voltage(sizes: FloatArray, view: View) -> FloatArray:
        return _misread_V(view, one, values_of(sizes))

    was = [None if run.warm is None else run.warm.simulated() for run in sight.runs]

    def simulate(sizes: FloatArray) -> FloatArray:
        values, volts, kelvins = values_of(sizes), [], []
        for run, before in zip(sight.runs, was, strict=True):
            volts.append(_misread_V(run.points, one, values))
            if run.warm is None or before is None:
                kelvins.append(np.zeros(0))
            else:
                kelvins.append((warmth.temperature(run.warm, values) - before)[run.warm_place])
        return sight.stacked(volts, kelvins)

    def physical(sizes: FloatArray) -> tuple[float, ...]:
        warm = next(run.warm for run in sight.runs if run.warm is not None)
        return warmth.physical(warm, values_of(sizes))

    zero = tuple(0.0 for _ in usual)
    starts = [zero] + [
        tuple(sign * (i == j) for j in range(len(usual))) for i in range(len(usual)) for sign in (-1.0, 1.0)
    ]
    furthest = np.full(len(usual), one.expected.furthest)
    limits = np.stack([np.maximum(-furthest, (least - start) / width), furthest])
    return Moving(simulate, len(usual), tuple(starts), limits, physical, voltage)


def _misread_V(view: View, one: Effect, values: tuple[float, ...]) -> FloatArray:
    """(m,) change of voltage where the cell's true temperature is another than was read."""
    correction = one.correction
    if correction is None or correction.sample is None:
        return np.zeros(len(view.index))
    whole = view.run
    read = Reading(whole.current_A, whole.voltage_V, whole.temperature_degC, whole.ambient_degC)
    names = {each.name: value for each, value in zip(one.parameters, values, strict=True)}
    if not correction.possible(names):
        return np.zeros(len(view.index))
    true_degC = np.clip(correction.sample(read, names).temperature_degC, *_POSSIBLE_DEGC)
    return view.moved(temperature_degC=true_degC)
