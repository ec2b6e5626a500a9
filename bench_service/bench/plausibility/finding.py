"""What a rule has found."""

from dataclasses import dataclass
from typing import Literal

Stage = Literal["warn", "trip"]
PlausibilityCode = Literal[
    "reversed_current",
    "voltage_stuck",
    "resistance_low",
    "resistance_high",
    "voltage_jump",
    "temperature_stuck",
    "temperature_rate",
    "charge_moved",
    "energy_moved",
    "model_band",
]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not plausible.

    Parameters
    ----------
    stage : str
        ``warn``: people are told; ``trip``: the output goes off.
    code : str
    text : str
        What, the value with its unit, and what is plausible.
    remedy : str
    """

    stage: Stage
    code: PlausibilityCode
    text: str
    remedy: str
