"""Modules from their runs: R and V_0 beside the cells, the choice of the model, the weak group."""

import json
from dataclasses import replace

import numpy as np
import pytest

from models.comparison.figures import compare
from models.comparison.module_models import compare_module
from models.data.errors import ModelError, StructureError
from models.data.seal import sealed
from models.module.log import ModuleLog
from models.module.network import ModuleNetwork, model_from_json
from models.network.local_model_network import LocalModelNetwork
from models.observer.module.tuning import module_observer, with_tuned_module
from models.observer.observation import observe
from models.pipeline.fit import fit_network
from models.pipeline.module.fit import ModuleFit, ModuleFitRequest, fit_module
from tests.unit.models import synthetic
from tests.unit.models.module import synthetic_module as truth

TRAIN = [truth.log(2500, seed) for seed in (1, 2)]
JUDGED = truth.log(1500, 3)


@pytest.fixture(scope="module")
def fitted() -> ModuleFit:
    return fit_module(
        ModuleFitRequest(
            train=TRAIN, validate=[JUDGED], capacity_Ah=truth.CAPACITY_AH, parallel=truth.PARALLEL, structure="minimal"
        )
    )


def test_what_lies_between_the_cells_is_found(fitted: ModuleFit) -> None:
    kinds = {each["kind"]: each for each in fitted.to_json()["module"]["models"]}
    assert list(kinds) == ["S1", "S2", "S3", "S4"]
    assert fitted.model.module.kind == "S3"
    assert fitted.model.module.resistance_Ohm[0] == pytest.approx(truth.RESISTANCE_OHM, rel=0.05)
    assert fitted.model.module.offset_V[0] == pytest.approx(truth.OFFSET_V, abs=0.005)
    errors = [kinds[kind]["held_out_rmse_mV"] for kind in ("S1", "S2", "S3")]
    assert errors[0] > errors[1] > 3.0 * errors[2]
    assert fitted.validation is not None and fitted.validation["rmse_mV"] < 12.0


def test_the_weak_group_is_named_with_what_it_lacks(fitted: ModuleFit) -> None:
    record = fitted.model.record
    assert record.weak_group is not None and record.weak_group["group"] == 2
    assert "group 2 is empty after" in record.weak_group["text"]
    group, others = record.groups[1], (record.groups[0], record.groups[2])
    share = group["capacity_Ah"]["value"] / np.mean([each["capacity_Ah"]["value"] for each in others])
    assert share == pytest.approx(truth.CAPACITY_SHARE, abs=0.02)
    apart = group["soc_offset"]["value"] - np.mean([each["soc_offset"]["value"] for each in others])
    # Lower at the start, by 0.02 at 0.6; what the others still take in moves a group that holds less by more.
    assert apart == pytest.approx(truth.SOC_OFFSET + 0.4 / truth.CAPACITY_SHARE - 0.4, abs=0.01)
    more_Ohm = group["resistance_Ohm"]["value"] - np.mean([each["resistance_Ohm"]["value"] for each in others])
    assert more_Ohm == pytest.approx(truth.MORE_OHM, rel=0.1)


def test_groups_that_are_alike_have_no_weak_one(fitted: ModuleFit) -> None:
    found = compare_module(fitted.model, [truth.log(1500, 4, alike=True)], [0.6])
    assert len(found["groups"]) == truth.SERIES and found["weak_group"] is None


def test_a_comparison_is_in_the_modules_volts(fitted: ModuleFit) -> None:
    assert fitted.validation is not None
    found = compare(fitted.model, [JUDGED.run], [0.6])
    # The same but for the first values, which a network with past outputs takes from what was measured.
    assert found["overall"]["rmse_mV"] == pytest.approx(fitted.validation["rmse_mV"], rel=0.2)
    assert found["outside_training"] < 0.2 and found["band"] is not None
    beside = compare_module(fitted.model, [JUDGED], [0.6])
    errors = {each["kind"]: each["overall"]["rmse_mV"] for each in beside["models"]}
    assert errors["S3"] == pytest.approx(found["overall"]["rmse_mV"], rel=1e-6) and errors["S1"] > 3.0 * errors["S3"]


