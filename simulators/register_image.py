"""The registers of a simulated device as they stand: bytes, what may be read at once, and what they show."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from drivers.register_map import DeviceMap
from simulators.modbus_refusals import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError
from simulators.registers import RegisterCodec

__all__ = ["RegisterImage"]


@dataclass(slots=True)
class _Shown:
    """A register that shows something of the device, where it stands, and the value that it shows."""

    codec: RegisterCodec
    getter: Callable[[], float]
    image: bytearray
    first: int
    value: float = math.nan


class RegisterImage:
    """Bytes of all registers of a map, those without a role being plain memory."""

    def __init__(self, device_map: DeviceMap) -> None:
        self._registers = tuple(device_map.registers.values())
        self._spaces, self._block_end = _layout(device_map)
        one_type = (block for block in device_map.blocks if block.one_type)
        self._one_type = {(b.space, address) for b in one_type for address in range(b.first, b.last + 1)}
        self._shown: list[_Shown] = []

    def read(self, space: str, first: int, count: int) -> bytes:
        """Return the bytes of `count` registers.

        Raises
        ------
        RefusedError
            If they do not lie in one readable block of the map.
        """
        ends = self._block_end[space]
        if first >= len(ends) or first + count > ends[first]:
            raise RefusedError(ILLEGAL_ADDRESS, f"no readable block holds {space} {first}..{first + count - 1}")
        if (space, first) in self._one_type and len(self._types(space, first, count)) > 1:
            raise RefusedError(ILLEGAL_VALUE, f"{space} {first}..{first + count - 1} holds more than one type")
        return bytes(self._spaces[space][2 * first : 2 * (first + count)])

    def _types(self, space: str, first: int, count: int) -> set[str]:
        return {r.type for r in self._registers if r.space == space and first < r.end and r.address < first + count}

    def store(self, codec: RegisterCodec, value: float | str) -> None:
        """Put a value into its register."""
        register = codec.register
        data = codec.encode(value)
        self._spaces[register.space][2 * register.address : 2 * register.address + codec.size] = data

    def show(self, codec: RegisterCodec, getter: Callable[[], float]) -> None:
        """Let a register show, from the next `publish` on, what a function returns, in the device's own sign."""
        self._shown.append(_Shown(codec, getter, self._spaces[codec.register.space], 2 * codec.register.address))

    def publish(self) -> None:
        """Bring every register that shows something up to date."""
        for entry in self._shown:
            value = entry.getter()
            if value != entry.value or value == 0.0:  # NaN is never the same, and 0 may have changed its sign
                entry.value = value
                codec = entry.codec
                entry.image[entry.first : entry.first + codec.size] = codec.encode(value)


def _layout(device_map: DeviceMap) -> tuple[dict[str, bytearray], dict[str, list[int]]]:
    """Return the empty image of each space, and for each address the end of the block that holds it (0: none)."""
    image: dict[str, bytearray] = {}
    ends: dict[str, list[int]] = {}
    for space in ("holding", "input"):
        registers = [reg for reg in device_map.registers.values() if reg.space == space]
        blocks = [(b.first, b.last + 1) for b in device_map.blocks if b.space == space]
        blocks = blocks or [(reg.address, reg.end) for reg in registers]
        size = max([end for _, end in blocks] + [reg.end for reg in registers], default=0)
        image[space] = bytearray(2 * size)
        ends[space] = [0] * size
        for first, end in blocks:
            ends[space][first:end] = [end] * (end - first)
    return image, ends
