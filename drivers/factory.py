"""URL and map name -> cycler."""

from __future__ import annotations

from pathlib import Path

from drivers.address import CanAddress, SerialAddress, TcpAddress, parse_address
from drivers.can_identifiers import identifiers_of
from drivers.chamber import Chamber
from drivers.cycler import Cycler
from drivers.errors import BadMapError, CyclerConnectionError
from drivers.modbus import ModbusCycler
from drivers.modbus_chamber import ModbusChamber
from drivers.modbus_clients import serial_client_factory, tcp_client_factory
from drivers.modbus_link import ModbusLink
from drivers.register_map import CanMap, DeviceMap, load_can_map, load_map, map_transport

SILENT_CHARACTERS = 3.5  # between two messages on a serial line (Modbus over Serial Line V1.02, 2.5.1.1)


def open_cycler(url: str, map_name: str | Path, timeout_s: float) -> Cycler:
    """Build the driver for a device; nothing is connected or sent yet.

    Parameters
    ----------
    url : str
        ``modbus-tcp://HOST:PORT`` (port 502 where none is given), ``modbus-rtu:///DEVICE?baud=N`` or
        ``can://INTERFACE/CHANNEL``; the options are those of `drivers.address`.
    map_name : str or Path
        Name of a map, or the path of one.
    timeout_s : float
        How long one answer may take, in s; shorter than the control period.

    Raises
    ------
    CyclerConnectionError
        If the URL cannot be understood.
    BadMapError
        If the map cannot be used.
    """
    if not timeout_s > 0:
        raise CyclerConnectionError(f"{url}: the time-out must be positive, not {timeout_s} s")
    address = parse_address(url)
    wanted, found = "can" if isinstance(address, CanAddress) else "modbus", map_transport(map_name)
    if found != wanted and found in ("can", "modbus"):
        raise BadMapError(map_name, "transport", f"is '{found}', but the address {url} wants '{wanted}'")
    if isinstance(address, CanAddress):
        return _can_cycler(address, load_can_map(map_name), timeout_s)
    device_map = load_map(map_name)
    return ModbusCycler(_modbus_link(address, device_map, timeout_s), device_map)


def open_chamber(url: str, map_name: str | Path, timeout_s: float) -> Chamber:
    """Build the driver for a temperature chamber, over Modbus; otherwise as `open_cycler`."""
    if not timeout_s > 0:
        raise CyclerConnectionError(f"{url}: the time-out must be positive, not {timeout_s} s")
    address = parse_address(url)
    if isinstance(address, CanAddress):
        raise CyclerConnectionError(f"{url}: a chamber is reached over modbus-tcp or modbus-rtu")
    device_map = load_map(map_name, "chamber")
    return ModbusChamber(_modbus_link(address, device_map, timeout_s), device_map)


def _can_cycler(address: CanAddress, can_map: CanMap, timeout_s: float) -> Cycler:
    # Lazy: python-can and cantools take 300 ms.
    from drivers.can_codec import CanCodec
    from drivers.can_cycler import CanCycler
    from drivers.can_link import CanLink

    codec = CanCodec(can_map.dbc, can_map.views)
    sends = [command.send for command in can_map.commands.values()] + [ask.send for ask in can_map.asks.values()]
    receives = {signal.message for _, signal in can_map.signals()}
    receives |= {command.echo for command in can_map.commands.values() if command.echo}
    receives |= {reply for ask in can_map.asks.values() for reply in ask.replies}
    identifiers = identifiers_of(
        address,
        codec.identifiers({send.message for send in sends}),
        codec.identifiers({can_map.base(name) for name in receives}),
        can_map.node_step,
    )
    link = CanLink(
        address,
        identifiers,
        fd=can_map.fd,
        min_gap_s=can_map.min_gap_s,
        timeout_s=timeout_s,
        silence_s=can_map.worst_reply_s,
        view_of=codec.view_of,
    )
    return CanCycler(link, can_map, codec)


def _modbus_link(address: TcpAddress | SerialAddress, device_map: DeviceMap, timeout_s: float) -> ModbusLink:
    unit_id = device_map.unit_id if address.unit is None else address.unit
    if isinstance(address, TcpAddress):
        return ModbusLink(
            str(address),
            tcp_client_factory(address.host, address.port),
            unit_id=unit_id,
            functions=device_map.functions,
            min_gap_s=device_map.min_gap_s,
            timeout_s=timeout_s,
        )
    return ModbusLink(
        str(address),
        serial_client_factory(address),
        unit_id=unit_id,
        functions=device_map.functions,
        min_gap_s=max(device_map.min_gap_s, SILENT_CHARACTERS * address.character_s),
        timeout_s=timeout_s,
        silence_s=device_map.worst_reply_s,
        rs485=address.rs485,
    )
