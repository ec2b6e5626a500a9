"""Registers to values and back, for the simulators alone.

The drivers have a codec of their own and neither imports the other, so that one mistake cannot agree with itself.
"""

import math
import struct
from collections.abc import Mapping

from drivers.register_map import Register

__all__ = ["RegisterCodec"]

_FORMATS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f", "f64": "d"}
_INTEGER_BOUNDS = {"H": (0, 0xFFFF), "h": (-0x8000, 0x7FFF), "I": (0, 0xFFFFFFFF), "i": (-0x80000000, 0x7FFFFFFF)}


class RegisterCodec:
    """Bytes of one register as they stand in a message, and the value in its unit.

    Parameters
    ----------
    register : Register
    constants : Mapping[str, float]
        Values of the map's named constants, for scale and range.

    Attributes
    ----------
    size : int
        Bytes in a message.
    """

    def __init__(self, register: Register, constants: Mapping[str, float]) -> None:
        self.register = register
        self.size = 2 * register.words
        self._format = _FORMATS.get(register.type)
        self._struct = struct.Struct(">" + (self._format or f"{self.size}s"))
        self._scale = register.scale.evaluate(constants) if register.scale else 1.0
        bounds = register.range
        self._low, self._high = (
            (bounds[0].evaluate(constants), bounds[1].evaluate(constants)) if bounds else (-math.inf, math.inf)
        )
        self._swap = register.word_order == "little"

    def encode(self, value: float | str) -> bytes:
        """Return the bytes of a value; integers saturate.

        NaN becomes the register's first invalid pattern; an integer that has none reads its largest value then, as of
        a converter whose sensor has come off.
        """
        if self._format is None:
            text = str(value).encode("ascii")[: self.size]
            return text.ljust(self.size, b"\0")
        number = float(value)
        if math.isnan(number) and self.register.invalid:
            return self._ordered(self.register.invalid[0].to_bytes(self.size, "big"))
        if self._format in _INTEGER_BOUNDS:
            low, high = _INTEGER_BOUNDS[self._format]
            raw = high if math.isnan(number) else round(min(max(number / self._scale, low), high))
            return self._ordered(self._struct.pack(raw))
        return self._ordered(self._struct.pack(number / self._scale))

    def decode(self, data: bytes) -> float:
        """Return the value of bytes that a client wrote.

        Raises
        ------
        ValueError
            If it is NaN, infinite, a pattern that means "missing", or outside the register's range.
        """
        data = self._ordered(data)
        raw = self._struct.unpack(data)[0]
        if int.from_bytes(data, "big") in self.register.invalid:
            raise ValueError(f"{self.register.name}: raw {raw} means missing")
        value = raw * self._scale
        # The edge of the range may have been rounded to single precision on its way here.
        low, high = self._low - 1e-6 * abs(self._low), self._high + 1e-6 * abs(self._high)
        if not math.isfinite(value) or not low <= value <= high:
            raise ValueError(f"{self.register.name}: {value} {self.register.unit} is not in range")
        if self.register.raw_max is not None and raw > self.register.raw_max:
            raise ValueError(f"{self.register.name}: raw {raw} is above {self.register.raw_max}")
        return value

    def _ordered(self, data: bytes) -> bytes:
        if not self._swap or len(data) == 2:
            return data
        return b"".join(data[i : i + 2] for i in range(len(data) - 2, -1, -2))
