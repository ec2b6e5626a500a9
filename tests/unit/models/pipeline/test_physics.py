"""Trial pulses of a document that no seal vouches for: far beyond the trained voltages is cold, farther is damaged."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import StructureError
from models.network.model_record import ModelRecord
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.meaning.agreement import check_domain
from models.pipeline.meaning.physics import check_runs, trial_runs
from tests.unit.models.hand_network import SCALING, network


@pytest.mark.parametrize(("spans", "is_refused"), [(3.6, False), (9.0, True)])
def test_the_largest_current_may_drive_a_cold_cell_far_beyond_the_trained_voltages(
    spans: float, is_refused: bool
) -> None:
    structure = Structure(0, (InputChannel("current"),), (PartitionAxis("soc"),), 1.0)
    low_V, high_V = SCALING["voltage"]
    middle_V = 0.5 * (low_V + high_V)
    largest_A = max(float(np.abs(run.current_A).max()) for run, _ in trial_runs(network(structure, np.zeros((1, 2)))))
    ohm = (spans + 0.5) * (high_V - low_V) / largest_A
    cold = network(structure, np.array([[ohm, middle_V]]))
    if is_refused:
        with pytest.raises(StructureError, match=r"its voltage reaches"):
            check_runs(cold)
    else:
        check_runs(cold)


@pytest.mark.parametrize("signal", ["temperature", "temperature:5/30"])
def test_trained_temperatures_that_have_nothing_to_do_with_the_scaling_are_refused(signal: str) -> None:
    structure = Structure(0, (InputChannel(signal),), (PartitionAxis("soc"),), 1.0)
    made = network(structure, np.array([[1e-4, 3.5]]))
    check_domain(made)
    far = ModelRecord.from_json({"domain": {"temperature_degC": [150.0, 190.0]}})
    with pytest.raises(StructureError, match=r"record.domain.temperature_degC is 150..190"):
        check_domain(replace(made, record=far))
