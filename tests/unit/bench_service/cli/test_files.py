"""Files that commands read and write: one clear line where one is none."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.cli.errors import UsageError
from bench_service.cli.files import read_model, read_module, read_runs, read_structure, write_document
from bench_service.cli.output import Output
from models.data.seal import sealed
from models.network.structure import minimal_structure
from tests.unit.models.hand_network import everything


def test_a_model_is_read_as_it_was_written(tmp_path: Path) -> None:
    model = everything(1)
    write_document(tmp_path / "MODEL.json", model.to_json())
    again = read_model(tmp_path / "MODEL.json")
    np.testing.assert_array_equal(again.theta, model.theta)
    assert again.structure == model.structure


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "no such file"),
        ("{", "not valid JSON"),
        ('{"a": NaN}', "every number must be finite"),
        ("{}", "MODEL.json: "),
    ],
)
@pytest.mark.parametrize("read", [read_model, read_module])
def test_what_is_no_model_is_named_with_its_file(
    tmp_path: Path, read: Callable[[Path], Any], text: str | None, reason: str
) -> None:
    path = tmp_path / "MODEL.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UsageError, match=reason) as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_a_list_is_no_model(tmp_path: Path) -> None:
    (tmp_path / "MODEL.json").write_text("[]")
    with pytest.raises(UsageError, match="MODEL.json: "):
        read_model(tmp_path / "MODEL.json")


def test_a_structure_is_a_name_a_document_or_that_of_a_model(tmp_path: Path) -> None:
    structure = minimal_structure(1.0)
    assert read_structure("minimal") == "minimal"
    for name, document in (("s.json", structure.to_json()), ("m.json", {"structure": structure.to_json()})):
        (tmp_path / name).write_text(json.dumps(document))
        assert read_structure(str(tmp_path / name)) == structure


@pytest.mark.parametrize("document", [[], {}, 3, {"structure": None}, {"structure": {"inputs": []}}])
def test_a_file_that_holds_no_structure_is_refused(tmp_path: Path, document: object) -> None:
    path = tmp_path / "s.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UsageError, match="is not a structure"):
        read_structure(str(path))


def test_an_unknown_structure_lists_those_that_are_known() -> None:
    with pytest.raises(UsageError, match="'deep' is unknown; use one of .*minimal.* or a file FILE.json"):
        read_structure("deep")


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (("a/run.csv", "b/run.csv", "b/other.csv"), ["a/run", "b/run", "other"]),
        (("b/run.csv", "b/run.bdf.csv", "b/other.csv"), ["b/run.csv", "b/run.bdf.csv", "other"]),
        (("a/run.csv", "b/run.csv", "b/run.bdf.csv"), ["a/run", "b/run.csv", "b/run.bdf.csv"]),
        (("b/run.csv", "b/run.csv"), ["b/run", "b/run"]),
    ],
)
def test_runs_of_one_name_are_told_apart_by_their_directory_and_then_their_ending(
    tmp_path: Path, files: tuple[str, ...], names: list[str]
) -> None:
    paths = [tmp_path / file for file in files]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        rows = [f"{k},{0.0 if k < 3 else 1.0},{3.7 if k < 3 else 3.72}," for k in range(6)]
        path.write_text("\n".join(["time_s,current_A,voltage_V,temperature_degC", *rows]) + "\n")
    assert [run.name for run in read_runs(paths, "charge-positive", Output(True))] == names


def test_a_document_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    write_document(path, {"a": 1})
    with pytest.raises(ValueError):
        write_document(path, {"a": float("nan")})
    assert json.loads(path.read_text()) == sealed({"a": 1})
    assert [each.name for each in tmp_path.iterdir()] == ["out.json"]
