import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.partition import initial_partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from models.readouts.ocv import OcvTable, ocv_table
from models.readouts.resistance import resistance_table
from models.readouts.tables import read_out, summary, tables_of
from tests.unit.models import hand_network, synthetic


@pytest.fixture(scope="module")
def fitted() -> LocalModelNetwork:
    """A network of the truth's own structure, but for the open-circuit curve, which it can only approach."""
    return _fitted(2)


def _fitted(seed: int) -> LocalModelNetwork:
    runs = [synthetic.run(4000, seed=s, noise_V=1e-3, drift_A=d) for s, d in ((seed, -0.2), (seed + 1, 0.2))]
    inputs = (InputChannel("soc", delay=1), InputChannel("current"), InputChannel(f"low_pass:{synthetic.TAU_S:g}"))
    structure = Structure(0, inputs, (PartitionAxis("soc", k_sigma=0.7),), 1.0)
    return fit_network(runs, capacity_Ah=synthetic.CAPACITY_AH, structure=structure).network


def test_the_record_carries_tables_with_bands(fitted: LocalModelNetwork) -> None:
    again = LocalModelNetwork.from_json(json.loads(json.dumps(fitted.to_json(), allow_nan=False)))
    ocv, resistance = tables_of(again)
    np.testing.assert_array_equal(ocv.voltage_V, ocv_table(fitted).voltage_V)
    np.testing.assert_array_equal(resistance.resistance_Ohm, resistance_table(fitted).resistance_Ohm)
    assert ocv.std_V is not None and resistance.std_Ohm is not None
    for step in again.record.tables["step_response"]:
        assert len(step["time_s"]) == len(step["resistance_Ohm"]) == len(step["std_Ohm"]) <= 30
        assert step["time_s"][0] == 1.0 and step["time_s"][-1] == 1800.0


def test_bands_of_the_tables_hold_the_truth(fitted: LocalModelNetwork) -> None:
    # Neighbouring points hang together, so that one fit tells little: of five, nearly all lie within three deviations.
    off = []
    for network in (fitted, *(_fitted(seed) for seed in (12, 22, 32, 42))):
        ocv, _ = tables_of(network)
        assert ocv.std_V is not None
        off.append(np.abs(ocv.voltage_V - synthetic.ocv_V(ocv.soc)) / ocv.std_V)
    assert (np.concatenate(off) < 3.0).mean() > 0.95
    _, resistance = tables_of(fitted)
    assert resistance.std_Ohm is not None
    # The network sees the state of charge of the sample before: what the curve rises in one counts as resistance.
    slope_V = np.gradient(synthetic.ocv_V(resistance.soc), resistance.soc)
    true_Ohm = synthetic.R0_OHM + synthetic.R1_OHM + slope_V / (3600.0 * synthetic.CAPACITY_AH)
    wrong = np.abs(resistance.resistance_Ohm - true_Ohm) / resistance.std_Ohm
    assert (wrong < 3.0).mean() > 0.9
    assert np.median(resistance.std_Ohm) < 0.01 * true_Ohm.min()


def test_the_summary_names_resistance_in_both_directions(fitted: LocalModelNetwork) -> None:
    said = summary(fitted)
    assert [np.sign(row["current_A"]) for row in said["resistance"]] == [-1.0, 1.0]
    for row in said["resistance"]:
        assert row["resistance_Ohm"] == pytest.approx(synthetic.R0_OHM + synthetic.R1_OHM, rel=0.05)
        assert 0.0 < row["std_Ohm"] < 0.005
    low, high = said["ocv_V"]
    assert 3.0 < low < high < 4.5
    assert said["thermal"] is None
    json.dumps(said, allow_nan=False)


def test_points_that_do_not_settle_are_null_and_come_back_missing() -> None:
    """A pole outside the unit circle in the upper half of the SoC."""
    structure = Structure(
        1, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc", 2, k_sigma=0.1),), 1.0
    )
    boxes = initial_partition(structure.axes)
    network = hand_network.network(structure, np.array([[0.5, 0.2, 0.02, 1.8], [1.5, 0.2, 0.02, 1.8]]), boxes)
    document = json.loads(json.dumps(read_out(network), allow_nan=False))
    ocv = OcvTable.from_json(document["ocv"])
    assert np.isnan(ocv.voltage_V[..., -1]).all() and np.isfinite(ocv.voltage_V[..., 0]).all()
    assert any("does not settle" in text for text in document["reservations"])
    summary(replace(network, record=replace(network.record, tables=document)))


def test_tables_without_a_record_are_read_out_now() -> None:
    network = hand_network.everything(1)
    ocv, _ = tables_of(network)
    np.testing.assert_array_equal(ocv.voltage_V, ocv_table(network).voltage_V)
    with pytest.raises(ModelError, match="damaged"):
        tables_of(replace(network, record=ModelRecord(tables={"ocv": {}})))
