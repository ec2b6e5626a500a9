"""Whose registers these are: every Modbus device is asked what it is before anything is written to it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.codec import Value, bind
from drivers.device_map import IDENTITY_ROLES, DeviceMap, Register
from drivers.errors import CyclerError, CyclerProtocolError
from drivers.modbus_link import ModbusLink


async def open_identified(link: ModbusLink, device_map: DeviceMap) -> None:
    """Connect, and make sure that it is the device that the map is about; another one is left alone.

    Raises
    ------
    CyclerError
        Nobody answers, or another device does; the link is then closed.
    """
    await link.open()
    identity = device_map.identity
    try:
        found = await read_value(link, device_map.registers[identity.register], {})
    except CyclerError:
        link.close()
        raise
    if found not in identity.equals:
        link.close()
        wanted = " or ".join(repr(value) for value in identity.equals)
        raise CyclerProtocolError(
            f"{link.address}: register '{identity.register}' reads {found!r}, map '{device_map.name}' "
            f"wants {wanted}: another device, or the wrong map; nothing was written"
        )


async def read_constants(link: ModbusLink, device_map: DeviceMap) -> dict[str, float]:
    """Read what the scales of the map are made of; raises `CyclerError`."""
    found: dict[str, float] = {}
    for name, register_name in device_map.constants.items():
        value = await read_value(link, device_map.registers[register_name], {})
        if isinstance(value, str) or not math.isfinite(value):
            raise CyclerProtocolError(
                f"{link.address}: constant {name} (register '{register_name}') reads {value!r}, not a number"
            )
        found[name] = float(value)
    return found


async def read_identity(link: ModbusLink, device_map: DeviceMap) -> dict[str, str]:
    """Read what the device says of itself, by `IDENTITY_ROLES`; empty where its map has no place for it."""
    found = {role: await read_role(link, device_map, role, {}) for role in IDENTITY_ROLES}
    return {role: "" if value is None else str(value) for role, value in found.items()}


async def read_role(link: ModbusLink, device_map: DeviceMap, role: str, constants: Mapping[str, float]) -> Value | None:
    """Read the register of a role; None where the map has none."""
    register = device_map.by_role(role)
    return None if register is None else await read_value(link, register, constants)


async def read_value(link: ModbusLink, register: Register, constants: Mapping[str, float]) -> Value:
    """Read one register."""
    raw = await link.read_registers(register.space, register.address, register.words, f"'{register.name}'")
    return bind(register, constants).decode(raw)
