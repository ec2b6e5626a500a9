"""Damaged documents of baselines are refused in one clear line."""

import pytest

from models.baselines.documents import array, check_kind, read_cell, read_step_s, reading
from models.data.errors import StructureError


@pytest.mark.parametrize("document", [None, [], {}, {"kind": "other", "schema_version": 1}])
def test_another_kind_is_refused(document: object) -> None:
    with pytest.raises(StructureError, match="'kind' must be 'circuit'"):
        check_kind(document, "circuit", 1)


def test_another_schema_version_is_refused() -> None:
    check_kind({"kind": "circuit", "schema_version": 1}, "circuit", 1)
    with pytest.raises(StructureError, match="schema version 2; 1 is supported"):
        check_kind({"kind": "circuit", "schema_version": 2}, "circuit", 1)


@pytest.mark.parametrize(
    "error", [KeyError("a"), TypeError("b"), ValueError("c"), IndexError("d"), AttributeError("e")]
)
def test_what_goes_wrong_in_reading_is_a_damaged_document(error: Exception) -> None:
    with pytest.raises(StructureError, match="circuit document is damaged"), reading("circuit"):
        raise error


def test_a_fault_of_the_program_is_not_taken_for_a_damaged_document() -> None:
    with pytest.raises(ZeroDivisionError), reading("circuit"):
        raise ZeroDivisionError


def test_figures_must_be_finite_and_positive() -> None:
    assert array([[1, 2.5]]).tolist() == [[1.0, 2.5]]
    assert read_step_s({"dt_s": 0.5}) == 0.5
    cell = read_cell({"cell": {"capacity_Ah": 2, "efficiency": 0.99}})
    assert (cell.capacity_Ah, cell.efficiency) == (2.0, 0.99)
    for values in ([float("nan")], [1.0, float("inf")]):
        with pytest.raises(StructureError, match="not finite"):
            array(values)
    for dt_s in (0.0, -1.0, float("nan")):
        with pytest.raises(StructureError, match="grid step"):
            read_step_s({"dt_s": dt_s})
    for capacity_Ah, efficiency in ((0.0, 1.0), (-2.0, 1.0), (float("inf"), 1.0), (2.0, float("nan"))):
        with pytest.raises(StructureError, match="capacity"):
            read_cell({"cell": {"capacity_Ah": capacity_Ah, "efficiency": efficiency}})
