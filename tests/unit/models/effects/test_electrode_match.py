"""Published half-cell curves found in what a cell does under constant currents."""

import numpy as np
import pytest

from models.effects.electrode_match import Loaded, matches
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.half_cells import Curve, half_cells, likely
from tests.unit.models.effects.linear_cell import LinearCell

WINDOW = (0.04, 0.89, 0.86, 0.28)
SOC = np.linspace(0.06, 0.94, 50)


def loaded(
    negative: str,
    positive: str,
    ahead_n: float,
    ahead_p: float,
    window: tuple[float, float, float, float] = WINDOW,
) -> Loaded:
    """Charge at C/2 and discharge at C/3, with 90 mV at 1C that fall with the state of charge, more in a discharge."""
    x0, x1, y0, y1 = window
    soc, rate = np.tile(SOC, 2), np.repeat([0.5, -0.33], len(SOC))
    made_V = (0.09 - 0.02 * soc) * rate - 0.004 * (rate < 0.0)
    positive_V = POSITIVES[positive].potential_V(y0 + (soc + ahead_p * rate) * (y1 - y0))
    voltage_V = positive_V - NEGATIVES[negative](x0 + (soc + ahead_n * rate) * (x1 - x0)) + made_V
    return tuple(soc.tolist()), tuple(voltage_V.tolist()), tuple(rate.tolist())


@pytest.mark.parametrize("pair", [("graphite-silicon", "nmc811"), ("graphite-pouch", "nickel-cobalt")])
@pytest.mark.parametrize("ahead", [(0.0, 0.0), (0.03, 0.15)])
def test_electrodes_are_found_under_load_however_far_their_surfaces_are_ahead(
    pair: tuple[str, str], ahead: tuple[float, float]
) -> None:
    first, second, *_ = matches(loaded(*pair, *ahead))
    assert (first.negative, first.positive) == pair
    np.testing.assert_allclose(first.window, WINDOW, atol=0.015)
    assert first.left_V < 1e-3 < second.left_V


@pytest.mark.parametrize(
    ("pair", "window"),
    [
        # Graphite that an empty cell leaves a fourth full, and oxides that a full one empties, or an empty one fills.
        (("mesocarbon", "cobalt"), (0.25, 0.94, 0.96, 0.51)),
        (("graphite-nca", "nca"), (0.06, 0.7, 0.98, 0.34)),
        (("graphite", "nmc532"), (0.01, 0.83, 0.89, 0.03)),
    ],
)
def test_unusual_windows_are_found_too(pair: tuple[str, str], window: tuple[float, float, float, float]) -> None:
    first = matches(loaded(*pair, 0.03, 0.02, window))[0]
    assert (first.negative, first.positive) == pair
    np.testing.assert_allclose(first.window, window, atol=0.025)


def test_pairs_that_match_alike_are_all_kept_with_their_chances() -> None:
    soc, voltage_V, rate = loaded("graphite", "nmc532", 0.02, 0.02)
    # A curve that is known over a part only, as by a charge that begins half full.
    kept = [k for k, each in enumerate(soc) if each > 0.6]
    part = tuple(tuple(each[k] for k in kept) for each in (soc, voltage_V, rate))
    every = likely(Curve((0.6, 0.94), (3.7, 4.1), (part[0], part[1], part[2])))
    assert len(every) > 1 and sum(each.chance for each in every) <= 1.0
    assert every[0].chance == max(each.chance for each in every)
    assert not every[0].sure


def test_a_cell_without_electrodes_of_a_usual_size_has_learned_ones() -> None:
    found = half_cells(LinearCell())
    assert found is not None and not found.sure and found.chance == 1.0
