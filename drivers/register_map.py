"""Device maps: `drivers/maps/*.toml`, one file per device family, read and validated.

Pure data. Drivers, simulators and contract tests read the same file through `load_map`.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

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
    "BadMapError",
    "Block",
    "Coil",
    "DeviceMap",
    "Expression",
    "ExpressionError",
    "Frame",
    "Identity",
    "ReadPlan",
    "Register",
    "Step",
    "Verify",
    "list_maps",
    "load_map",
    "plan_reads",
]

MAPS = Path(__file__).parent / "maps"


def list_maps() -> tuple[str, ...]:
    """Names of the maps that come with the program, sorted."""
    return tuple(sorted(path.stem for path in MAPS.glob("*.toml")))


def load_map(name_or_path: str | Path) -> DeviceMap:
    """Read and validate a device map.

    Parameters
    ----------
    name_or_path : str or Path
        A name from `list_maps`, or the path of a TOML file (it ends in ``.toml`` or contains a slash).

    Returns
    -------
    DeviceMap

    Raises
    ------
    BadMapError
        Naming the file, the dotted key and the reason.
    """
    text = str(name_or_path)
    is_path = isinstance(name_or_path, Path) or "/" in text or text.endswith(".toml")
    path = Path(text) if is_path else MAPS / f"{text}.toml"
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        known = "" if is_path else f"; maps that come with the program: {', '.join(list_maps())}"
        raise BadMapError(path, "(file)", f"does not exist{known}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadMapError(path, "(file)", f"cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise BadMapError(path, "(file)", f"is not TOML: {error}") from error
    device_map = read_device_map(path, content)
    if not is_path and device_map.name != text:
        raise BadMapError(path, "name", f"is '{device_map.name}'; must be the file's name, '{text}'")
    check_device_map(device_map)
    return device_map
