"""Heat that changes sign with the current."""

from __future__ import annotations

from dataclasses import replace

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Warmth
from models.effects.expected import Expected
from models.effects.thermal_view import ThermalView


def _moved(view: ThermalView, values: tuple[float, ...]) -> ThermalView:
    return replace(view, dU_dT_V_per_K=view.dU_dT_V_per_K + values[0])


def _temperature(view: ThermalView, values: tuple[float, ...]) -> FloatArray:
    return _moved(view, values).simulated()


# Most of what heats so is the entropic coefficient, which moves the voltage, too, where the temperature moves.
_SHARE = 0.25

EFFECT = Effect(
    name="reversible_heat",
    title="Reversible heat",
    recognise="the cell warms on discharge and cools on charge, or the other way round, beyond its losses",
    source="Bernardi, Pawlikowski and Newman, J. Electrochem. Soc. 132, 1985",
    parameters=(Parameter("dU_dT_V_per_K", "V/K", "entropic coefficient of the additional heat"),),
    warmth=Warmth(_temperature, (0.0,), (2e-5,), lambda _view, values: values, _moved),
    expected=Expected(warmth=(2e-4,), granted=lambda _view: 0.2, share=_SHARE),
)
