"""Addresses of cyclers as URLs: pure text, so that the configuration can check one without loading a transport.

``modbus-tcp://HOST:PORT?unit=1``, ``modbus-rtu:///dev/ttyUSB0?baud=115200&parity=N&stopbits=1&unit=1``,
``can://INTERFACE/CHANNEL?bitrate=500000&node=1``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NoReturn
from urllib.parse import parse_qsl, urlsplit

from drivers.errors import CyclerConnectionError

FORMS = "modbus-tcp://HOST:PORT, modbus-rtu:///DEVICE?baud=BAUD or can://INTERFACE/CHANNEL?bitrate=BITRATE"
Scheme = Literal["modbus-tcp", "modbus-rtu", "can"]
MODBUS_PORT = 502
# Interfaces of python-can that speak to hardware or to a bus on this machine.
CAN_INTERFACES = ("socketcan", "pcan", "vector", "kvaser", "slcan", "virtual", "udp_multicast")


@dataclass(frozen=True, slots=True)
class TcpAddress:
    """A Modbus TCP server; `unit` replaces the map's unit identifier."""

    host: str
    port: int
    unit: int | None = None

    def __str__(self) -> str:
        """The URL without its options."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"modbus-tcp://{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """A serial line with Modbus RTU.

    `rs485` switches the driver's direction control on (TIOCSRS485); `echo` is for two-wire adapters that also hear
    what they send.
    """

    device: str
    baud: int = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = 1
    unit: int | None = None
    rs485: bool = False
    echo: bool = False

    def __str__(self) -> str:
        """The URL with the baud rate alone."""
        return f"modbus-rtu://{self.device}?baud={self.baud}"

    @property
    def character_s(self) -> float:
        """Time of one character on the line: start bit, eight data bits, parity, stop bits."""
        return (9 + (self.parity != "N") + self.stopbits) / self.baud


@dataclass(frozen=True, slots=True)
class CanAddress:
    """A CAN bus and the node on it.

    `port` is the UDP port of ``udp_multicast``; `log` is a folder that gets the traffic of each run.
    """

    interface: str
    channel: str
    bitrate: int = 500_000
    data_bitrate: int | None = None
    port: int | None = None
    node: int = 0
    log: str | None = None

    def __str__(self) -> str:
        """The URL without its options, but with the node."""
        port = f":{self.port}" if self.port else ""
        return f"can://{self.interface}/{self.channel}{port}?node={self.node}"


Address = TcpAddress | SerialAddress | CanAddress


def parse_address(url: str) -> Address:
    """Understand the URL of a cycler.

    Raises
    ------
    CyclerConnectionError
        If it is none of the forms, or has an option or a value that its form does not know.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
        pairs = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    except ValueError as error:
        raise CyclerConnectionError(f"{url}: {error}") from None
    options = _Options(url, dict(pairs))
    if parts.fragment or "@" in parts.netloc:
        raise CyclerConnectionError(f"{url}: the address of a cycler is {FORMS}")
    if parts.scheme == "modbus-tcp" and host and not parts.path.strip("/") and port != 0:
        address: Address = TcpAddress(host, MODBUS_PORT if port is None else port, options.unit())
    elif parts.scheme == "modbus-rtu" and not parts.netloc and len(parts.path) > 1:
        address = _serial(parts.path, options)
    elif parts.scheme == "can" and parts.path.strip("/") and port is None:
        address = _can(parts.netloc, parts.path.strip("/"), options)
    else:
        raise CyclerConnectionError(f"{url}: the address of a cycler is {FORMS}")
    options.finish()
    return address


def _serial(device: str, options: _Options) -> SerialAddress:
    parity = options.choose("parity", ("N", "E", "O"), "N")
    return SerialAddress(
        device=device,
        baud=options.whole("baud", 300, 4_000_000, 19200),
        parity="E" if parity == "E" else "O" if parity == "O" else "N",
        stopbits=options.whole("stopbits", 1, 2, 1),
        unit=options.unit(),
        rs485=bool(options.whole("rs485", 0, 1, 0)),
        echo=bool(options.whole("echo", 0, 1, 0)),
    )


def _can(interface: str, channel: str, options: _Options) -> CanAddress:
    if interface not in CAN_INTERFACES:
        options.fail(f"interface {interface!r} is not one of {', '.join(CAN_INTERFACES)}")
    port: int | None = None
    if interface == "udp_multicast":
        channel, _, text = channel.rpartition(":")
        if not channel or not text.isdecimal() or not 0 < int(text) < 65536:
            options.fail("udp_multicast needs a channel GROUP:PORT, such as 239.74.163.2:43113")
        port = int(text)
    return CanAddress(
        interface=interface,
        channel=channel,
        bitrate=options.whole("bitrate", 10_000, 1_000_000, 500_000),
        data_bitrate=options.whole("dbitrate", 10_000, 8_000_000, 0) or None,
        port=port,
        node=options.whole("node", 0, 0x1FFFFFFF, 0),
        log=options.text("log"),
    )


class _Options:
    """What stands behind the question mark, taken key by key."""

    def __init__(self, url: str, left: Mapping[str, str]) -> None:
        self._url, self._left = url, dict(left)

    def text(self, key: str) -> str | None:
        """Take a text, None where there is none."""
        return self._left.pop(key, None) or None

    def choose(self, key: str, allowed: tuple[str, ...], default: str) -> str:
        """Take one of a few words."""
        value = self._left.pop(key, default)
        if value not in allowed:
            self.fail(f"{key} is {value!r}; it must be one of {', '.join(allowed)}")
        return value

    def whole(self, key: str, low: int, high: int, default: int) -> int:
        """Take a whole number within limits."""
        text = self._left.pop(key, None)
        if text is None:
            return default
        if not (text.isascii() and text.isdecimal() and low <= int(text) <= high):
            self.fail(f"{key} is {text!r}; it must be a whole number within {low} and {high}")
        return int(text)

    def unit(self) -> int | None:
        """Take the Modbus unit identifier."""
        return self.whole("unit", 0, 255, 0) if "unit" in self._left else None

    def finish(self) -> None:
        """Refuse what nobody asked for."""
        if self._left:
            self.fail(f"unknown option {min(self._left)!r}")

    def fail(self, reason: str) -> NoReturn:
        """Say what is wrong with the address."""
        raise CyclerConnectionError(f"{self._url}: {reason}")
