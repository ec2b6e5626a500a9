"""A cycler seen through its device map: registers and coils in front, set-points and measurements behind."""

from collections.abc import Callable, Mapping

from drivers.register_map import DeviceMap
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler
from simulators.modbus_refusals import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusRefusals, RefusedError
from simulators.register_commands import RegisterCommands
from simulators.register_image import RegisterImage
from simulators.register_readouts import RegisterReadouts
from simulators.registers import RegisterCodec

__all__ = ["MapDevice"]

_CURRENT_ROLES = frozenset(
    ("set_current", "actual_current", "setpoint_in_force", "limit_current_high", "limit_current_low")
)


class MapDevice:
    """Registers and coils of a cycler.

    Parameters
    ----------
    device_map : DeviceMap
        Says which register plays which role; registers without a role are plain memory.
    cycler : Cycler
    clock : SimulatedClock
    refusals : ModbusRefusals

    Notes
    -----
    A write is checked as a whole before any of it is taken over, then taken over in the order of the addresses, so
    that one message can carry set-point, heartbeat and lock-step tick.
    """

    def __init__(self, device_map: DeviceMap, cycler: Cycler, clock: SimulatedClock, refusals: ModbusRefusals) -> None:
        self.map, self.cycler, self.clock = device_map, cycler, clock
        if self.map.switch("remote") is None:
            cycler.set_remote(True)  # a device that takes commands whenever they come
        constants = cycler.settings.constants
        self._codecs = {name: RegisterCodec(reg, constants) for name, reg in device_map.registers.items()}
        self._writable = {
            (codec.register.space, codec.register.address): codec
            for codec in self._codecs.values()
            if codec.register.writable
        }
        self.image = RegisterImage(device_map)
        self._commands = RegisterCommands(device_map, cycler, clock, refusals)
        self._coils = {coil.address: coil for coil in device_map.coils.values()}
        self._plain_coils: dict[int, bool] = {}
        self._show_roles(RegisterReadouts(device_map, cycler, clock, self._commands).by_role())
        self._store_fixed(constants)
        self.publish()

    def _show_roles(self, readouts: Mapping[str, Callable[[], float]]) -> None:
        for codec in self._codecs.values():
            role = codec.register.role
            if role is not None and role in readouts:
                self.image.show(codec, self._in_own_sign(role, readouts[role]))

    def _in_own_sign(self, role: str, readout: Callable[[], float]) -> Callable[[], float]:
        return (lambda: -readout()) if self._is_turned(role) else readout

    def _house_sign(self, role: str | None, value: float) -> float:
        return -value if self._is_turned(role) else value

    def _is_turned(self, role: str | None) -> bool:
        """Whether the device counts this current the other way round than the house."""
        return role in _CURRENT_ROLES and self.map.positive_current == "discharge"

    def _store_fixed(self, constants: Mapping[str, float]) -> None:
        fixed: dict[str, float | str] = {self.map.identity.register: self.map.identity.equals[0]}
        fixed |= {register: constants[name] for name, register in self.map.constants.items() if name in constants}
        if "map_version" in self._codecs:
            fixed["map_version"] = 1
        for name, value in fixed.items():
            self.image.store(self._codecs[name], value)

    def poll(self) -> None:
        """Let simulated time catch up with the clock."""
        if self.clock.poll(self.cycler):
            self.publish()

    def heard(self) -> None:
        """Catch up, then note that a client has sent a message."""
        self.poll()
        self.clock.heard()

    def rest(self) -> None:
        """Switch the output off, as a device does that is being shut down."""
        self.cycler.set_output(False)
        self.publish()

    def publish(self) -> None:
        """Bring the registers up to date with the cycler."""
        self.image.publish()

    # --- registers -----------------------------------------------------------------------------------------
    def read(self, space: str, first: int, count: int) -> bytes:
        """Return the bytes of `count` registers.

        Raises
        ------
        RefusedError
            If they do not lie in one readable block of the map.
        """
        return self.image.read(space, first, count)

    def write(self, first: int, data: bytes) -> None:
        """Write whole values to holding registers, all or nothing.

        Raises
        ------
        RefusedError
            If an address is not writable or cuts through a value, a value is not finite or out of range, or the
            device's state does not allow it.
        """
        values = self._decoded(first, data)
        if self.map.single_writes and len(values) > 1:
            raise RefusedError(ILLEGAL_VALUE, "this device takes one register in a message")
        for codec, value in values:
            role = codec.register.role
            self._commands.check(role, self._house_sign(role, value))
        taken = [(codec, value) for codec, value in values if self._commands.is_taken(codec.register.role, value)]
        for codec, value in taken:
            role = codec.register.role
            if role is not None and self._commands.has(role):
                self._commands.take(role, self._house_sign(role, value))
            else:
                self.image.store(codec, value)
        self.publish()

    def _decoded(self, first: int, data: bytes) -> list[tuple[RegisterCodec, float]]:
        values: list[tuple[RegisterCodec, float]] = []
        offset = 0
        while offset < len(data):
            codec = self._writable.get(("holding", first + offset // 2))
            if codec is None or offset + codec.size > len(data):
                raise RefusedError(ILLEGAL_ADDRESS, f"no whole writable value at holding {first + offset // 2}")
            try:
                value = codec.decode(data[offset : offset + codec.size])
            except ValueError as error:
                raise RefusedError(ILLEGAL_VALUE, str(error)) from error
            values.append((codec, value))
            offset += codec.size
        return values

    # --- coils ---------------------------------------------------------------------------------------------
    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return `count` coils.

        Raises
        ------
        RefusedError
            If one of them is not in the map.
        """
        return [self._coil(address) for address in range(first, first + count)]

    def _coil(self, address: int) -> bool:
        coil = self._coils.get(address)
        if coil is None or "r" not in coil.access:
            raise RefusedError(ILLEGAL_ADDRESS, f"coil {address} cannot be read")
        states: dict[str | None, bool] = {
            "remote": self.cycler.remote,
            "output": self.cycler.output_on,
            "clear_alarms": False,
        }
        return states[coil.role] if coil.role in states else self._plain_coils.get(address, False)

    def write_coils(self, first: int, values: list[bool]) -> None:
        """Write coils, all or nothing.

        Raises
        ------
        RefusedError
            If one of them is not writable, or the device's state does not allow it.
        """
        roles: dict[str, bool] = {}
        plain: dict[int, bool] = {}
        for address, value in enumerate(values, first):
            coil = self._coils.get(address)
            if coil is None or "w" not in coil.access:
                raise RefusedError(ILLEGAL_ADDRESS, f"coil {address} cannot be written")
            if coil.role is None:
                plain[address] = value
            else:
                roles[coil.role] = value
        self._commands.switch(roles)
        self._plain_coils |= plain
        self.publish()
