"""A core that is warmer than the case that is measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift, Warmth
from models.effects.expected import Expected
from models.effects.thermal_view import ThermalView
from models.effects.view import View
from models.network.signals.filters import low_pass

# Lin et al. found 1.94 K/W from the core to the case of a cylindrical cell of 2.3 Ah, and some 100 s for it to build
# up; a larger cell has more area to pass the heat.
_USUAL_K_AH_PER_W, _BUILDS_UP_S = 1.94 * 2.3, 100.0
_STEP, _LIMIT = 0.05, 8.0
# No case follows sooner than in this part of the time, whatever a search tries.
_LEAST_OF_TIME = 0.2
# What a core may be at, whatever a search tries.
_POSSIBLE_DEGC = (-60.0, 150.0)


def _usual(view: View) -> float:
    return _USUAL_K_AH_PER_W / view.capacity_Ah


def _core_degC(view: View, resistance_K_per_W: float) -> FloatArray:
    rise_K = resistance_K_per_W * low_pass(view.loss_W, _BUILDS_UP_S, view.run.dt_s)
    return np.clip(view.run.temperature_degC + rise_K, *_POSSIBLE_DEGC)


def _voltage(view: View, resistance_K_per_W: float) -> FloatArray:
    """The resistances follow the core, not the case."""
    return view.moved(temperature_degC=_core_degC(view, resistance_K_per_W))


def _moved(view: ThermalView, values: tuple[float, ...]) -> ThermalView:
    """The case ends as warm as before, for all heat has to leave through it, but later: most of the mass is inside."""
    slower_s = values[0] * view.heat_capacity_J_per_K
    return replace(view, time_constant_s=max(view.time_constant_s + slower_s, _LEAST_OF_TIME * view.time_constant_s))


def _step(view: View) -> float:
    return _STEP * _usual(view)


def _regressors(view: View) -> FloatArray:
    return _voltage(view, _step(view))[:, None] / _step(view)


EFFECT = Effect(
    name="core_temperature",
    title="Core warmer than the case",
    recognise="under a heavy load overvoltages fall within minutes by more than the measured temperature explains, "
    "and come back after minutes of rest; the case becomes as warm as before, but later",
    source="Lin et al., J. Power Sources 257, 2014 (core and surface of a cylindrical cell)",
    parameters=(
        Parameter(
            "resistance_K_per_W", "K/W", "by how much more the core is warmer than the case for each watt of its heat"
        ),
    ),
    shows_over=("time_h", "temperature_degC"),
    regressors=_regressors,
    shift=Shift(_voltage, _step, lambda view: (-_LIMIT * _usual(view), _LIMIT * _usual(view)), searched=False),
    warmth=Warmth(
        lambda view, values: _moved(view, values).simulated(), (0.0,), (0.05,), lambda _view, values: values, _moved
    ),
    absorbed=True,
    needs_temperature=True,
    # A model that is a little off over temperature looks like it in many a log.
    expected=Expected(width=_usual, share=0.1, learned=False),
)
