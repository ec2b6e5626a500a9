"""Do the sample frames of a map mean what they say? Constants of the device count as `NOMINAL` in them."""

from __future__ import annotations

import math
import struct

from drivers.can_codec import CanCodec
from drivers.can_map import CanMap
from drivers.codec import Codec, bind_all
from drivers.device_map import DeviceMap, Frame, Register
from drivers.errors import BadMapError, CyclerError

NOMINAL = 100.0
_READS = {3: "holding", 4: "input"}
_RELATIVE, _ABSOLUTE = 1e-6, 1e-9


def check_frames(device_map: DeviceMap | CanMap) -> int:
    """Check every sample frame of a map; return how many there are.

    Raises
    ------
    BadMapError
        At the first frame whose bytes and values disagree, with both.
    """
    if isinstance(device_map, CanMap):
        codec = CanCodec(device_map.dbc, device_map.views)
        for index, frame in enumerate(device_map.frames):
            found = codec.physical(frame.message, codec.raw(frame.message, frame.data))
            wrong = {name: found[name] for name, value in frame.values.items() if not _close(found[name], value)}
            if wrong:
                _fail(device_map, index, f"the bytes say {wrong}, the values {dict(frame.values)}")
            if (data := codec.encode(frame.message, frame.values)[: len(frame.data)]) != frame.data:
                _fail(device_map, index, f"the values make {data.hex(' ')}, the frame says {frame.data.hex(' ')}")
        return len(device_map.frames)
    codecs = bind_all(device_map, dict.fromkeys(device_map.constants, NOMINAL))
    for index, frame in enumerate(device_map.frames):
        try:
            reason = _modbus(device_map, codecs, frame)
        except (CyclerError, struct.error, KeyError, IndexError) as error:
            reason = str(error) or repr(error)
        if reason:
            _fail(device_map, index, reason)
    return len(device_map.frames)


def _fail(device_map: DeviceMap | CanMap, index: int, reason: str) -> None:
    raise BadMapError(device_map.file, f"frame[{index}]", reason)


def _close(found: float, value: float) -> bool:
    return math.isclose(found, value, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE)


def _modbus(device_map: DeviceMap, codecs: dict[str, Codec], frame: Frame) -> str | None:
    """Return what is wrong with a frame, None if nothing is."""
    function = frame.request[0]
    if function not in device_map.functions:
        return f"function {function} is not among the map's"
    if function in _READS:
        return _read(device_map, codecs, frame)
    if function in (5, 6, 16):
        request = _written(device_map, codecs, frame)
        if request != frame.request:
            return f"the values make the request {request.hex(' ')}, the frame says {frame.request.hex(' ')}"
        return None if frame.reply == request[:5] else f"the reply should be {request[:5].hex(' ')}"
    return f"frames of function {function} cannot be checked; use 3, 4, 5, 6 or 16"


def _read(device_map: DeviceMap, codecs: dict[str, Codec], frame: Frame) -> str | None:
    first, count = struct.unpack(">HH", frame.request[1:])
    if frame.reply[:2] != bytes((frame.request[0], 2 * count)) or len(frame.reply) != 2 + 2 * count:
        return f"the reply must begin with {bytes((frame.request[0], 2 * count)).hex(' ')} and hold {count} registers"
    words = struct.unpack(f">{count}H", frame.reply[2:])
    for register in _covered(device_map, _READS[frame.request[0]], first, count):
        value = codecs[register.name].decode(words[register.address - first : register.end - first])
        if register.name in frame.missing:
            if not (isinstance(value, float) and math.isnan(value)):
                return f"'{register.name}' reads {value}, not 'missing'"
        elif register.name not in frame.values:
            return f"'{register.name}' is in the frame, but not among its values"
        elif isinstance(value, str):
            if value != frame.values[register.name]:
                return f"'{register.name}' reads {value!r}, the values say {frame.values[register.name]!r}"
        elif not _close(value, float(frame.values[register.name])):
            return f"'{register.name}' reads {value:g}, the values say {frame.values[register.name]}"
    return None


def _covered(device_map: DeviceMap, space: str, first: int, count: int) -> list[Register]:
    inside = (r for r in device_map.registers.values() if first <= r.address and r.end <= first + count)
    return sorted((r for r in inside if r.space == space), key=lambda r: r.address)


def _written(device_map: DeviceMap, codecs: dict[str, Codec], frame: Frame) -> bytes:
    """Build the request of a writing frame from its values alone."""
    coil = next((device_map.coils[name] for name in frame.values if name in device_map.coils), None)
    if coil is not None:
        return struct.pack(">BHH", 5, coil.address, 0xFF00 if frame.values[coil.name] else 0)
    registers = sorted((device_map.registers[name] for name in frame.values), key=lambda r: r.address)
    words = [word for r in registers for word in codecs[r.name].encode(frame.values[r.name])]
    data = struct.pack(f">{len(words)}H", *words)
    if frame.request[0] == 6:
        return struct.pack(">BH", 6, registers[0].address) + data
    return struct.pack(">BHHB", 16, registers[0].address, len(words), len(data)) + data