def test_the_document_says_all_and_is_read_again(fitted: ModuleFit) -> None:
    document = json.loads(json.dumps(sealed(fitted.model.to_json()), allow_nan=False))
    again = model_from_json(document)
    assert isinstance(again, ModuleNetwork)
    assert again.to_json() == fitted.model.to_json()
    assert [each.kind for each in again.candidates] == ["S1", "S2", "S3", "S4"]
    with pytest.raises(StructureError, match="model of a module; here that of a cell"):
        LocalModelNetwork.from_json(document)
    document["module"]["cells_in_series"] = 7
    with pytest.raises(StructureError, match="changed after it was written"):
        model_from_json(document)


def test_the_observer_finds_the_mean_cells_state_of_charge(fitted: ModuleFit) -> None:
    tuned = with_tuned_module(fitted.model, [log.run for log in TRAIN], fitted.initial_soc)
    assert tuned.network.record.observer is not None
    found = observe(module_observer(tuned), JUDGED.run, 0.4, None)
    assert found.figures["soc_rmse"] is not None and found.figures["soc_rmse"] < 0.02


def test_a_model_of_one_cell_can_be_given(fitted: ModuleFit) -> None:
    cell = fit_network(
        [synthetic.run(2500, 7, noise_V=1e-3)], capacity_Ah=synthetic.CAPACITY_AH, structure="minimal"
    ).network
    logs = [replace(log, groups_V=None) for log in TRAIN]
    asked = ModuleFitRequest(
        train=logs, capacity_Ah=truth.CAPACITY_AH, in_series=truth.SERIES, parallel=truth.PARALLEL, cell=cell
    )
    found = fit_module(asked).model
    assert found.module.kind == "S3" and not found.record.own_cell and found.record.groups == ()
    # With the weak group's share in it.
    more_Ohm = truth.MORE_OHM
    assert found.module.resistance_Ohm[0] == pytest.approx(truth.RESISTANCE_OHM + more_Ohm, rel=0.1)


def test_a_layout_that_nobody_knows_is_asked_for() -> None:
    blind = [ModuleLog(log.run) for log in TRAIN]
    with pytest.raises(ModelError, match="state the layout, such as 6x2"):
        fit_module(ModuleFitRequest(train=blind, capacity_Ah=truth.CAPACITY_AH))
    with pytest.raises(ModelError, match="has voltages of 3 cells, the layout says 4 in series"):
        fit_module(ModuleFitRequest(train=TRAIN, capacity_Ah=truth.CAPACITY_AH, in_series=4))


def test_a_run_that_judges_a_module_starts_where_its_rest_says() -> None:
    rest = 900
    run = JUDGED.run
    assert run.soc_ref is not None and JUDGED.groups_V is not None
    before = {name: np.full(rest, getattr(run, name)[0]) for name in ("voltage_V", "temperature_degC")}
    longer = {name: np.concatenate([first, getattr(run, name)]) for name, first in before.items()}
    current_A = np.concatenate([np.zeros(rest), run.current_A])
    rested = replace(run, time_s=np.arange(len(current_A)) * 1.0, current_A=current_A, soc_ref=None, **longer)
    groups_V = np.concatenate([np.repeat(JUDGED.groups_V[:1], rest, axis=0), JUDGED.groups_V])
    asked = ModuleFitRequest(
        train=TRAIN,
        validate=[ModuleLog(rested, groups_V)],
        capacity_Ah=truth.CAPACITY_AH,
        parallel=truth.PARALLEL,
        structure="minimal",
    )
    start = fit_module(asked).validation_runs[0]["initial_soc"]
    # The mean of the groups, of which the second stands lower.
    assert start["value"] == pytest.approx(run.soc_ref[0] + truth.SOC_OFFSET / truth.SERIES, abs=0.01)
    assert 0.0 < start["std"] < 0.03
