import numpy as np
import pytest

from models.baselines.tables import Table
from models.data.errors import StructureError

SOC, DEGC = np.array([0.0, 0.2, 1.0]), np.array([-10.0, 25.0])


def bilinear(soc: np.ndarray, degC: np.ndarray) -> np.ndarray:
    return 3.0 + 0.5 * soc - 0.002 * degC + 0.01 * soc * degC


@pytest.fixture
def table() -> Table:
    return Table(SOC, DEGC, bilinear(SOC[:, None], DEGC[None, :]))


def test_a_bilinear_function_is_met_exactly(table: Table) -> None:
    rng = np.random.default_rng(0)
    soc, degC = rng.uniform(0, 1, 200), rng.uniform(-10, 25, 200)
    np.testing.assert_allclose(table.at(soc, degC), bilinear(soc, degC), rtol=1e-12)
    np.testing.assert_allclose(table.slope_at(soc, degC), 0.5 + 0.01 * degC, rtol=1e-12)


def test_the_nearest_knot_holds_outside(table: Table) -> None:
    np.testing.assert_allclose(table.at([-0.5, 1.5], [0.0, 0.0]), table.at([0.0, 1.0], [0.0, 0.0]))
    np.testing.assert_allclose(table.at(0.5, [-40.0, 60.0]), table.at(0.5, [-10.0, 25.0]))


def test_one_knot_means_no_dependence() -> None:
    table = Table(np.array([0.5]), np.array([25.0]), np.array([[0.02]]))
    np.testing.assert_array_equal(table.at([0.0, 1.0], [-20.0, np.nan]), [0.02, 0.02])
    np.testing.assert_array_equal(table.slope_at([0.0, 1.0], [0.0, 0.0]), [0.0, 0.0])
    assert not table.needs_temperature


def test_document_round_trip(table: Table) -> None:
    again = Table.from_json(table.to_json())
    np.testing.assert_array_equal(again.values, table.values)
    np.testing.assert_array_equal(again.soc, table.soc)


@pytest.mark.parametrize(
    ("soc", "values"),
    [([0.0, 0.0], np.ones((2, 2))), ([0.0, 1.0], np.ones((3, 2))), ([0.0, 1.0], np.full((2, 2), np.nan))],
)
def test_refuses_what_is_no_table(soc: list[float], values: np.ndarray) -> None:
    with pytest.raises(StructureError):
        Table(np.array(soc), DEGC, values)
