"""From a fault script to what each protocol's server is told to do with a message."""

import struct
from collections.abc import Mapping

from drivers.register_map import CanMap, DeviceMap
from simulators.can_bus import CanAction
from simulators.faults import Fault, FaultEngine
from simulators.modbus_actions import Action, Frame

__all__ = ["CanFaults", "ModbusFaults", "modbus_action"]

CAN_REFUSED = 2  # state does not allow it
CUT_BYTES = 3


class ModbusFaults:
    """Fault hook of `simulators.modbus_server.ModbusServer` and `simulators.rtu_server.RtuServer`."""

    def __init__(self, device_map: DeviceMap, engine: FaultEngine) -> None:
        self._engine = engine
        self._set_points = {
            r.address
            for role in ("set_current", "set_charge", "set_discharge")
            if (r := device_map.by_role(role)) is not None
        }
        voltage = device_map.by_role("actual_voltage")
        self._voltage = voltage.address if voltage else -1
        output = device_map.coil_by_role("output")
        self._output = output.address if output else -1

    def __call__(self, frame: Frame) -> Action | None:
        """Return what is to be done with a request."""
        met = self._engine.message(self._events(frame))
        return modbus_action(met[0], frame) if met else None

    def _events(self, frame: Frame) -> set[str]:
        pdu, events = frame.pdu, set[str]()
        if len(pdu) < 5:
            return events
        first, count = struct.unpack_from(">HH", pdu, 1)
        if frame.function in (3, 4, 23) and first <= self._voltage < first + count:
            events.add("sample")
        if frame.function == 23:
            first, count = struct.unpack_from(">HH", pdu, 5)
        if frame.function in (6, 16, 23):
            span = range(first, first + (1 if frame.function == 6 else count))
            if any(address in span for address in self._set_points):
                events.add("set_point")
        if frame.function == 5 and first == self._output and count:
            events.add("output_on")
        return events


def modbus_action(fault: Fault, frame: Frame) -> Action:
    """Return what a fault of the link makes of a request."""
    kind = fault.kind
    if kind in ("delay", "late", "slow"):
        return Action(delay_s=fault.value)
    if kind == "exception":
        return Action(exception=int(fault.value))
    if kind in ("drop", "bus_off"):
        return Action(execute=False, reply=False, close=True)
    if kind == "wrong_id":
        return Action(unit_id=(frame.unit_id + int(fault.value)) % 256)
    if kind == "corrupt":
        return Action(corrupt=True)
    if kind == "echo":
        return Action(echo=True)
    return Action(execute=kind == "lost_reply", reply=False)


class CanFaults:
    """Fault hook of `simulators.can_node.CanNode`."""

    def __init__(self, can_map: CanMap, engine: FaultEngine) -> None:
        self._engine = engine
        self._map = can_map

    def __call__(self, message: str, raws: Mapping[str, float]) -> CanAction | None:
        """Return what is to be done with a frame."""
        met = self._engine.message(self._events(message, raws))
        return _can_action(met[0]) if met else None

    def _events(self, message: str, raws: Mapping[str, float]) -> set[str]:
        events = set[str]()
        voltage = self._map.roles["actual_voltage"].name.message
        for ask in self._map.asks.values():
            fixed = {s: e.evaluate({}) for s, e in ask.send.values.items() if not e.names}
            if ask.send.message == message and voltage in ask.replies and _fits(fixed, raws):
                events.add("sample")
        for command in self._map.commands.values():
            fixed = {s: e.evaluate({}) for s, e in command.send.values.items() if not e.names}
            if command.send.message != message or not _fits(fixed, raws):
                continue
            arguments = {name: signal for signal, e in command.send.values.items() for name in e.names}
            if arguments.keys() & {"set_current", "charge", "discharge"}:
                events.add("set_point")
            if "output" in arguments and raws[arguments["output"]]:
                events.add("output_on")
        return events


def _fits(fixed: Mapping[str, float], raws: Mapping[str, float]) -> bool:
    return all(raws[signal] == value for signal, value in fixed.items())


def _can_action(fault: Fault) -> CanAction:
    kind = fault.kind
    if kind in ("delay", "late", "slow"):
        return CanAction(delay_s=fault.value)
    if kind == "exception":
        return CanAction(execute=False, refuse=CAN_REFUSED)
    if kind == "bus_off":
        return CanAction(bus_off=True)
    if kind == "wrong_id":
        return CanAction(shift=0x400)
    if kind == "corrupt":
        return CanAction(change=lambda _, data: data[:CUT_BYTES])
    if kind == "echo":
        return CanAction(execute=False, echo=True)
    return CanAction(execute=kind == "lost_reply", reply=False)
