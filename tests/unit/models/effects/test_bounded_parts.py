"""Which part of a bounded network stands for which effect."""

import pytest

from models.data.errors import ModelError
from models.effects.bounded_parts import bounded_effects, effects_of, parts_of
from models.identification.bounded.terms import BOTH_WAYS, LOOP, SCALED, SLOPE, SLOW, TRANSFER


def test_every_part_stands_for_one_effect() -> None:
    expected = {
        "charge_discharge_asymmetry",
        "charge_transfer",
        "entropic_voltage",
        "hysteresis",
        "relaxation",
        "temperature_dependence",
    }
    assert set(bounded_effects()) == expected
    assert set(parts_of(bounded_effects())) == {BOTH_WAYS, LOOP, SCALED, SLOPE, SLOW, TRANSFER}
    assert effects_of((SCALED,)) == ("temperature_dependence",)


def test_what_cannot_be_left_out_is_said() -> None:
    with pytest.raises(
        ModelError,
        match="effect soc_dependence cannot be left out.*it can do without charge_discharge_asymmetry, charge_transfer",
    ):
        parts_of(("hysteresis", "soc_dependence"))
    with pytest.raises(ModelError, match="effect nonsense"):
        parts_of(("nonsense",))
