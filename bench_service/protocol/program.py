"""A protocol made ready to play: a flat list of instructions in SI units, every jump resolved."""

from __future__ import annotations

from dataclasses import dataclass

from bench_service.errors import Where
from bench_service.protocol.steps import Record, Soak

# A hold or an end nearer to a limit than this is refused: noise alone would trip the bench.
VOLTAGE_MARGIN_V = 0.01


@dataclass(frozen=True, slots=True)
class ChamberWindow:
    """A temperature chamber around the cell.

    Parameters
    ----------
    temperature_degC : (low, high)
        Of its set points.
    tolerance_K : float
        How near to its set point its air counts as there.
    """

    temperature_degC: tuple[float, float]
    tolerance_K: float = 1.0


# For a protocol that has been admitted on a bench and is only looked at again.
ANY_CHAMBER = ChamberWindow((-float("inf"), float("inf")))


@dataclass(frozen=True, slots=True)
class Window:
    """What the run may not leave; SoC None: nobody asks for it.

    Parameters
    ----------
    voltage_V, current_A : (low, high)
    soc : (low, high) or None
    ramp_A_per_s : float or None
    duration_s : float
    charge_Ah : float or None
        Most charge that may have flowed, net, since the protocol began, in either direction.
    chamber : ChamberWindow or None
        None: there is no chamber.
    """

    voltage_V: tuple[float, float]
    current_A: tuple[float, float]
    soc: tuple[float, float] | None = None
    ramp_A_per_s: float | None = None
    duration_s: float = float("inf")
    charge_Ah: float | None = None
    chamber: ChamberWindow | None = None


@dataclass(frozen=True, slots=True)
class End:
    """One end of a step, or a condition.

    Attributes
    ----------
    quantity : str
        One of `document.ENDS`, rates and shares already as A and Ah; or ``cycle``.
    target : int or None
        Instruction that follows; None: the next one.
    """

    quantity: str
    above: bool
    value: float
    target: int | None = None
    over_s: float = 60.0


@dataclass(frozen=True, slots=True)
class Play:
    """Set-points until an end is met.

    Attributes
    ----------
    law : str
        ``rest``, ``current``, ``voltage``, ``cc_cv``, ``power``, ``resistance`` or ``profile``.
    level : float
        A, W or Ohm; with ``voltage`` the greatest current.
    number : int
        Of the step in the document, from 1, counted through all that play.
    limits : tuple of (quantity, low, high)
        Ends the run when they are left.
    soak : Soak or None
        Of a rest that lasts until chamber and cell are warm.
    """

    law: str
    where: Where
    number: int
    name: str
    level: float = 0.0
    voltage_V: float = 0.0
    ends: tuple[End, ...] = ()
    limits: tuple[tuple[str, float, float], ...] = ()
    record: Record = Record()
    times_s: tuple[float, ...] = ()
    values: tuple[float, ...] = ()
    in_watts: bool = False
    clip_voltage_V: tuple[float, float] | None = None
    soak: Soak | None = None


@dataclass(frozen=True, slots=True)
class Round:
    """A loop begins, for the first time or again; `counter` is its place in the counters."""

    counter: int
    cycle: bool


@dataclass(frozen=True, slots=True)
class Again:
    """Goes back to the instruction `back` until the loop has been played `count` times, or a condition holds."""

    counter: int
    back: int
    count: int
    cycle: bool
    until: tuple[End, ...] = ()


@dataclass(frozen=True, slots=True)
class Jump:
    """Goes to `target` at most `most` times, where its condition holds."""

    counter: int
    target: int
    most: int
    condition: End | None = None


@dataclass(frozen=True, slots=True)
class SetChamber:
    """Gives the chamber a set point and goes on at once."""

    temperature_degC: float


Instruction = Play | Round | Again | Jump | SetChamber


@dataclass(frozen=True, slots=True)
class Program:
    """What the engine plays.

    Attributes
    ----------
    n_counters : int
        Of loops and jumps.
    n_steps : int
        Steps of the document that play.
    """

    name: str
    instructions: tuple[Instruction, ...]
    n_counters: int
    n_steps: int
    capacity_Ah: float
    window: Window

    def describe(self, number: int) -> str:
        """Return a step's name, e.g. ``step 3 (constant_current)``."""
        for each in self.instructions:
            if isinstance(each, Play) and each.number == number:
                return f"step {number} ({each.name})"
        return f"step {number}"
