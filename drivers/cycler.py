"""What the bench needs of any cycler, whatever it is connected by.

Positive current charges the cell. NaN is a missing value, never zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import (
    BadMapError,
    CyclerConnectionError,
    CyclerError,
    CyclerProtocolError,
    CyclerTimeoutError,
    SetPointRefusedError,
)

__all__ = [
    "IDENTITY",
    "BadMapError",
    "Capabilities",
    "Cycler",
    "CyclerConnectionError",
    "CyclerError",
    "CyclerProtocolError",
    "CyclerTimeoutError",
    "DeviceLimits",
    "Reading",
    "SetPointRefusedError",
    "changed_identity",
]


# What a device says of itself, in the order in which people look at it.
IDENTITY = {"maker": "maker", "model": "model", "serial": "serial number", "firmware": "firmware"}


@dataclass(frozen=True, slots=True)
class Reading:
    """One sample, as the device gave it.

    `monotonic_s` is the host's monotonic clock when the reply was there; `sequence` counts the device's
    measurements (or the reads, where the device does not count), so the same number twice is a stale value.
    """

    monotonic_s: float
    sequence: int
    voltage_V: float
    current_A: float
    temperature_degC: float
    ambient_degC: float
    setpoint_in_force_A: float
    output_on: bool
    status: frozenset[str]
    alarms: frozenset[str]


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What the connected device can do; intervals are (low, high).

    `has_temperature`: it measures the temperature of the cell; `has_hold`: it can hold a voltage. `maker`, `model`,
    `serial` and `firmware` are what the device says of itself, empty where its map has no place for it.
    """

    name: str
    serial: str
    current_A: tuple[float, float]
    voltage_V: tuple[float, float]
    watchdog_s: tuple[float, float] | None
    lock_step: bool
    has_sequence: bool
    has_device_limits: bool
    has_ramp: bool
    has_temperature: bool = True
    maker: str = ""
    model: str = ""
    firmware: str = ""
    has_hold: bool = False

    @property
    def identity(self) -> dict[str, str]:
        """What tells this very device from others."""
        return {key: getattr(self, key) for key in IDENTITY}


def changed_identity(before: Mapping[str, str], now: Mapping[str, str]) -> str | None:
    """Say in what a device is another one than before; None where it is the same, as far as it tells."""
    told = [
        f"the {name} is {now[key]!r}, before it was {before[key]!r}"
        for key, name in IDENTITY.items()
        if key in before and key in now and before[key] != now[key]
    ]
    return ", ".join(told) or None


@dataclass(frozen=True, slots=True)
class DeviceLimits:
    """Limits that the device itself shall hold; a ramp of None is no ramp limit."""

    voltage_V: tuple[float, float]
    current_A: tuple[float, float]
    temperature_degC: tuple[float, float]
    ramp_A_per_s: float | None


class Cycler(Protocol):
    """One channel of a cycler.

    Every method raises `CyclerError` or one of its children, and nothing else. Calls do not overlap.
    """

    async def connect(self) -> Capabilities:
        """Open the link, check the device's identity, read its constants; writes nothing."""
        ...

    async def acquire(self, limits: DeviceLimits, watchdog_s: float, lock_step_period_s: float | None) -> None:
        """Take control: remote, at rest with the output off, watchdog and limits written and read back.

        `lock_step_period_s` is the time that one `apply` moves a simulation by; None means the wall clock.
        """
        ...

    async def output(self, on: bool) -> None:
        """Switch the output; verified by the device's status."""
        ...

    async def sample(self) -> Reading:
        """Read the actual values in one message where the map allows it.

        Raises `SetPointRefusedError`, which carries the reading, when the device does not hold the set-point
        that was applied before.
        """
        ...

    async def apply(self, current_A: float, hold_V: float | None = None) -> None:
        """Write set-point and heartbeat, and in lock-step the next tick, together.

        With `hold_V` the device gives less current than the set-point, down to none, so that the voltage is not above
        (while charging; below, while discharging) this one. Only where it can: see `Capabilities`.
        """
        ...

    async def safe(self) -> None:
        """Rest with the output off, verified.

        May be called in any state, also with the link lost (it is opened again, the device identified). Every
        step is tried even if one before it fails; the errors are told at the end.
        """
        ...

    async def verify(self) -> str | None:
        """Read back one part of what `acquire` has set (limits, watchdog, heartbeat): each call the next one.

        None where it is as it was set, or cannot be read back; else in words what differs: somebody else writes.
        """
        ...

    async def stop_input(self) -> bool | None:
        """Whether the wired stop input is pressed, asked between two samples.

        None where the map has none, or the link has no room for the question (a serial line): samples tell it.
        """
        ...

    async def clear_fault(self) -> None:
        """Acknowledge the device's alarms; raises if some stay."""
        ...

    async def release(self) -> None:
        """Give control back to the device's own panel."""
        ...

    async def close(self) -> None:
        """Close the link; writes nothing and never raises."""
        ...
