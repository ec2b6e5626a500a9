"""A sealed change of a simulated cell: which effect and how large is drawn from a seed, and shown only afterwards."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from simulators.cell_parameters import CellParameters
from simulators.effects import EFFECTS

__all__ = ["BY_NAME", "HIDDEN", "SIZES", "STRUCTURAL", "HiddenEffect", "Mode", "Size", "draw", "game_cell", "own_value"]

Mode = Literal["change", "structure"]


@dataclass(frozen=True, slots=True)
class Size:
    """How far an effect's primary parameter goes: a draw x between `low` and `high` gives ``base + x * unit``.

    Attributes
    ----------
    low, high : of the draw, both positive
    base : "own": the cell's own value, "none": zero
    per : what the draw is multiplied by: "own" value, the "capacity" in Ah, or "one"
    sign : "rises", "falls", or "either"
    """

    low: float
    high: float
    base: str = "none"
    per: str = "one"
    sign: str = "rises"

    def signed(self, x: float, rng: np.random.Generator) -> float:
        """Give a draw its sign."""
        if self.sign == "either":
            return x * float(rng.choice([-1.0, 1.0]))
        return -x if self.sign == "falls" else x

    def value(self, x: float, own: float, capacity_Ah: float) -> float:
        """Value of the primary parameter for a signed draw."""
        per = {"own": own, "capacity": capacity_Ah, "one": 1.0}[self.per]
        return (own if self.base == "own" else 0.0) + x * per


# From what hardly shows above 1 mV of noise to what meets a limit of the cell.
SIZES: MappingProxyType[str, Size] = MappingProxyType(
    {
        "active_material_loss": Size(0.05, 0.2),
        "capacity": Size(0.02, 0.15, base="own", per="own", sign="falls"),
        "charge_discharge_asymmetry": Size(0.1, 0.6, base="own"),
        "charge_transfer": Size(0.2, 1.5, base="own", per="own"),
        "core_temperature": Size(1.0, 5.0),
        "current_gain": Size(0.005, 0.03, sign="either"),
        "current_offset": Size(0.001, 0.01, per="capacity", sign="either"),
        "entropic_voltage": Size(1.5e-4, 8e-4, base="own", sign="either"),
        "heat_transfer": Size(0.3, 0.8, base="own", per="own", sign="falls"),
        "hysteresis": Size(0.004, 0.03, base="own"),
        "intermittent_contact": Size(0.003, 0.02),
        "lithium_loss": Size(0.03, 0.15),
        "relaxation": Size(0.4, 2.5, base="own", per="own"),
        "resistance_growth": Size(0.01, 0.06),
        "reversible_heat": Size(2e-4, 6e-4, sign="either"),
        "self_discharge": Size(0.001, 0.01, per="capacity"),
        "series_resistance": Size(0.002, 0.012),
        "soc_dependence": Size(0.01, 0.06, base="own"),
        "temperature_dependence": Size(700.0, 3000.0, base="own"),
        "temperature_sensor": Size(1.5, 5.0, sign="either"),
        "voltage_gain": Size(0.001, 0.006, sign="either"),
        "voltage_offset": Size(0.003, 0.015, sign="either"),
    }
)
# What a campaign at one chamber temperature can show; of these the game draws from the upper part of the range.
HIDDEN = (
    "capacity",
    "charge_transfer",
    "current_offset",
    "hysteresis",
    "relaxation",
    "resistance_growth",
    "self_discharge",
    "series_resistance",
    "voltage_offset",
)
# What can be hidden by its name only: many a campaign cannot tell it from one of those above, or takes luck to show it.
BY_NAME = (
    "active_material_loss",
    "current_gain",
    "intermittent_contact",
    "lithium_loss",
    "voltage_gain",
)
_UPPER_PART = 0.4
# What the structure of a model can do without and a campaign at one chamber temperature shows: the game of a structure
# draws from these. What a network takes in unseen, such as a resistance or a capacity, it cannot lack.
STRUCTURAL = ("charge_transfer", "hysteresis", "relaxation")
# Exchange current of a game's cells over the capacity, 1/h: at 1C and 2C their charge transfer bends. With the 2 to 4
# of the ordinary cells it can be told from a resistance at larger currents only than a campaign takes. Where the cell
# has all its other parts, a smaller one than this would bring what is hidden beyond the voltage limits.
_EXCHANGE_RATES: MappingProxyType[Mode, float] = MappingProxyType({"change": 1.0, "structure": 0.5})


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


def game_cell(cell: CellParameters, mode: Mode) -> dict[str, float]:
    """Effects that make the cell of a game, without what is hidden, of an ordinary one.

    In the game of a structure it is a plain one, of which a simple structure lacks nothing: none of `STRUCTURAL`.
    """
    bends = {"exchange_current": _EXCHANGE_RATES[mode] * cell.capacity_Ah}
    return bends if mode == "change" else dict.fromkeys(STRUCTURAL, 0.0) | bends


def draw(name: str, cell: CellParameters, seed: int, mode: Mode = "change") -> HiddenEffect:
    """Draw an effect and its size.

    Parameters
    ----------
    name : an effect of `HIDDEN` or `BY_NAME`, or "random", which is one of `HIDDEN`, in the game of a structure one of
        `STRUCTURAL`
    cell : the cell before the change
    seed : the same seed draws the same effect and size; the salt is always a new one
    mode : "change": the cell gets it beside what it has; "structure": it is the one of `STRUCTURAL` that a plain cell
        has, as large as the ordinary one would have with it

    Raises
    ------
    ValueError
        The effect is unknown; the message lists the names.
    """
    rng = np.random.default_rng([seed, 0x5EA1])
    among = STRUCTURAL if mode == "structure" else HIDDEN
    chosen = str(rng.choice(sorted(among))) if name == "random" else name
    known = sorted((*HIDDEN, *BY_NAME))
    if chosen not in known:
        raise ValueError(f"effect {chosen!r} cannot be hidden; random, none or one of {', '.join(known)}")
    size, own = SIZES[chosen], own_value(chosen, cell)
    x = size.signed(float(rng.uniform(max(size.low, _UPPER_PART * size.high), size.high)), rng)
    value = size.value(x, own, cell.capacity_Ah)
    before = 0.0 if mode == "structure" and chosen in STRUCTURAL else own
    return HiddenEffect(chosen, float(f"{value:.4g}"), before, secrets.token_hex(8))


def own_value(name: str, cell: CellParameters) -> float:
    """Present value of the primary parameter; 0 where it sits in the sensors, or is a change of the whole cell."""
    effect = EFFECTS[name]
    if effect.part != "cell" or effect.aged is not None:
        return 0.0
    value: object = cell
    for part in effect.field.split("."):
        value = getattr(value, part)
    assert isinstance(value, float | int)
    return float(value)
