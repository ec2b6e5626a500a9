"""A cell that is cooled differently."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Warmth
from models.effects.expected import Expected
from models.effects.thermal_view import ThermalView

_LARGEST = float(np.log(50.0))


def _moved(view: ThermalView, values: tuple[float, ...]) -> ThermalView:
    """Thermal resistance and time constant move together: the heat capacity stays."""
    ratio = _ratio(values)
    return replace(
        view,
        resistance_K_per_W=view.resistance_K_per_W * ratio,
        time_constant_s=view.time_constant_s * ratio,
    )


def _temperature(view: ThermalView, values: tuple[float, ...]) -> FloatArray:
    return _moved(view, values).simulated()


def _ratio(values: tuple[float, ...]) -> float:
    """Thermal resistance over the model's; no search may run away beyond a factor of fifty."""
    return float(np.exp(np.clip(values[0], -_LARGEST, _LARGEST)))


def _physical(view: ThermalView, values: tuple[float, ...]) -> tuple[float, ...]:
    return (1.0 / (_ratio(values) * view.resistance_K_per_W),)


EFFECT = Effect(
    name="heat_transfer",
    title="Cooling of the cell",
    recognise="the cell gets warmer, or less warm, and takes longer, or less long, to do so",
    source="eq. 2.24 of the method; lumped heat balance",
    parameters=(Parameter("heat_transfer_W_per_K", "W/K", "heat transfer to the ambient"),),
    warmth=Warmth(_temperature, (0.0,), (0.02,), _physical, _moved),
    expected=Expected(warmth=(0.4,), granted=lambda _view: 0.1),
    like=("temperature_sensor", "self_discharge"),
)
