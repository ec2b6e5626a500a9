"""Effects that are added to a bounded network, which is fitted again with its bounds."""

import pytest

from models.data.errors import ModelError
from models.network.lineage import version_of
from models.pipeline.addition import Addition, add_effect
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import fitted, run


def added(name: str, without: tuple[str, ...]) -> Addition:
    return add_effect(fitted(without=without).network, name, [run(2), run(4)], [SOC, SOC], [run(9)], [SOC])


def test_an_effect_that_was_left_out_is_put_in_with_bounds() -> None:
    made = added("hysteresis", ("hysteresis",))
    assert made.error_after_mV < 0.5 * made.error_before_mV
    network = made.network
    assert network.structure.name == "bounded+hysteresis" and network.structure.kernel == "hat"
    choices, version = network.record.choices, version_of(network)
    assert choices is not None and choices["family"] == "bounded" and choices["without"] == []
    assert any("hysteresis" in term["effects"] for term in choices["terms"])
    assert version is not None and (version.number, version.made_by) == (2, "effect")
    assert made.parameters["amplitude_V"].value == pytest.approx(0.02, rel=0.5)


def test_others_stay_left_out_where_runs_are_corrected() -> None:
    made = added("current_offset", ("hysteresis",))
    assert made.network.structure.name == "bounded+current_offset"
    choices = made.network.record.choices
    assert choices is not None and choices["without"] == ["hysteresis"]


def test_what_it_has_or_cannot_have_is_refused() -> None:
    for name in ("hysteresis", "soc_dependence"):
        with pytest.raises(ModelError, match=f"has {name} already"):
            added(name, ())
    with pytest.raises(ModelError, match="--structure full"):
        added("charge_discharge_asymmetry", ())
