"""Device maps: `drivers/maps/*.toml`, one file per device family, read and validated.

Pure data. Drivers, simulators and contract tests read the same file through `load_map`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

from drivers.can_map import Ask, CanMap, Command, Flag, Send
from drivers.can_map_reader import read_can_map
from drivers.device_map import (
    Block,
    Coil,
    DeviceMap,
    Frame,
    Identity,
    Register,
    Step,
    Verify,
)
from drivers.errors import BadMapError
from drivers.expression import Expression, ExpressionError
from drivers.map_checks import check_device_map
from drivers.map_reader import read_device_map
from drivers.read_plan import ReadPlan, plan_reads

__all__ = [
    "Ask",
    "BadMapError",
    "Block",
    "CanMap",
    "Coil",
    "Command",
    "DeviceMap",
    "Expression",
    "ExpressionError",
    "Flag",
    "Frame",
    "Identity",
    "ReadPlan",
    "Send",
    "Register",
    "Step",
    "Verify",
    "list_maps",
    "load_can_map",
    "load_map",
    "map_content",
    "map_kind",
    "map_transport",
    "plan_reads",
]

MAPS = Path(__file__).parent / "maps"


def list_maps(transport: str | None = None, kind: str = "cycler") -> tuple[str, ...]:
    """Names of the maps of one kind ("cycler" or "chamber") that come with the program, sorted.

    Of one transport ("modbus" or "can"), or of all.
    """
    names = sorted(path.stem for path in MAPS.glob("*.toml") if map_kind(path) == kind)
    return tuple(name for name in names if transport in (None, map_transport(name)))


def map_kind(name_or_path: str | Path) -> str:
    """Return what a map says that it is the map of, "cycler" or "chamber"; anything else is not checked here."""
    return str(_content(name_or_path)[1].get("kind", "cycler"))


def map_transport(name_or_path: str | Path) -> str:
    """Return what a map says of its transport, "modbus" or "can"; anything else is not checked here."""
    return str(_content(name_or_path)[1].get("transport"))


def load_map(name_or_path: str | Path, kind: str | None = "cycler") -> DeviceMap:
    """Read and validate a Modbus device map.

    Parameters
    ----------
    name_or_path : str or Path
        A name from `list_maps`, or the path of a TOML file (it ends in ``.toml`` or contains a slash).
    kind : str or None
        What it must be the map of; None: a cycler or a chamber.

    Returns
    -------
    DeviceMap

    Raises
    ------
    BadMapError
        Naming the file, the dotted key and the reason.
    """
    path, content = _content(name_or_path)
    device_map = read_device_map(path, content)
    _check_name(name_or_path, path, device_map.name)
    if kind not in (None, device_map.kind):
        raise BadMapError(path, "kind", f"is '{device_map.kind}'; the map of a {kind} is needed here")
    check_device_map(device_map)
    return device_map


def load_can_map(name_or_path: str | Path) -> CanMap:
    """Read a CAN device map and check it against its DBC file; otherwise as `load_map`."""
    # Lazy: python-can and cantools take 300 ms.
    from drivers.can_map_checks import check_can_map

    path, content = _content(name_or_path)
    can_map = read_can_map(path, content)
    _check_name(name_or_path, path, can_map.name)
    check_can_map(can_map)
    return can_map


def map_content(name_or_path: str | Path) -> dict[str, object]:
    """Return all that a map says, with the text of its DBC file, as plain types: another map has another content.

    Raises
    ------
    BadMapError
        It cannot be read.
    """
    path, content = _content(name_or_path)
    dbc = content.get("dbc")
    try:
        text = path.with_name(str(dbc)).read_text(encoding="utf-8") if dbc is not None else None
    except (OSError, UnicodeDecodeError) as error:
        raise BadMapError(path, "dbc", f"cannot be read: {error}") from error
    return {**content, "dbc_text": text}


def _is_path(name_or_path: str | Path) -> bool:
    text = str(name_or_path)
    return isinstance(name_or_path, Path) or "/" in text or text.endswith(".toml")


def _content(name_or_path: str | Path) -> tuple[Path, Mapping[str, object]]:
    """Find and parse a map's file."""
    text, is_path = str(name_or_path), _is_path(name_or_path)
    path = Path(text) if is_path else MAPS / f"{text}.toml"
    try:
        return path, tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        known = "" if is_path else f"; maps that come with the program: {', '.join(list_maps())}"
        raise BadMapError(path, "(file)", f"does not exist{known}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadMapError(path, "(file)", f"cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise BadMapError(path, "(file)", f"is not TOML: {error}") from error


def _check_name(name_or_path: str | Path, path: Path, name: str) -> None:
    if not _is_path(name_or_path) and name != str(name_or_path):
        raise BadMapError(path, "name", f"is '{name}'; must be the file's name, '{name_or_path}'")
