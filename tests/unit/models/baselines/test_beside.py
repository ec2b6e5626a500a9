"""Baselines beside a model, fitted to its training runs."""

import pytest

from models.baselines.beside import BASELINES, beside_baselines
from models.data.errors import ModelError
from tests.unit.models import hand_network, synthetic


def test_each_is_fitted_and_judged_on_the_same_runs() -> None:
    train, judged = [synthetic.run(1500, seed=2, noise_V=1e-3)], [synthetic.run(1000, seed=3, noise_V=1e-3)]
    model = hand_network.everything(1)
    assert (model.cell.capacity_Ah, model.dt_s) == (synthetic.CAPACITY_AH, 1.0)
    found = beside_baselines(model, ["1rc", "2rc"], (train, [0.6]), (judged, [0.6]))
    assert [each["name"] for each in found] == ["1rc", "2rc"]
    # The cell has one pair of resistor and capacitor.
    assert all(each["overall"]["rmse_mV"] < 5.0 for each in found)
    assert found[0]["runs"][0]["rmse_mV"] == found[0]["overall"]["rmse_mV"]
    with pytest.raises(ModelError, match=f"'3rc' is not known; use one of {', '.join(BASELINES)}"):
        beside_baselines(model, ["3rc"], (train, [0.6]), (judged, [0.6]))
    with pytest.raises(ModelError, match="name them as training runs"):
        beside_baselines(model, ["1rc"], ([], []), (judged, [0.6]))
