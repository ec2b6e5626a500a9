"""What the bench needs of any temperature chamber: the temperature of its air, a set point, on and off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import CyclerError

__all__ = ["Chamber", "ChamberIdentity", "ChamberReading", "CyclerError"]


@dataclass(frozen=True, slots=True)
class ChamberIdentity:
    """What a chamber says of itself; `said` has the keys of `drivers.cycler.IDENTITY`, empty where it says nothing.

    `range_degC` is what its map says that it can do.
    """

    name: str
    said: Mapping[str, str]
    range_degC: tuple[float, float]


@dataclass(frozen=True, slots=True)
class ChamberReading:
    """One look at a chamber.

    `monotonic_s` is the host's monotonic clock when the reply was there, `temperature_degC` that of the air (NaN:
    missing), `setpoint_degC` what the chamber has as its set point, `on` whether it heats and cools towards it.
    """

    monotonic_s: float
    temperature_degC: float
    setpoint_degC: float
    on: bool
    status: frozenset[str]
    alarms: frozenset[str]


class Chamber(Protocol):
    """One chamber.

    Every method raises `CyclerError` or one of its children, and nothing else. Calls do not overlap.
    """

    async def connect(self) -> ChamberIdentity:
        """Open the link, check the device's identity, read its constants; writes nothing."""
        ...

    async def sample(self) -> ChamberReading:
        """Read air, set point, state and alarms."""
        ...

    async def set(self, temperature_degC: float) -> None:
        """Write a set point, see that it stands there, and switch the chamber on where it is off."""
        ...

    async def standby(self) -> None:
        """Switch the chamber off, and see that it is."""
        ...

    async def clear_fault(self) -> None:
        """Acknowledge its alarms, where its map can; those whose cause is there stay."""
        ...

    async def close(self) -> None:
        """Close the link; writes nothing and never raises."""
        ...
