"""Mappings: corrected, remembered, checked."""

import json
from pathlib import Path
from typing import Any

import pytest

from bench_service.exchange import RunFileError
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices, look
from bench_service.exchange.foreign.mapping import Column, Mapping, load_mapping, mapping_names, save_mapping
from benchmarks.import_variants import joined as text_of
from benchmarks.import_variants import record, renamed, table_of

RECORD = record(220)


def write(path: Path) -> Path:
    path.write_text(text_of(renamed(table_of(RECORD), {0: "alpha", 1: "beta", 2: "gamma"})))
    return path


CHOSEN = {"time_s": Column("alpha"), "current_A": Column("beta", "mA"), "voltage_V": Column("gamma")}


def test_a_corrected_mapping_is_remembered_and_used(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv")
    with pytest.raises(QuestionError, match="--column time_s=NAME --column voltage_V=NAME --column current_A=NAME"):
        look(path)
    seen = look(path, Choices(columns=CHOSEN))
    assert seen.mapping.columns["time_s"].why == "chosen; no unit is named: taken as s"
    save_mapping(tmp_path / "kept", Mapping(**{**_fields(seen.mapping), "name": "ours"}))
    kept = load_mapping(tmp_path / "kept", "ours")
    assert kept.columns["current_A"].unit == "mA"
    run = import_file(path, Choices(mapping=kept))
    assert run.columns()["current_A"][30] == RECORD["current_A"][30] / 1000.0
    run.close()
    assert mapping_names(tmp_path / "kept") == ["ours"]


def _fields(mapping: Mapping) -> dict[str, Any]:
    return {name: getattr(mapping, name) for name in Mapping.__dataclass_fields__}


def test_a_mapping_of_another_file_says_what_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text_of(table_of(RECORD)))
    kept = Mapping("ours", "", {role: Column(each.name, "s") for role, each in CHOSEN.items()})
    with pytest.raises(QuestionError, match="there is no column 'alpha' for time_s"):
        import_file(path, Choices(mapping=kept))


def test_a_role_can_be_taken_away(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text_of(table_of(RECORD)))
    run = import_file(path, Choices(columns={"temperature_degC": Column("")}))
    assert "temperature_degC" not in run.mapping.columns
    assert "no temperature is known" in run.remarks
    run.close()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"schema": 2}, "schema is 2"),
        ({"name": "../x"}, "mapping name '../x'"),
        ({"surprise": 1}, "unknown key 'surprise'"),
        ({"columns": {"power_W": {"column": "P"}}}, "'power_W' is nothing a column is read as"),
        ({"columns": {"current_A": {"column": "I", "unit": "mV"}}}, "unit 'mV' of current_A"),
        ({"columns": {"current_A": "I"}}, "columns.current_A must be an object"),
        ({"current_sign": "up"}, "current_sign is 'up'"),
        ({"time_zone": "Mars/Olympus"}, "time zone 'Mars/Olympus' is not known"),
        ({"time_zone": 5}, "time zone 5 is not known"),
        ({"states": {"on": []}}, "states must be an object"),
        ({"states": {"charge": 5}}, "states.charge must be an array"),
        ({"states": {"charge": "CC"}}, "states.charge must be an array"),
    ],
)
def test_a_damaged_mapping_is_refused(tmp_path: Path, change: dict[str, Any], says: str) -> None:
    document = Mapping("ours", "", {"time_s": Column("t", "s")}).to_json() | change
    (tmp_path / "ours.json").write_text(json.dumps(document))
    with pytest.raises(RunFileError) as caught:
        load_mapping(tmp_path, "ours")
    assert says in str(caught.value)


def test_an_unknown_mapping_names_those_there_are(tmp_path: Path) -> None:
    save_mapping(tmp_path, Mapping("ours", ""))
    with pytest.raises(RunFileError, match="'theirs' is not known; there is ours"):
        load_mapping(tmp_path, "theirs")
