"""Which form the reference model of a diagnosis takes, so that it need not be chosen again."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.diagnosis import own_variant
from models.identification.bounded.variants import Variant
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from simulators.catalogue import CELLS
from tests.unit.models.diagnosis.cells import measured, simple_network

CELL = CELLS["nmc"].parameters
FORM = Variant((0.05, 600.0, 3500.0), squared=True)
RUN = to_grid(measured(CELL, 1), 1.0)


def network(choices: dict[str, Any]) -> LocalModelNetwork:
    return replace(simple_network(CELL.capacity_Ah), record=ModelRecord(choices=choices))


@pytest.mark.parametrize(
    "choices", [{"family": "bounded", **FORM.to_json()}, {"family": "searched", "bounded": FORM.to_json()}]
)
def test_it_is_that_of_the_network_or_of_the_bounded_one_that_it_was_held_against(choices: dict[str, Any]) -> None:
    assert own_variant(network(choices), [RUN]) == FORM


def test_it_is_chosen_where_none_was_or_no_temperature_was_measured() -> None:
    assert own_variant(network({"family": "searched"}), [RUN]) is None
    cold = replace(RUN, temperature_degC=np.full(len(RUN), np.nan))
    assert own_variant(network({"family": "bounded", **FORM.to_json()}), [cold]) is None
