"""Names of signals: what is understood and what is refused."""

import numpy as np
import pytest

from models.data.errors import StructureError
from models.network.signals import RunSignals, is_soc, parse_signal, slower
from models.network.signals.loop_form import is_overpotential
from models.network.signals.temperature import signal_within
from models.network.signals.temperature_scale import FURTHEST_K, within_degC


def test_parameters_follow_the_colon() -> None:
    signal = parse_signal("low_pass:600/3500")
    assert (signal.kind, signal.parameters) == ("low_pass", {"time_constant_s": 600.0, "activation_K": 3500.0})
    assert parse_signal("low_pass:600").get("activation_K") == 0.0
    assert parse_signal("charge_transfer:2/0/0").get("time_constant_s") == 0.0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nonsense:3", "'nonsense:3' is unknown; known are behind_surface, charge_transfer, current"),
        ("current:3", "current takes no parameters"),
        ("low_pass", "low_pass takes time_constant_s/activation_K"),
        ("low_pass:1/2/3", "low_pass takes time_constant_s/activation_K"),
        ("low_pass:slow", "'slow' is not a list of numbers"),
        ("low_pass:-3", "time_constant_s is -3; it must be positive"),
        ("low_pass:0", "time_constant_s is 0; it must be positive"),
        ("charge_transfer:2/0/-1", "time_constant_s is -1; it must be positive"),
        ("scaled_current:nan", "activation_K is nan"),
    ],
)
def test_other_names_are_refused(name: str, words: str) -> None:
    with pytest.raises(StructureError, match=words):
        parse_signal(name)


def test_states_of_charge() -> None:
    assert is_soc("soc") and is_soc("surface_soc:0.05/400")
    assert not is_soc("current") and not is_soc("nonsense")


@pytest.mark.parametrize("name", ["temperature", "inverse_temperature", "scaled_current:2500", "low_pass:60/2500"])
def test_a_temperature_must_have_been_measured(name: str) -> None:
    n = 5
    run = RunSignals(np.ones(n), np.full(n, np.nan), np.full(n, 0.5), 1.0, 2.0)
    with pytest.raises(StructureError, match=f"'{name}' needs a temperature"):
        run.values(name)
    assert np.isfinite(run.values("low_pass:60")).all()


def test_beyond_its_range_a_temperature_is_less_and_less() -> None:
    degC = np.array([-40.0, 4.0, 5.0, 12.0, 25.0, 26.0, 31.0, 100.0])
    at = np.full(len(degC), 0.5)
    run = RunSignals(at, degC, at, 1.0, 2.5)
    name = signal_within(5.04, 24.96)
    assert name == "temperature:5.0/25.0"
    found = run.values(name)
    np.testing.assert_array_equal(found[2:5], degC[2:5])
    assert (np.diff(found) > 0.0).all()
    # At first as it is, and no more than some kelvin in the end.
    np.testing.assert_allclose(found[[1, 5]], [4.0, 26.0], atol=0.1)
    assert found[0] == pytest.approx(5.0 - FURTHEST_K, abs=0.01)
    assert found[6] == pytest.approx(25.0 + FURTHEST_K * (1.0 - np.exp(-1.0)))
    assert found[7] == pytest.approx(25.0 + FURTHEST_K, abs=0.01)
    np.testing.assert_allclose(found, [within_degC(each, 5.0, 25.0) for each in degC.tolist()], rtol=1e-12)
    np.testing.assert_array_equal(run.values("temperature"), degC)
    with pytest.raises(StructureError, match="low_degC is above high_degC"):
        run.values("temperature:25/5")


def test_a_surface_that_is_slower_at_empty_leads_by_more_there() -> None:
    n, name = 40_000, "surface_soc:0.05/100/0/30"
    for soc, times in ((0.0, 31.0), (0.12, 1.0 + 30.0 / np.e), (-0.1, 31.0)):
        held = RunSignals(np.full(n, -0.5), np.full(n, 25.0), np.full(n, soc), 1.0, 2.5)
        lead = held.values(name) - soc
        assert lead[-1] == pytest.approx(-0.05 * 0.2 * times, rel=1e-3)
        # And it takes as many times longer to get there.
        share = lead[int(100.0 * times)] / lead[-1]
        assert share == pytest.approx((held.values("surface_soc:0.05/100")[100] - soc) / (-0.05 * 0.2), abs=0.01)


def test_a_slower_diffusion_leads_by_more_and_takes_longer() -> None:
    assert slower("surface_soc:0.05/100/0/30", 4.0) == "surface_soc:0.2/400/0/30"
    assert slower("behind_surface:0.05/300/3500", 0.5) == "behind_surface:0.025/150/3500"
    assert slower("surface_soc:0.05/100", 1.0) == "surface_soc:0.05/100"
    others = ("soc", "current", "low_pass:60/3500", "relaxation:300")
    assert tuple(slower(name, 4.0) for name in others) == others


def test_what_a_mean_is_behind_a_surface_is_no_overpotential() -> None:
    def is_one(name: str) -> bool:
        signal = parse_signal(name)
        assert signal.definition.loop is not None
        return is_overpotential(signal.definition.loop(signal, 1.0, 2.5).code)

    assert is_one("current") and is_one("low_pass:60/3500") and is_one("relaxation:300")
    assert not is_one("behind_surface:0.05/300/3500") and not is_one("surface_soc:0.05/300/3500")
