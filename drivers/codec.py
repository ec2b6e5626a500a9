"""Registers <-> engineering values. Pure: everything that a map leaves open is bound once, after connecting.

Modbus sends each 16-bit register most significant byte first (Modbus Application Protocol V1.1b3, 4.2); the order
of the registers inside a longer value is the map's `word_order`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from drivers.device_map import CURRENT_ROLES, DeviceMap, Register
from drivers.errors import CyclerProtocolError, SetPointRefusedError
from drivers.expression import Expression, ExpressionError

NAN = math.nan
_SINGLE = 1e-6  # what single precision may add to a number
Value = float | int | str
_FORMAT = {"u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f", "f64": "d"}
_RAW_RANGE = {
    "u16": (0, 0xFFFF),
    "i16": (-0x8000, 0x7FFF),
    "u32": (0, 0xFFFFFFFF),
    "i32": (-0x80000000, 0x7FFFFFFF),
}


@dataclass(frozen=True, slots=True)
class Codec:
    """One register with its constants put in: ``value = raw * factor / divisor``.

    A decimal scale such as 0.01 is kept as a divisor of 100, so that 2531 reads 25.31 and not a neighbour of it.
    `invalid` holds raw values as they are unpacked (signed, or as floating point).
    """

    name: str
    unit: str
    type: str
    words: int
    swap: bool
    factor: float
    divisor: float
    low: float
    high: float
    raw_low: float
    raw_high: float
    invalid: frozenset[float]
    plain: bool

    def decode(self, registers: Sequence[int]) -> Value:
        """Engineering value of the register; NaN where it is missing.

        Raises
        ------
        CyclerProtocolError
            If the number of registers is not the register's, or if a string is not text.
        """
        if len(registers) != self.words:
            raise CyclerProtocolError(f"register '{self.name}': needs {self.words} words, not {len(registers)}")
        data = struct.pack(f">{self.words}H", *(reversed(registers) if self.swap else registers))
        if self.type == "string":
            try:
                return data.split(b"\0", 1)[0].decode("ascii").strip()
            except UnicodeDecodeError:
                raise CyclerProtocolError(f"register '{self.name}': {data.hex()} is not text") from None
        return self.scaled(struct.unpack(f">{_FORMAT[self.type]}", data)[0])

    def scaled(self, raw: Any) -> Value:
        """Engineering value of an unpacked raw value; a whole number without scale stays one."""
        if raw in self.invalid:
            return NAN
        if self.plain:
            return raw
        value = raw * self.factor / self.divisor
        return value if math.isfinite(value) else NAN

    def encode(self, value: Value) -> tuple[int, ...]:
        """Registers of an engineering value.

        Raises
        ------
        SetPointRefusedError
            If the value is not finite, outside the range of the map or of the type, or reads as "missing".
        """
        if self.type == "string":
            return self._encode_string(value)
        if isinstance(value, (str, bool)) or not math.isfinite(value):
            raise self._refused(value, "is not a finite number")
        if not self.low <= value <= self.high:
            raise self._refused(value, f"is outside {self.low:g} .. {self.high:g} {self.unit}".rstrip())
        raw = value if self.plain else value * self.divisor / self.factor + 0.0  # never -0.0
        if self.type in _RAW_RANGE:
            raw = round(raw)
        if not self.raw_low <= raw <= self.raw_high:
            raise self._refused(value, f"needs raw {raw:g}, beyond {self.raw_low:g} .. {self.raw_high:g}")
        data = struct.pack(f">{_FORMAT[self.type]}", raw)
        if struct.unpack(f">{_FORMAT[self.type]}", data)[0] in self.invalid:
            raise self._refused(value, f"is raw 0x{data.hex()}, which the device reads as 'missing'")
        registers = struct.unpack(f">{self.words}H", data)
        return registers[::-1] if self.swap else registers

    def resolution(self, value: float) -> float:
        """Distance between neighbouring values at `value`, in the register's unit."""
        if self.type in _RAW_RANGE:
            return abs(self.factor / self.divisor)
        bits = 23 if self.type == "f32" else 52
        return max(abs(value), 1e-9) * 2.0**-bits

    def _encode_string(self, value: Value) -> tuple[int, ...]:
        data = value.encode("ascii", "replace") if isinstance(value, str) else b""
        if not isinstance(value, str) or not value.isascii() or len(data) > 2 * self.words:
            raise self._refused(value, f"is not an ASCII string of at most {2 * self.words} characters")
        return struct.unpack(f">{self.words}H", data.ljust(2 * self.words, b"\0"))

    def _refused(self, value: Value, reason: str) -> SetPointRefusedError:
        shown = value if isinstance(value, (str, bool)) else f"{value:g} {self.unit}".rstrip()
        return SetPointRefusedError(f"register '{self.name}': {shown} {reason}; not sent")


