"""Slow diffusion: an overvoltage that dies out in minutes to hours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter
from models.effects.expected import Expected, Form, Told
from models.effects.reading import Values
from models.effects.view import View
from models.effects.ways_in import Ground, WayIn, with_inputs
from models.network.signals import is_soc
from models.network.signals.filters import diffusion
from models.network.structure import InputChannel, Structure

_TIME_CONSTANTS_S = (100.0, 300.0, 1000.0, 3000.0)
_SURFACE_S = (300.0, 1000.0, 3000.0)
_SHAPES_S = (100.0, 150.0, 220.0, 330.0, 500.0, 750.0, 1100.0, 1600.0, 2400.0, 3600.0)
_BUMPS = 5
# In a measured cell diffusion has several time constants, and the state of charge at the surface sets the voltage.
_SPREAD_S = (4.0, 40.0, 400.0)
_SURFACES = ("0.02/400", "0.02/1500", "0.05/400", "0.05/1500", "0.05/4000")
_SURFACE_K = 2500.0
# A usual change, relative to the cell's resistance, of a surface that runs ahead in h, and speeds that it may have.
_USUAL_SHARE, _USUAL_AHEAD_H = 0.3, 0.02
_EXPECTED_S = (30.0, 100.0, 300.0, 1000.0, 3000.0)
# Factors of the time in which what the model has at the particles' surface diffuses. A fit moves a sphere's time by
# steps of 1.4: it knows it to a tenth, one standard deviation, which is so much of a change by the first factor. The
# times of its table stand further apart: of those more is open than this says.
_SLOWER = (1.6, 2.5, 4.0, 6.0)
_OPEN = 0.2
_TINY = 1e-12
# Of the settled difference the modes that are simulated hold so much; the rest acts at once.
DIFFUSED = 0.84


def _regressors(view: View) -> FloatArray:
    """One time constant alone would leave to hysteresis what a spread of them explains."""
    bumps = view.bumps(_BUMPS)
    columns = [bumps * view.low_pass(view.drive_A, tau_s)[:, None] for tau_s in _TIME_CONSTANTS_S]
    surface = [view.slope_V * view.low_pass(view.drive_A, tau_s) / view.capacity_Ah for tau_s in _SURFACE_S]
    return np.column_stack([*columns, *surface])


def _columns(view: View, time_constant_s: float) -> FloatArray:
    return view.low_pass(view.drive_A, time_constant_s)[:, None]


def _extend(structure: Structure, values: Values, _capacity_Ah: float) -> Structure:
    tau_s = values.get("time_constant_s", 600.0)
    return replace(structure, inputs=(*structure.inputs, InputChannel(f"low_pass:{tau_s:.4g}")))


def _spread(structure: Structure, ground: Ground) -> list[Structure]:
    """Low-passes of the current in place of output feedback, whose poles all inputs share."""
    fastest_s, slowest_s = ground.fastest_s, ground.slowest_s
    constants_s = [tau_s for tau_s in _SPREAD_S if fastest_s <= tau_s <= slowest_s] or [slowest_s]
    bare = replace(structure, output_order=0, inputs=tuple(replace(each, order=0) for each in structure.inputs))
    found = []
    for parts_K in ground.activations_K:
        names = (f"low_pass:{tau_s:g}" + (f"/{k:g}" if k else "") for k in parts_K for tau_s in constants_s)
        found.append(with_inputs(bare, tuple(names)))
    return found


def _at_surface(structure: Structure, ground: Ground) -> list[Structure]:
    """The open-circuit curve over the state of charge at the particles' surface."""
    activation_K = _SURFACE_K if len(ground.activations_K) > 1 else 0.0
    found = []
    for surface in _SURFACES:
        name = f"surface_soc:{surface}/{activation_K:g}"
        inputs = tuple(replace(each, signal=name) if is_soc(each.signal) else each for each in structure.inputs)
        axes = tuple(replace(each, signal=name) if is_soc(each.signal) else each for each in structure.axes)
        found.append(replace(structure, inputs=inputs, axes=axes))
    return found


def _expected(view: View) -> tuple[Form, ...]:
    """Diffusion at each of several speeds: as a resistance, and as a surface that runs ahead of the mean.

    What the model has of it may have grown as well: all of its slow resistances alike, and the time of its own surface.
    """
    usual_Ohm, forms = _USUAL_SHARE * view.model.typical_Ohm, []
    current_A, index = view.run.current_A, view.index
    for tau_s in _EXPECTED_S:
        ahead_A = DIFFUSED * diffusion(current_A, tau_s, np.ones(1), view.run.dt_s) + (1.0 - DIFFUSED) * current_A
        ahead_V = view.slope_V * (_USUAL_AHEAD_H / view.capacity_Ah * ahead_A)[index]
        columns = np.column_stack([usual_Ohm * view.low_pass(current_A, tau_s), ahead_V])
        as_Ohm = float(np.mean(view.slope_V)) * _USUAL_AHEAD_H / view.capacity_Ah
        told = (Told("resistance_Ohm", "Ohm", (usual_Ohm, as_Ohm)),)
        forms.append(Form(columns, told, (("time_constant_s", "s", tau_s),)))
    slow_V = view.model.slow_V(view.inputs, view.soc[index])
    forms.append(_grown(view, slow_V, max(_EXPECTED_S, key=lambda each: _likeness(view, slow_V, each)), -1.0))
    own_s = view.model.diffusion_s
    if own_s is None:
        return tuple(forms)
    for times in _SLOWER:
        # With less no surface would be ahead at all.
        slower = _grown(view, view.slowed_V(times), times * own_s, -1.0 / (times - 1.0))
        forms.append(replace(slower, of_model=True, untold=_OPEN if times == _SLOWER[0] else 0.0))
    return tuple(forms)


def _grown(view: View, volts: FloatArray, tau_s: float, least: float) -> Form:
    """A change of what the model has, (m,) V, told by what it adds in the end."""
    settled_A = view.low_pass(view.run.current_A, tau_s)
    as_Ohm = float(settled_A @ volts) / max(float(settled_A @ settled_A), _TINY)
    told = (Told("resistance_Ohm", "Ohm", (as_Ohm,)),)
    return Form(volts[:, None], told, (("time_constant_s", "s", tau_s),), least)


def _likeness(view: View, volts: FloatArray, tau_s: float) -> float:
    """Share of a voltage's square that a relaxation of one time constant stands for."""
    settled_A = view.low_pass(view.run.current_A, tau_s)
    return float(settled_A @ volts) ** 2 / max(float(settled_A @ settled_A), _TINY)


EFFECT = Effect(
    name="relaxation",
    title="Slow relaxation (diffusion)",
    recognise="after the current stops the voltage goes on creeping for minutes to hours, and under a long pulse it "
    "goes on falling",
    source="Plett, Battery Management Systems I, 2015, ch. 2.4 and 2.7; the method's relaxation input, eq. 2.7",
    parameters=(
        Parameter("resistance_Ohm", "Ohm", "additional resistance in the end"),
        Parameter("time_constant_s", "s", "time in which it dies out to 37 %"),
    ),
    shows_over=("since_step_s",),
    regressors=_regressors,
    overpotential=True,
    lean=Lean(_columns, lambda _view: _SHAPES_S),
    reference_terms=("slow_current",),
    extend=_extend,
    bounded_part="relaxation",
    ways_in=(WayIn(_spread), WayIn(_at_surface, only_if_worth=True)),
    expected=Expected(_expected),
)
