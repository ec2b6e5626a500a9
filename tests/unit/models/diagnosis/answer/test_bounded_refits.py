"""Effects given back to a bounded network that they were left out of."""

from dataclasses import replace

import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.diagnosis.answer.refits import Refits, try_refits
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import make_record
from models.diagnosis.reference.reference import fit_reference
from models.diagnosis.structure.structure import analyse_structure
from models.effects import effect
from models.identification.bounded.variants import Variant, variant_of
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from simulators.cell import CellParameters
from tests.unit.models.diagnosis.cells import SOC, bare, measured

CELL = bare()
LOOP = replace(CELL, hysteresis_amplitude_V=0.03)


def fitted(cell: CellParameters, *without: str) -> LocalModelNetwork:
    run = measured(cell, 1)
    found = fit_network(
        [run], capacity_Ah=cell.capacity_Ah, structure="bounded", without=without, initial_soc=[SOC], dt_s=1.0
    )
    return found.network


def refits(network: LocalModelNetwork, cell: CellParameters) -> Refits | None:
    record, train = make_record(network, [measured(cell, 2)], [SOC]), [to_grid(measured(cell, 1), 1.0)]
    reference = fit_reference([*train, *record.runs], [SOC, SOC], cell.capacity_Ah, Shape(0.0))
    lacking = [effect(name) for name in ("hysteresis", "charge_transfer")]
    analysis = analyse_structure(network, reference, train, [SOC], record.runs, [SOC], lacking)
    return try_refits(network, train, [SOC], record, analysis)


def test_what_was_left_out_is_named_where_the_cell_has_it() -> None:
    found = refits(fitted(LOOP, "hysteresis", "charge_transfer"), LOOP)
    assert found is not None
    assert found.named[0].effect.name == "hysteresis"
    assert found.named[0].held_out_mV < 0.8 * found.held_out_mV


@pytest.mark.proof
def test_what_the_cell_does_not_have_is_not_missed() -> None:
    assert refits(fitted(CELL, "hysteresis"), CELL) is None


@pytest.mark.parametrize("variant", [Variant(), Variant((0.05, 400.0, 3500.0), squared=True, fine_slope=True)])
def test_a_form_is_read_from_the_choices_of_a_network(variant: Variant) -> None:
    assert variant_of(variant.to_json()) == variant


def test_an_axis_of_another_kind_is_refused() -> None:
    with pytest.raises(ModelError, match="surface_soc"):
        variant_of(Variant().to_json() | {"axis": "surface_soc:1/2"})
