import numpy as np
import pytest

from models.data.resampling import to_grid
from models.identification.lolimot import construct
from models.identification.refinement import refined_theta
from models.identification.search.fitted import Fitted, span_V
from models.identification.shared_poles import fit, moments, output_coefficients, penalties
from models.network.regression import CellContext, build_dataset, find_scaling
from models.network.structure import minimal_structure
from tests.unit.models import synthetic


def fitted(poles_s: tuple[float, ...]) -> Fitted:
    """A shared-pole fit to two runs, with poles that need not be those of the cell."""
    structure = minimal_structure(1.0, len(poles_s), 1)
    runs = [to_grid(synthetic.run(2000, seed=s, noise_V=1e-3), 1.0) for s in (1, 2)]
    cell = CellContext(synthetic.CAPACITY_AH)
    scaling = find_scaling(structure, runs, [0.6, 0.6], cell)
    data = build_dataset(structure, scaling, runs, [0.6, 0.6], cell)
    *_, local = construct(structure, data, 4)
    a = output_coefficients(poles_s, 1.0)
    sums = moments(local.partition, data, a, data.groups())
    return Fitted(
        structure, scaling, data, local.partition, a, sums, fit(sums, penalties(structure, local.partition, data, a))
    )


def quiet(share: float, text: str) -> None:
    assert 0.0 <= share <= 1.0 and text


def test_without_past_outputs_nothing_is_refined() -> None:
    start = fitted(())
    found = refined_theta(start, quiet)
    assert found.penalties is None and found.held_out is None
    np.testing.assert_array_equal(found.theta, start.theta)


def test_a_wrong_pole_is_freed_as_far_as_held_out_samples_agree() -> None:
    start = fitted((6.0,))
    found = refined_theta(start, quiet)
    tried = found.record["held_out_rmse_mV"]
    assert found.penalties is not None and tried["refined"] < 0.8 * tried["none"]
    # Every sample was held out once, but the initial value of either run.
    assert found.held_out is not None
    assert np.isnan(found.held_out).sum() == 2
    span_mV = 1e3 * span_V(start.scaling)
    assert np.sqrt(np.nanmean(found.held_out**2)) * span_mV == pytest.approx(tried["refined"])
    poles_s = -1.0 / np.log(found.theta[:, 0])
    assert np.median(poles_s) == pytest.approx(synthetic.TAU_S, rel=0.4)


def test_right_poles_stay() -> None:
    start = fitted((synthetic.TAU_S,))
    found = refined_theta(start, quiet)
    assert found.penalties is None
    np.testing.assert_array_equal(found.theta, start.theta)
