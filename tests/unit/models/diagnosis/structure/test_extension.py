"""What has no way into a structure; which way is best where there is one, `answer/test_refits` shows by refits."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.structure.extension import Extension, ExtensionSearch
from models.effects import effect
from models.identification.progress import silent
from models.identification.search.given import GivenCandidate
from models.identification.search.search import Search
from models.network.structure import InputChannel, minimal_structure
from tests.unit.models.diagnosis.hand_reference import SOC, steps_A, true_run
from tests.unit.models.hand_network import CELL

PLAIN = minimal_structure(1.0, output_order=0)


@pytest.fixture(scope="module")
def search() -> ExtensionSearch:
    run = true_run(steps_A(600), noise_V=1e-3, temperature_degC=25.0 + np.sin(np.arange(600) / 50.0))
    return ExtensionSearch(Search([run], [SOC], CELL, silent))


def extended(search: ExtensionSearch, name: str, *signals: str) -> Extension | None:
    structure = replace(PLAIN, inputs=(*PLAIN.inputs, *(InputChannel(each) for each in signals)))
    return search.extended(Extension(GivenCandidate(structure, ()), 1e-3), effect(name), {})


@pytest.mark.parametrize("name", ["capacity", "initial_soc", "current_offset", "voltage_offset"])
def test_what_is_put_right_in_an_input_has_no_way_into_a_structure(search: ExtensionSearch, name: str) -> None:
    assert extended(search, name) is None


@pytest.mark.parametrize(
    ("name", "signal"), [("hysteresis", "hysteresis_state:30"), ("charge_transfer", "charge_transfer:1/2500")]
)
def test_what_a_structure_has_whatever_its_constants_is_not_put_in_again(
    search: ExtensionSearch, name: str, signal: str
) -> None:
    assert extended(search, name, signal) is None
