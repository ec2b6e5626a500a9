"""Does a device map hold together: names that point somewhere, no overlaps, function codes that suffice."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import NoReturn

from drivers.device_map import LIMIT_ROLES, SETPOINT_ROLES, Coil, DeviceMap, Register
from drivers.errors import BadMapError
from drivers.read_plan import block_of

NEEDED_REGISTER_ROLES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "cycler": ("actual_voltage", "actual_current", "status"),
        "chamber": ("temperature", "set_temperature", "status"),
    }
)
READ_BACK_ROLES = (*LIMIT_ROLES, "set_temperature", "ramp", "watchdog", "hold_voltage", "lock_step", "lock_step_period")
_READ_FUNCTION = {"holding": 3, "input": 4}


def check_device_map(device_map: DeviceMap) -> None:
    """Check everything that more than one key is needed for.

    Raises
    ------
    BadMapError
        At the first contradiction.
    """
    _check_roles(device_map)
    _check_layout(device_map)
    _check_functions(device_map)
    _check_references(device_map)
    _check_sequences(device_map)
    _check_frames(device_map)


def _fail(device_map: DeviceMap, key: str, reason: str) -> NoReturn:
    raise BadMapError(device_map.file, key, reason)


def _check_roles(device_map: DeviceMap) -> None:
    """Each role at most once, the needed ones exactly once, with the access they need."""
    entries: list[Register | Coil] = [*device_map.registers.values(), *device_map.coils.values()]
    for role, count in Counter(entry.role for entry in entries if entry.role).items():
        if count > 1:
            _fail(device_map, "reg", f"role '{role}' is given to {count} entries; it may be given to one")
    for role in NEEDED_REGISTER_ROLES[device_map.kind]:
        register = device_map.by_role(role)
        if register is None:
            _fail(device_map, "reg", f"no register has the role '{role}', which every {device_map.kind} needs")
        if not register.readable:
            _fail(device_map, f"reg.{register.name}.access", f"role '{role}' needs access 'r'")
    if device_map.kind == "cycler":
        _check_setpoints(device_map)
    for role in READ_BACK_ROLES:
        if (register := device_map.by_role(role)) and register.access != "rw":
            _fail(device_map, f"reg.{register.name}.access", f"role '{role}' is read back, so it needs access 'rw'")
    output = device_map.switch("output")
    if output is None or "w" not in output.access:
        reason = f"no writable coil or register has the role 'output', which every {device_map.kind} needs"
        _fail(device_map, "coil", reason)
    status = device_map.by_role("status")
    if status is None or "output_on" not in device_map.bits.get(status.name, {}):
        _fail(device_map, "bits", "the status register needs a bit 'output_on': the output is verified by it")
    if (device_map.by_role("lock_step") is None) != (device_map.by_role("lock_step_period") is None):
        _fail(device_map, "reg", "roles 'lock_step' and 'lock_step_period' come together or not at all")


def _check_setpoints(device_map: DeviceMap) -> None:
    """One signed set-point, or a charging one with perhaps a discharging one beside it."""
    signed, charge = device_map.by_role("set_current"), device_map.by_role("set_charge")
    if (signed is None) == (charge is None):
        reason = "one register must have the role 'set_current', or one 'set_charge' (and one 'set_discharge')"
        _fail(device_map, "reg", f"{reason}: every cycler needs a set-point")
    hold = device_map.by_role("hold_voltage")
    if hold is not None and (signed is None or hold.unlimited is None):
        reason = "needs 'unlimited' (what ends the hold), and goes with 'set_current' only"
        _fail(device_map, f"reg.{hold.name}", f"role 'hold_voltage' {reason}")
    for role in SETPOINT_ROLES:
        register = device_map.by_role(role)
        if register is not None and not register.writable:
            _fail(device_map, f"reg.{register.name}.access", f"role '{role}' needs access 'w'")
    if signed is not None and (device_map.by_role("set_discharge") or device_map.by_role("set_voltage")):
        _fail(device_map, "reg", "'set_discharge' and 'set_voltage' go with 'set_charge', not with 'set_current'")


def _check_layout(device_map: DeviceMap) -> None:
    """No two things at one address; every readable register inside one block, where there are blocks."""
    if not device_map.registers:
        _fail(device_map, "reg", "the map has no registers")
    if both := set(device_map.registers) & set(device_map.coils):
        _fail(device_map, f"coil.{min(both)}", "a register has the same name")
    ordered = sorted(device_map.registers.values(), key=lambda r: (r.space, r.address))
    for left, right in pairwise(ordered):
        if left.space == right.space and right.address < left.end:
            reason = f"overlaps '{left.name}' at {left.address}..{left.end - 1}"
            _fail(device_map, f"reg.{right.name}.address", reason)
    coils = Counter(coil.address for coil in device_map.coils.values())
    for coil in device_map.coils.values():
        if coils[coil.address] > 1:
            _fail(device_map, f"coil.{coil.name}.address", f"{coil.address} is given to two coils")
    blocks = sorted(device_map.blocks, key=lambda b: (b.space, b.first))
    for left, right in pairwise(blocks):
        if left.space == right.space and right.first <= left.last:
            _fail(device_map, "block", f"{right.first}..{right.last} overlaps {left.first}..{left.last}")
    for register in ordered if blocks else ():
        if register.readable and block_of(device_map, register) is None:
            reason = f"{register.address}..{register.end - 1} does not lie in one [[block]], so it cannot be read"
            _fail(device_map, f"reg.{register.name}.address", reason)


def _check_functions(device_map: DeviceMap) -> None:
    """The function codes must reach everything that the map says can be reached."""
    allowed = device_map.functions
    for register in device_map.registers.values():
        key = f"reg.{register.name}.access"
        if register.readable and _READ_FUNCTION[register.space] not in allowed:
            _fail(device_map, key, f"readable, but 'functions' lacks {_READ_FUNCTION[register.space]}")
        if register.writable and 16 not in allowed and (register.words > 1 or 6 not in allowed):
            _fail(device_map, key, "writable, but 'functions' lacks 16 (6 does for one word)")
        if register.readable and register.words > device_map.max_read_registers:
            _fail(device_map, key, f"longer than max_read_registers = {device_map.max_read_registers}")
    for coil in device_map.coils.values():
        if "w" in coil.access and not allowed & {5, 15}:
            _fail(device_map, f"coil.{coil.name}.access", "writable, but 'functions' lacks 5 or 15")


def _check_references(device_map: DeviceMap) -> None:
    """Identity, constants, bits and read-backs name registers that are there and can be read."""
    _readable(device_map, "identity.register", device_map.identity.register)
    for name, target in device_map.constants.items():
        key = f"const.{name}"
        if not name.isidentifier():
            _fail(device_map, key, "must be a name that an expression can use")
        register = _readable(device_map, key, target)
        if register.type == "string" or (register.scale and register.scale.names):
            _fail(device_map, key, f"'{target}' must be a number whose scale uses no constants")
    for name in device_map.bits:
        register = _readable(device_map, f"bits.{name}", name)
        highest = max(device_map.bits[name].values(), default=0)
        if register.type not in ("u16", "u32") or highest >= 16 * register.words:
            _fail(device_map, f"bits.{name}", f"bit {highest} does not exist in type {register.type}")
    status = device_map.by_role("status")
    known = device_map.bits.get(status.name, {}) if status else {}
    for register in device_map.registers.values():
        if register.negative is not None and register.role != "actual_current":
            _fail(device_map, f"reg.{register.name}.negative", "is for the role 'actual_current'")
        if register.negative is not None and register.negative not in known:
            _fail(device_map, f"reg.{register.name}.negative", f"'{register.negative}' is no bit of the status")
    for name in device_map.alarm_bits:
        if name not in known:
            _fail(device_map, "alarm_bits", f"'{name}' is no bit of the status")
    for register in device_map.registers.values():
        if register.verify.kind == "readback":
            _readable(device_map, f"reg.{register.name}.verify", register.verify.register or register.name)
        if register.verify.kind == "echo" and (register.words > 1 or 6 not in device_map.functions):
            reason = "an echo repeats the value only for one word written by function 6"
            _fail(device_map, f"reg.{register.name}.verify", reason)


def _readable(device_map: DeviceMap, key: str, name: object) -> Register:
    register = device_map.registers.get(name) if isinstance(name, str) else None
    if register is None:
        _fail(device_map, key, f"names {name!r}, which is not a register of this map")
    if not register.readable:
        _fail(device_map, key, f"names '{name}', which cannot be read")
    return register


def _check_sequences(device_map: DeviceMap) -> None:
    """Steps write what can be written: true or false to coils, numbers to registers."""
    for sequence, steps in device_map.sequences.items():
        for index, step in enumerate(steps):
            key = f"sequence.{sequence}[{index}]"
            entry = device_map.registers.get(step.write) or device_map.coils.get(step.write)
            if entry is None or "w" not in entry.access:
                _fail(device_map, f"{key}.write", f"'{step.write}' is nothing that can be written")
            if step.value is not None and isinstance(step.value, bool) != isinstance(entry, Coil):
                _fail(device_map, f"{key}.value", "coils take true or false, registers take numbers")
    output = device_map.switch("output")
    if output and not any(s.write == output.name and s.value == 0 for s in device_map.sequences["safe"]):
        off = "false" if isinstance(output, Coil) else "0"
        _fail(device_map, "sequence.safe", f"must write {off} to '{output.name}': safe means output off")


def _check_frames(device_map: DeviceMap) -> None:
    """Sample frames speak of registers that are there."""
    for index, frame in enumerate(device_map.frames):
        for name in (*frame.values, *frame.missing):
            if name not in device_map.registers and name not in device_map.coils:
                _fail(device_map, f"frame[{index}]", f"names {name!r}, which the map does not have")
