"""Which module model is taken where runs cannot be left out."""

import numpy as np

from models.module.models import ModuleRun
from models.pipeline.module.choice import candidates, chosen

LAYOUT = (3, 1)
CHARGE_OHM, DISCHARGE_OHM, OFFSET_V = 0.02, 0.05, 0.1


def one_way(sign: int, n: int = 400) -> ModuleRun:
    """A run of one direction, of a module whose resistance is another in the other."""
    rng = np.random.default_rng(10 + sign)
    current_A = sign * rng.uniform(1.0, 10.0, n)
    cell_V = 3.7 + 0.01 * current_A
    beside_V = np.where(current_A > 0.0, CHARGE_OHM, DISCHARGE_OHM) * current_A + OFFSET_V
    return ModuleRun(3.0 * cell_V + beside_V + 1e-3 * rng.standard_normal(n), current_A, cell_V, f"run {sign:+d}")


def test_a_run_of_each_direction_tells_them_apart() -> None:
    found, reservations = candidates([one_way(1), one_way(-1)], [], LAYOUT, 0.0)
    assert reservations == [] and [each.model.kind for each in found] == ["S1", "S2", "S3", "S4"]
    best = chosen(found)
    assert best.model.kind == "S4" and best.held_out_rmse_mV < 1.2
    np.testing.assert_allclose(best.model.resistance_Ohm, [CHARGE_OHM, DISCHARGE_OHM], rtol=0.02)


def test_whole_runs_are_left_out_where_that_leaves_enough() -> None:
    both = [one_way(1), one_way(-1)]
    odd = one_way(1)
    # A run that the others say nothing of: by parts it would be seen.
    both.append(ModuleRun(odd.voltage_V + 1.0, odd.current_A, odd.cell_voltage_V, "odd"))
    both.append(one_way(-1))
    found, _ = candidates(both, [], LAYOUT, 0.0)
    assert min(each.held_out_rmse_mV for each in found) > 400.0


def test_a_direction_that_no_run_has_keeps_its_reason() -> None:
    found, reservations = candidates([one_way(-1), one_way(-1)], [], LAYOUT, 0.0)
    assert [each.model.kind for each in found] == ["S1", "S2", "S3"]
    (text,) = reservations
    assert "S4: only 0 sample(s) while charging" in text and "left out" not in text


def test_a_direction_in_one_part_alone_says_that_it_is_left_out() -> None:
    charge, discharge = one_way(1, 25), one_way(-1, 75)
    run = ModuleRun(
        np.concatenate([charge.voltage_V, discharge.voltage_V]),
        np.concatenate([charge.current_A, discharge.current_A]),
        np.concatenate([charge.cell_voltage_V, discharge.cell_voltage_V]),
    )
    found, reservations = candidates([run], [], LAYOUT, 0.0)
    assert [each.model.kind for each in found] == ["S1", "S2", "S3"]
    (text,) = reservations
    assert "S4: only 0 sample(s) while charging" in text and "left out" in text