def check_watchdog(where: str, asked: float, written: float, step: float, unit: str = "s") -> None:
    """See that what a rounded watchdog is written as is one, and not a longer one: 0 switches many off.

    Raises
    ------
    SetPointRefusedError
    """
    if not 0.0 < written <= asked * (1.0 + _SINGLE):
        asked_of, written_as, steps_of = (f"{value:g} {unit}".rstrip() for value in (asked, written, step))
        raise SetPointRefusedError(
            f"{where}: a watchdog of {asked_of} would be written as {written_as}, the device has steps of {steps_of}; "
            "not sent; set the bench's watchdog_s to a multiple of that"
        )


def bind(register: Register, constants: Mapping[str, float], sign: float = 1.0) -> Codec:
    """Put a device's constants into a register.

    Parameters
    ----------
    register : Register
        From the map.
    constants : mapping of str to float
        Values read from the device, by the names in the map's ``[const]``.
    sign : float
        -1 turns a device's current convention into the house's (positive charges).

    Raises
    ------
    CyclerProtocolError
        If a scale or a range has no usable value with these constants.
    """

    def evaluate(expression: Expression) -> float:
        try:
            return expression.evaluate(constants)
        except ExpressionError as error:
            raise CyclerProtocolError(f"register '{register.name}': {error}; constants {dict(constants)}") from None

    scale = evaluate(register.scale) if register.scale else 1.0
    low, high = (evaluate(part) for part in register.range) if register.range else (-math.inf, math.inf)
    if scale == 0 or low > high:
        raise CyclerProtocolError(f"register '{register.name}': scale {scale:g}, range {low:g} .. {high:g} is unusable")
    factor, divisor = _as_ratio(scale)
    raw_low, raw_high = _RAW_RANGE.get(register.type, (-math.inf, math.inf))
    if register.type == "f32":
        raw_low, raw_high = -_F32_MAX, _F32_MAX
    if register.raw_max is not None:
        raw_high = min(raw_high, register.raw_max)
    return Codec(
        name=register.name,
        unit=register.unit,
        type=register.type,
        words=register.words,
        swap=register.word_order == "little" and register.words > 1 and register.type != "string",
        factor=factor * sign,
        divisor=divisor,
        low=low,
        high=high,
        raw_low=raw_low,
        raw_high=raw_high,
        invalid=frozenset(_unpacked(register.type, raw) for raw in register.invalid),
        plain=register.type in _RAW_RANGE and register.scale is None and sign == 1.0,
    )


def bind_all(device_map: DeviceMap, constants: Mapping[str, float]) -> dict[str, Codec]:
    """Bind every register of a map; the only place where a current's sign is turned."""
    turn = -1.0 if device_map.positive_current == "discharge" else 1.0
    return {
        name: bind(register, constants, turn if register.role in CURRENT_ROLES else 1.0)
        for name, register in device_map.registers.items()
    }


class BlockDecoder:
    """Decodes the registers of one read message in one go.

    One `struct.unpack` for the whole block; what lies between the wanted registers is skipped.

    Parameters
    ----------
    first, count : int
        Address range of the message.
    entries : sequence of (int, Codec)
        Address and codec of each wanted register, by rising address; strings are not taken.
    """

    def __init__(self, first: int, count: int, entries: Sequence[tuple[int, Codec]]) -> None:
        layout, order, position = ">", list(range(count)), first
        for address, codec in entries:
            layout += f"{2 * (address - position)}x{_FORMAT[codec.type]}"
            if codec.swap:
                start = address - first
                order[start : start + codec.words] = reversed(order[start : start + codec.words])
            position = address + codec.words
        self._layout = struct.Struct(f"{layout}{2 * (first + count - position)}x")
        self._registers = struct.Struct(f">{count}H")
        self._reorder = None if order == sorted(order) else itemgetter(*order)
        self._codecs = tuple(codec for _, codec in entries)

    def decode(self, registers: Sequence[int]) -> list[Value]:
        """Values in the order of the entries; NaN where one is missing.

        `registers` must have as many items as the message asked for: the transport has checked that.
        """
        if self._reorder:
            registers = self._reorder(registers)
        raws = self._layout.unpack(self._registers.pack(*registers))
        return [codec.scaled(raw) for codec, raw in zip(self._codecs, raws, strict=True)]


_F32_MAX = struct.unpack(">f", b"\x7f\x7f\xff\xff")[0]


def _as_ratio(scale: float) -> tuple[float, float]:
    """Split a scale into factor and divisor: (1, n) where it is one n-th, else (scale, 1)."""
    inverse = round(1.0 / scale) if 1e-12 < abs(scale) < 1.0 else 0
    return (1.0, float(inverse)) if inverse and abs(scale * inverse - 1.0) < 1e-15 else (scale, 1.0)


def _unpacked(kind: str, raw: int) -> float:
    """Read a bit pattern of the map the way `struct` will unpack it."""
    layout = struct.Struct(f">{_FORMAT[kind]}")
    return layout.unpack(raw.to_bytes(layout.size, "big"))[0]
