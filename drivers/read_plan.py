"""Which registers are read together: pure planning, done once after connecting."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from drivers.device_map import Block, DeviceMap, Register, Space


@dataclass(frozen=True, slots=True)
class ReadPlan:
    """One read message: `count` registers from `first`, of which `registers` are wanted; `label` for messages."""

    space: Space
    first: int
    count: int
    registers: tuple[Register, ...]
    label: str = field(compare=False)


def plan_reads(device_map: DeviceMap, names: Iterable[str]) -> tuple[ReadPlan, ...]:
    """Group registers into the fewest read messages that the device allows.

    A message stays within one block and the map's largest count, spans only addresses that belong to readable
    registers (never a gap, which some devices answer with an exception), cuts no register in two, and holds a
    single type where its block asks for that.

    Parameters
    ----------
    device_map : DeviceMap
        The validated map.
    names : iterable of str
        Readable registers, in any order.

    Returns
    -------
    tuple of ReadPlan
        In order of space and address.
    """
    wanted = sorted({device_map.registers[n] for n in names}, key=lambda r: (r.space, r.address))
    groups: list[list[Register]] = []
    for register in wanted:
        if groups and _fits(device_map, groups[-1], register):
            groups[-1].append(register)
        else:
            groups.append([register])
    return tuple(_message(group) for group in groups)


def _message(group: list[Register]) -> ReadPlan:
    first, count, names = group[0].address, group[-1].end - group[0].address, [r.name for r in group]
    shown = ", ".join(names if len(names) <= 3 else [names[0], "...", names[-1]])
    label = f"{shown} ({group[0].space} {first}..{first + count - 1})"
    return ReadPlan(group[0].space, first, count, tuple(group), label)


def block_of(device_map: DeviceMap, register: Register) -> Block | None:
    """Return the block that a register lies in as a whole, or None."""
    return next(
        (
            block
            for block in device_map.blocks
            if block.space == register.space and block.first <= register.address and register.end - 1 <= block.last
        ),
        None,
    )


def _fits(device_map: DeviceMap, group: list[Register], register: Register) -> bool:
    """Whether a register can be read in the same message as a group that lies before it."""
    block = block_of(device_map, group[0])
    if block is None or block_of(device_map, register) != block:
        return False
    first = group[0].address
    if register.end - first > device_map.max_read_registers:
        return False
    between = sorted(
        (
            r
            for r in device_map.registers.values()
            if r.space == register.space and r.readable and first <= r.address and r.end <= register.end
        ),
        key=lambda r: r.address,
    )
    if any(left.end != right.address for left, right in zip(between, between[1:], strict=False)):
        return False
    return not block.one_type or len({r.type for r in between}) == 1
