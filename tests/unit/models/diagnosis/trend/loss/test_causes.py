"""A lost capacity is called by its cause where the electrodes of the cell are known."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.known.cell import SURFACE
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.reference.record import Record
from models.diagnosis.trend.answer import answer
from models.diagnosis.trend.estimate import Weighed, seen, weighed
from models.diagnosis.trend.loss import origin
from models.diagnosis.trend.loss.losses import LITHIUM, NEGATIVE, POSITIVE, SHARES, WAYS, losses_of
from models.diagnosis.trend.series import ways_of
from models.diagnosis.trend.weights.sizes import EVERY
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.half_cells import HalfCells, half_cells, own_curve
from models.effects.view import View
from tests.unit.models.diagnosis.hand_reference import EMPTY_V, SLOPE_V
from tests.unit.models.diagnosis.known.hand_cell import known_runs, true_run
from tests.unit.models.hand_network import CAPACITY_AH

# Fillings of either electrode, empty and full.
X0, X1, Y0, Y1 = 0.02, 0.83, 0.90, 0.27
LOST = 0.12


@pytest.fixture(scope="module")
def known() -> KnownRuns:
    """As if a cell of graphite against an oxide had been known from empty to full."""
    known = known_runs()
    cell, coefficients = known.cell, known.cell.coefficients.copy()
    knots = np.linspace(0.0, 1.0, cell.layout.n_curve)
    layout = replace(cell.layout, knots=replace(cell.layout.knots, soc=knots))
    potential = POSITIVES["nmc532"].potential_V
    coefficients[: len(knots)] = potential(Y0 + knots * (Y1 - Y0)) - NEGATIVES["graphite"](X0 + knots * (X1 - X0))
    domain = cell.domain | {"soc": (0.0, 1.0), SURFACE: (0.0, 1.0)}
    return replace(known, cell=replace(cell, layout=layout, domain=domain, coefficients=coefficients))


@pytest.fixture(scope="module")
def electrodes(known: KnownRuns) -> HalfCells:
    found = half_cells(known.cell)
    assert found is not None and found.sure
    return found


def discharge(
    known: KnownRuns,
    fresh: HalfCells,
    aged: HalfCells,
    unlike_soc: float = 0.05,
    sooner: float = 0.0,
    bump_V: float = 0.0,
) -> GridRun:
    """From full to empty at 1C of the fresh cell, after a short rest.

    Particles are filled by up to `unlike_soc` more or less than in the mean, but near the ends. The voltage is at its
    end `sooner` than at rest, of the state of charge, and has a bump of `bump_V`.
    """
    capacity_Ah = CAPACITY_AH * aged.capacity / fresh.capacity
    current_A = np.full(int(3600 * capacity_Ah / CAPACITY_AH) + 20, -CAPACITY_AH)
    current_A[:20] = 0.0
    soc = 1.0 + np.cumsum(current_A) / 3600.0 / capacity_Ah
    held = np.clip(np.minimum(soc, 1.0 - soc) / 0.1, 0.0, 1.0)
    unlike = [soc + held * each for each in np.linspace(-unlike_soc, unlike_soc, 11)]
    bent_V = np.mean([aged.open_circuit_V(each) - fresh.open_circuit_V(each) for each in unlike], axis=0)
    own_V = known.cell.open_circuit_V(soc) + bent_V
    own_V = own_V + bump_V * np.exp(-0.5 * ((soc - 0.4) / 0.05) ** 2)
    if sooner:
        low_V = aged.limits_V[0]
        own_V = own_V + (low_V - np.interp(sooner, soc[::-1], own_V[::-1])) * np.exp((sooner - soc) / 0.005)
        current_A, own_V, soc = (each[soc >= sooner] for each in (current_A, own_V, soc))
    added_V = own_V - EMPTY_V - SLOPE_V * soc
    return true_run(current_A, soc=1.0, capacity_Ah=capacity_Ah, added_V=added_V, noise_V=2e-4, seed=3)


def judged(known: KnownRuns, fresh: HalfCells, aged: HalfCells, unlike_soc: float = 0.05) -> Weighed:
    return weighed(seen(known, discharge(known, fresh, aged, unlike_soc), 1.0, 0.005))


def by_cause(found: Weighed) -> dict[str, float]:
    return {
        cause: sum(p for way, p in found.chances.way.items() if way >= 0 and WAYS[way].cause == cause)
        for cause in (LITHIUM, NEGATIVE, POSITIVE)
    }


def told(found: Weighed, changes: tuple[str, ...] = ("capacity",)):  # noqa: ANN201
    run, soc = found.given.run, found.given.soc
    view = View(found.given.known.cell, run, soc, np.arange(len(run)))
    by_set = np.array([0.97 if each == changes else 0.03 / (len(EVERY) - 1) for each in EVERY])
    by_way = ways_of([found.chances], by_set[None, :])[0]
    return answer(found, Record([run], [soc], [view.residual_V]), by_set, True, time.perf_counter(), by_way)


def test_losses_make_one_capacity_and_one_curve_of_every_share(known: KnownRuns, electrodes: HalfCells) -> None:
    curve = own_curve(known.cell)
    assert curve is not None
    losses = losses_of(curve)
    assert len(losses) == len(WAYS) * len(SHARES)
    first = losses[9]
    aged = electrodes.less_lithium(first.share)
    assert WAYS[first.way].cause == LITHIUM and first.share == pytest.approx(0.1)
    assert first.change == pytest.approx(aged.capacity / electrodes.capacity - 1.0)
    at = np.array([0.3, 1.0])
    bent_V = aged.open_circuit_V(at) - electrodes.open_circuit_V(at)
    np.testing.assert_allclose(first.bent.voltage_V(at, 0.0 * at, first.change), bent_V, atol=3e-3)


@pytest.mark.parametrize("unlike_soc", [0.0, 0.05])
@pytest.mark.parametrize(
    ("cause", "loss", "effect", "name"),
    [
        (LITHIUM, HalfCells.less_lithium, "lithium_loss", "share_lost"),
        (NEGATIVE, HalfCells.less_negative, "active_material_loss", "share_lost of the negative electrode"),
        (POSITIVE, HalfCells.less_positive, "active_material_loss", "share_lost of the positive electrode"),
    ],
)
def test_a_loss_is_named_with_its_share(
    known: KnownRuns,
    electrodes: HalfCells,
    cause: str,
    loss: Callable[[HalfCells, float], HalfCells],
    effect: str,
    name: str,
    unlike_soc: float,
) -> None:
    found = judged(known, electrodes, loss(electrodes, LOST), unlike_soc)
    chances = by_cause(found)
    assert max(chances, key=lambda each: chances[each]) == cause and chances[cause] > 0.7
    (finding,) = told(found).findings
    assert finding.effect == effect and finding.evidence["causes"]
    share = finding.parameters[name]
    assert share.value == pytest.approx(LOST, rel=0.2) and share.unit == "1"
    assert finding.parameters["capacity_Ah"].value < CAPACITY_AH
    assert finding.error_after_mV < 0.3 * finding.error_before_mV
    assert "share lost" in finding.explanation


def test_a_loss_is_as_large_where_the_voltage_ends_sooner_under_load_than_at_rest(
    known: KnownRuns, electrodes: HalfCells
) -> None:
    run = discharge(known, electrodes, electrodes.less_lithium(LOST), sooner=0.02)
    found = weighed(seen(known, run, 1.0, 0.005))
    (finding,) = told(found).findings
    assert finding.effect == "lithium_loss"
    assert finding.parameters["share_lost"].value == pytest.approx(LOST, rel=0.15)
    counted_Ah = float(abs(run.charge_Ah[-1]))
    assert finding.parameters["capacity_Ah"].value == pytest.approx(counted_Ah, rel=0.02)


def test_a_loss_is_said_before_the_curve_that_has_moved_beside_it(known: KnownRuns, electrodes: HalfCells) -> None:
    run = discharge(known, electrodes, electrodes.less_lithium(LOST), bump_V=0.03)
    found = weighed(seen(known, run, 1.0, 0.005))
    named = [each.effect for each in told(found, ("capacity", "curve")).findings]
    assert named == ["lithium_loss", "ocv_shape"]


def test_a_moved_curve_that_the_loss_explains_is_not_named_beside_it(known: KnownRuns, electrodes: HalfCells) -> None:
    found = judged(known, electrodes, electrodes.less_lithium(LOST))
    assert [each.effect for each in told(found, ("capacity", "curve")).findings] == ["lithium_loss"]


def test_of_electrodes_that_others_match_as_well_a_cause_has_to_be_surer(
    known: KnownRuns, electrodes: HalfCells, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = judged(known, electrodes, electrodes.less_lithium(LOST))
    monkeypatch.setattr(origin, "half_cells", lambda cell: replace(electrodes, chance=0.4))

    def cause(chance: float) -> str:
        by_way = np.full(len(WAYS) + 1, (1.0 - chance) / len(WAYS))
        by_way[0] = chance
        return origin.origin_of(found, ("capacity",), by_way).cause

    assert WAYS[0].cause == LITHIUM
    assert cause(0.9) == "" and cause(0.99) == LITHIUM


def test_a_cell_that_published_curves_do_not_make_has_lost_capacity_and_no_more(known: KnownRuns) -> None:
    cell, coefficients = known.cell, known.cell.coefficients.copy()
    knots = cell.layout.knots.soc
    coefficients[: len(knots)] = EMPTY_V + SLOPE_V * knots + 0.05 * np.sin(25.0 * knots)
    odd = replace(known, cell=replace(cell, coefficients=coefficients))
    electrodes = half_cells(odd.cell)
    assert electrodes is not None and not electrodes.sure
    found = judged(odd, electrodes, electrodes.less_lithium(LOST))
    assert [each.effect for each in told(found).findings] == ["capacity"]
