"""A sealed change of a simulated cell: which effect and how large is drawn from a seed, and shown only afterwards."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass

import numpy as np

from simulators.cell import CellParameters
from simulators.effects import EFFECTS

__all__ = ["HIDDEN", "HiddenEffect", "draw"]


@dataclass(frozen=True, slots=True)
class Size:
    """How far an effect's primary parameter goes: a draw between `low` and `high` gives ``base + x * unit``.

    Attributes
    ----------
    low, high : of the draw
    base : "own": the cell's own value, "none": zero
    per : what the draw is multiplied by: "own" value, the "capacity" in Ah, or "one"
    signed : whether the draw may be negative too
    """

    low: float
    high: float
    base: str = "none"
    per: str = "one"
    signed: bool = False


# Large enough to show above 1 mV of noise, small enough that no limit of the cell is met.
HIDDEN: dict[str, Size] = {
    "capacity": Size(-0.15, -0.04, base="own", per="own"),
    "charge_transfer": Size(0.5, 1.5, base="own", per="own"),
    "current_offset": Size(0.003, 0.01, per="capacity", signed=True),
    "hysteresis": Size(0.008, 0.025, base="own"),
    "relaxation": Size(0.8, 2.5, base="own", per="own"),
    "resistance_growth": Size(0.02, 0.06),
    "self_discharge": Size(0.003, 0.01, per="capacity"),
    "series_resistance": Size(0.003, 0.012),
    "voltage_offset": Size(0.004, 0.015, signed=True),
}


@dataclass(frozen=True, slots=True)
class HiddenEffect:
    """What is hidden, and the seal on it.

    Attributes
    ----------
    name : of the effect
    value : its primary parameter in the unit of `simulators.effects.EFFECTS`
    before : what the parameter was without it
    salt : keeps the seal from being guessed by trying all names and sizes
    """

    name: str
    value: float
    before: float
    salt: str

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return EFFECTS[self.name].unit

    @property
    def contents(self) -> str:
        """What the seal closes, as text."""
        return f"{self.name}={self.value!r} {self.salt}"

    @property
    def seal(self) -> str:
        """SHA-256 of the contents: said before, checked after."""
        return hashlib.sha256(self.contents.encode()).hexdigest()


def draw(name: str, cell: CellParameters, seed: int) -> HiddenEffect:
    """Draw an effect and its size.

    Parameters
    ----------
    name : an effect of `HIDDEN`, or "random"
    cell : the cell before the change
    seed : the same seed draws the same effect and size; the salt is always a new one

    Raises
    ------
    ValueError
        The effect is unknown; the message lists the names.
    """
    rng = np.random.default_rng([seed, 0x5EA1])
    chosen = str(rng.choice(sorted(HIDDEN))) if name == "random" else name
    if chosen not in HIDDEN:
        raise ValueError(f"effect {chosen!r} cannot be hidden; random, none or one of {', '.join(sorted(HIDDEN))}")
    size = HIDDEN[chosen]
    x = float(rng.uniform(size.low, size.high)) * (float(rng.choice([-1.0, 1.0])) if size.signed else 1.0)
    own = _own_value(chosen, cell)
    per = {"own": own, "capacity": cell.capacity_Ah, "one": 1.0}[size.per]
    value = (own if size.base == "own" else 0.0) + x * per
    return HiddenEffect(chosen, float(f"{value:.4g}"), own, secrets.token_hex(8))


def _own_value(name: str, cell: CellParameters) -> float:
    """Present value of the primary parameter; 0 where it sits in the sensors."""
    effect = EFFECTS[name]
    if effect.part != "cell":
        return 0.0
    value: object = cell
    for part in effect.field.split("."):
        value = getattr(value, part)
    assert isinstance(value, float | int)
    return float(value)
