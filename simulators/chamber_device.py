"""A chamber seen through its device map: registers and coils in front, air and set point behind."""

from collections.abc import Callable

from drivers.register_map import DeviceMap
from simulators.chamber import Chamber
from simulators.modbus_actions import Action, Frame
from simulators.modbus_refusals import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError
from simulators.register_image import RegisterImage
from simulators.registers import RegisterCodec

__all__ = ["ChamberDevice", "ChamberFaults"]

_SAID: dict[str, float | str] = {"maker": "bench", "model": "air", "serial": 1, "firmware": 1}


class ChamberDevice:
    """Registers and coils of a chamber; what `simulators.modbus_server` serves.

    Parameters
    ----------
    device_map : DeviceMap
        Of kind "chamber".
    chamber : Chamber
    catch_up : Callable
        Lets simulated time come to the present before a client is answered.
    """

    def __init__(self, device_map: DeviceMap, chamber: Chamber, catch_up: Callable[[], object]) -> None:
        self.map, self.chamber, self._catch_up = device_map, chamber, catch_up
        self._codecs = {name: RegisterCodec(register, {}) for name, register in device_map.registers.items()}
        self.image = RegisterImage(device_map)
        for codec in self._codecs.values():
            role = codec.register.role
            if role in _SAID:
                self.image.store(codec, _SAID[role])
            elif role is not None and role in (shown := self._shown()):
                self.image.show(codec, shown[role])
        self.image.store(self._codecs[device_map.identity.register], device_map.identity.equals[0])
        self._coils = {coil.address: coil for coil in device_map.coils.values()}
        self.publish()

    def _shown(self) -> dict[str, Callable[[], float]]:
        chamber = self.chamber
        return {
            "temperature": lambda: chamber.shown_degC,
            "set_temperature": lambda: chamber.set_degC,
            "output": lambda: float(chamber.on),
            "status": lambda: float(self._bits("status", {"output_on"} if chamber.on else set())),
            "alarms": lambda: float(self._bits("alarms", chamber.alarms)),
        }

    def _bits(self, role: str, names: set[str]) -> int:
        register = self.map.by_role(role)
        bits = self.map.bits.get(register.name, {}) if register else {}
        return sum(1 << bits[name] for name in names if name in bits)

    def poll(self) -> None:
        """Let simulated time catch up with the clock."""
        self._catch_up()

    def heard(self) -> None:
        """Catch up before a message is answered."""
        self.poll()
        self.publish()

    def rest(self) -> None:
        """Switch off, as a device does that is being shut down."""
        self.chamber.switch(False)

    def publish(self) -> None:
        """Bring the registers up to date."""
        self.image.publish()

    def read(self, space: str, first: int, count: int) -> bytes:
        """Return the bytes of `count` registers; raises `RefusedError`."""
        return self.image.read(space, first, count)

    def write(self, first: int, data: bytes) -> None:
        """Write one whole value; raises `RefusedError`."""
        codec = next((c for c in self._codecs.values() if c.register.address == first and c.register.writable), None)
        if codec is None or len(data) != codec.size:
            raise RefusedError(ILLEGAL_ADDRESS, f"no whole writable value at holding {first}")
        try:
            value = codec.decode(data)
        except ValueError as error:
            raise RefusedError(ILLEGAL_VALUE, str(error)) from error
        self._take(codec.register.role, value)
        self.publish()

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return `count` coils; raises `RefusedError`."""
        return [self._coil(address) == "output" and self.chamber.on for address in range(first, first + count)]

    def write_coils(self, first: int, values: list[bool]) -> None:
        """Write coils; raises `RefusedError`."""
        roles = [self._coil(first + index) for index in range(len(values))]
        for role, value in zip(roles, values, strict=True):
            self._take(role, float(value))
        self.publish()

    def _coil(self, address: int) -> str | None:
        if address not in self._coils:
            raise RefusedError(ILLEGAL_ADDRESS, f"there is no coil {address}")
        return self._coils[address].role

    def _take(self, role: str | None, value: float) -> None:
        if role == "set_temperature":
            self.chamber.set(value)
        elif role == "output":
            self.chamber.switch(bool(value))
        elif role == "clear_alarms" and value:
            self.chamber.alarms.clear()


class ChamberFaults:
    """Fault hook of `simulators.modbus_server.ModbusServer` in front of a chamber.

    Parameters
    ----------
    device : ChamberDevice
    to_action : Callable
        From a fault to what is to be done with a request.
    """

    def __init__(self, device: ChamberDevice, to_action: Callable[..., Action]) -> None:
        self._device, self._to_action = device, to_action
        register = device.map.by_role("set_temperature")
        self._setpoint = None if register is None else register.address

    def __call__(self, frame: Frame) -> Action | None:
        """Return what is to be done with a request."""
        events = {"sample"} if frame.function in (3, 4) else set[str]()
        if frame.function in (6, 16) and int.from_bytes(frame.pdu[1:3], "big") == self._setpoint:
            events.add("set_point")
        if frame.function == 5 and frame.pdu[3:4] == b"\xff":
            events.add("output_on")
        self._device.poll()
        met = self._device.chamber.faults.message(events)
        return self._to_action(met[0], frame) if met else None
