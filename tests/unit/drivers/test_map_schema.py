"""The published schema is the readers' own, and every map that comes with the program keeps to it."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from drivers.errors import BadMapError
from drivers.map_frames import check_frames
from drivers.map_schema import map_schema
from drivers.register_map import MAPS, list_maps, load_can_map, load_map, map_transport

PUBLISHED = Path(__file__).parents[3] / "docs" / "device-map.schema.json"
KINDS = {"string": str, "boolean": bool, "object": dict, "array": list}


def complaints(value, schema, path=""):
    """The few words of JSON Schema that the published one uses."""
    if "anyOf" in schema or "oneOf" in schema:
        found = [complaints(value, each, path) for each in schema.get("anyOf", schema.get("oneOf"))]
        return [] if any(not each for each in found) else min(found, key=len)
    if "const" in schema:
        return [] if value == schema["const"] else [f"{path}: is {value!r}"]
    if "enum" in schema:
        return [] if value in schema["enum"] else [f"{path}: is {value!r}"]
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if not any(_is(value, kind) for kind in kinds):
        return [f"{path}: is {value!r}, not {kinds}"]
    found = []
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        found.append(f"{path}: {value!r} does not match")
    if _is(value, "number") and not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        found.append(f"{path}: {value} is out of range")
    if isinstance(value, list):
        found += [line for i, each in enumerate(value) for line in complaints(each, schema["items"], f"{path}[{i}]")]
    if isinstance(value, dict):
        known, other = schema.get("properties", {}), schema["additionalProperties"]
        found += [f"{path}.{key}: is missing" for key in schema.get("required", ()) if key not in value]
        for key, each in value.items():
            if key not in known and other is False:
                found.append(f"{path}.{key}: is not known")
            else:
                found += complaints(each, known.get(key, other), f"{path}.{key}")
    return found


def _is(value, kind):
    if kind in ("number", "integer"):
        return isinstance(value, int if kind == "integer" else (int, float)) and not isinstance(value, bool)
    return isinstance(value, KINDS[kind])


def test_the_published_schema_is_up_to_date():
    text = "bench-service maps schema --json | python -m json.tool > docs/device-map.schema.json"
    assert json.loads(PUBLISHED.read_text()) == map_schema(), f"write it anew: {text}"


@pytest.mark.parametrize("name", list_maps())
def test_every_map_keeps_to_it(name):
    content = tomllib.loads((MAPS / f"{name}.toml").read_text())
    kind = next(s for s in map_schema()["oneOf"] if s["properties"]["transport"]["const"] == map_transport(name))
    assert complaints(content, kind) == []


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('access = "rw"', 'access = "x"', "is 'x'"),
        ("schema = 1", "schema = 2", "is 2"),
        ("address = 100", "addres = 100", "is not known"),
        ('unit = "V"', "unit = 5", "not ['string']"),
        ("watchdog_expired = 2", "watchdog_expired = 99", "out of range"),
    ],
)
def test_what_it_refuses(old, new, reason):
    content = tomllib.loads((MAPS / "generic.toml").read_text().replace(old, new, 1))
    assert any(reason in line for line in complaints(content, map_schema()["oneOf"][0]))


@pytest.mark.parametrize(
    ("name", "old", "new", "reason"),
    [
        ("generic", "temperature = 25.31", "temperature = 25.32", r"'temperature' reads 25.31, the values say 25.32"),
        ("generic", 'missing = ["ambient_temperature"]', "missing = []", "is in the frame, but not among its values"),
        ("generic", 'missing = ["ambient_temperature"]', 'missing = ["alarms"]', "not among its values|not 'missing'"),
        ("generic", "heartbeat = 513", "heartbeat = 514", "the values make the request"),
        ("generic", 'reply = "10 0064 0005"', 'reply = "10 0064 0004"', "the reply should be"),
        ("generic", 'request = "03 00C8 000C"', 'request = "03 00C8 000B"', "must begin with"),
        ("generic", 'request = "03 00C8 000C"', 'request = "02 00C8 000C"', "function 2 is not among"),
        ("generic_can", "Voltage = 3.7,", "Voltage = 3.8,", r"the bytes say \{'Voltage': 3.7\}"),
        ("generic_can", "values = { Token = 9, Voltage = 3.7, Current", "values = { Voltage = 3.7, Current", "make 00"),
    ],
)
def test_frames_that_do_not_mean_what_they_say(tmp_path, name, old, new, reason):
    text = (MAPS / f"{name}.toml").read_text()
    assert old in text
    path = tmp_path / "changed.toml"
    path.write_text(text.replace(old, new, 1).replace('"generic_can.dbc"', f'"{MAPS / "generic_can.dbc"}"'))
    load = load_can_map if name == "generic_can" else load_map
    with pytest.raises(BadMapError, match=reason):
        check_frames(load(path))
