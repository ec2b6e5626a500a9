"""URL and map name -> cycler."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

from drivers.cycler import Cycler
from drivers.errors import CyclerConnectionError
from drivers.modbus import ModbusCycler
from drivers.modbus_link import ModbusLink, tcp_client_factory
from drivers.register_map import load_map


def open_cycler(url: str, map_name: str | Path, timeout_s: float) -> Cycler:
    """Build the driver for a device; nothing is connected or sent yet.

    Parameters
    ----------
    url : str
        ``modbus-tcp://HOST:PORT`` (port 502 where none is given).
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
    device_map = load_map(map_name)
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, 502 if parts.port is None else parts.port
    except ValueError as error:
        raise CyclerConnectionError(f"{url}: {error}") from None
    if parts.scheme != "modbus-tcp" or not host or parts.path.strip("/") or port == 0:
        raise CyclerConnectionError(f"{url}: the address of a cycler is modbus-tcp://HOST:PORT")
    link = ModbusLink(
        f"modbus-tcp://{host}:{port}",
        tcp_client_factory(host, port),
        unit_id=device_map.unit_id,
        functions=device_map.functions,
        min_gap_s=device_map.min_gap_s,
        timeout_s=timeout_s,
    )
    return ModbusCycler(link, device_map)
