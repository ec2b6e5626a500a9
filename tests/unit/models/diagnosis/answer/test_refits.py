import time
from dataclasses import replace

import pytest

from models.data.resampling import GridRun, to_grid
from models.diagnosis.answer.refits import try_refits
from models.diagnosis.answer.structure_answer import structure_answer
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.reference.reference import Reference, fit_reference
from models.diagnosis.structure.extension import ExtensionSearch
from models.diagnosis.structure.structure import StructureAnalysis, analyse_structure
from models.effects import effect, effects
from models.identification.progress import silent
from models.identification.search.search import Search
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal
from models.network.structure import InputChannel, PartitionAxis, Structure, minimal_structure
from models.pipeline.fit import fit_network
from simulators.cell import Branch, CellParameters
from tests.unit.models.diagnosis.cells import SOC, bare, measured

CELL = bare()
SLOW = replace(CELL, slow=Branch(0.02, 900.0))
BARE = Structure(
    0,
    (InputChannel("soc", delay=1), InputChannel("current"), InputChannel("low_pass:1.5"), InputChannel("low_pass:25")),
    (PartitionAxis("soc", k_sigma=0.7),),
    1.0,
    name="bare",
)


def fitted(cell: CellParameters, structure: Structure) -> tuple[LocalModelNetwork, GridRun]:
    run = measured(cell, 1)
    fit = fit_network([run], capacity_Ah=cell.capacity_Ah, structure=structure, initial_soc=[SOC], dt_s=1.0)
    return fit.network, to_grid(run, 1.0)


def search(network: LocalModelNetwork, run: GridRun) -> ExtensionSearch:
    return ExtensionSearch(Search([run], [SOC], network.cell, silent))


def kinds(structure: Structure) -> list[str]:
    return [parse_signal(channel.signal).kind for channel in structure.inputs]


@pytest.mark.proof
def test_a_simple_cell_gets_an_effect_the_plain_way() -> None:
    network, run = fitted(SLOW, BARE)
    trial = search(network, run)
    own = trial.own(network)
    found = trial.extended(own, effect("relaxation"), {"time_constant_s": 900.0})
    assert found is not None
    assert found.error_V < 0.5 * own.error_V
    assert [each.signal for each in found.choice.given.inputs][-1] == "low_pass:900"
    assert len(found.choice.given.inputs) == len(BARE.inputs) + 1


@pytest.mark.proof
def test_several_time_constants_take_the_place_of_a_shared_pole() -> None:
    network, run = fitted(SLOW, minimal_structure(1.0))
    trial = search(network, run)
    own = trial.own(network)
    found = trial.extended(own, effect("relaxation"), {"time_constant_s": 30.0})
    assert found is not None
    assert found.choice.given.output_order == 0 and kinds(found.choice.given).count("low_pass") >= 2
    assert found.error_V < 0.7 * own.error_V
    # What temperature does is another effect's.
    assert not any(parse_signal(name).get("activation_K") for name in found.choice.given.signals)


def test_what_a_structure_has_is_not_put_in_again() -> None:
    network, run = fitted(CELL, replace(BARE, inputs=(*BARE.inputs, InputChannel("charge_transfer:1"))))
    trial = search(network, run)
    own = trial.own(network)
    assert trial.extended(own, effect("charge_transfer"), {}) is None
    assert trial.extended(own, effect("capacity"), {}) is None


def analysed(network: LocalModelNetwork, cell: CellParameters) -> tuple[StructureAnalysis, Reference, Record]:
    record = make_record(network, [measured(cell, 2)], [SOC])
    train = [to_grid(measured(cell, 1), 1.0)]
    reference = fit_reference([*train, *record.runs], [SOC, SOC], cell.capacity_Ah, Shape(0.0))
    lacking = [each for each in effects().values() if each.extend is not None]
    return analyse_structure(network, reference, train, [SOC], record.runs, [SOC], lacking), reference, record


def test_refits_name_what_lowers_the_error_of_unseen_runs() -> None:
    network, run = fitted(SLOW, BARE)
    analysis, reference, record = analysed(network, SLOW)
    # Sensitivities explain as much here, and are listened to; had they not, refits would be.
    assert try_refits(network, [run], [SOC], record, analysis) is None
    unnamed = replace(analysis, ranking=replace(analysis.ranking, held_out_share=0.1), named=())
    found = try_refits(network, [run], [SOC], record, unnamed)
    assert found is not None
    first = found.named[0]
    assert first.effect.name == "relaxation"
    assert first.held_out_mV < 0.5 * found.held_out_mV and first.error_mV < 0.7 * record.rms_mV

    answer = structure_answer(unnamed, reference, record, time.perf_counter(), found)
    assert answer.verdict == ("missing" if len(found.named) == 1 else "ambiguous")
    assert answer.unexplained_mV == answer.findings[0].error_after_mV == pytest.approx(first.error_mV)
    assert answer.findings[0].parameters["time_constant_s"].value == pytest.approx(900.0, rel=0.3)
    assert any("refits" in remark for remark in answer.remarks)


@pytest.mark.proof
def test_refits_name_nothing_where_nothing_is_missing() -> None:
    network, run = fitted(CELL, BARE)
    analysis, _, record = analysed(network, CELL)
    assert try_refits(network, [run], [SOC], record, analysis) is None
