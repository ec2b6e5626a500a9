"""Heat that changes sign with the current."""

from __future__ import annotations

from models.effects.effect import Effect, Parameter, Warmth
from models.effects.thermal_view import ThermalView
from models.timeseries import FloatArray


def _temperature(view: ThermalView, values: tuple[float, ...]) -> FloatArray:
    return view.simulated(dU_dT_V_per_K=values[0])


EFFECT = Effect(
    name="reversible_heat",
    title="Reversible heat",
    recognise="the cell warms on discharge and cools on charge, or the other way round, beyond its losses",
    source="Bernardi, Pawlikowski and Newman, J. Electrochem. Soc. 132, 1985",
    parameters=(Parameter("dU_dT_V_per_K", "V/K", "entropic coefficient of the additional heat"),),
    warmth=Warmth(_temperature, (0.0,), (2e-5,), lambda _view, values: values),
)
