"""The state of charge of a whole run, told after the fact."""

from dataclasses import replace

import numpy as np

from models.observer import FuzzyObserver
from models.observer.observation import answer_of, observe
from tests.unit.models import synthetic


def test_what_the_end_knows_holds_from_the_first_sample_on(tuned: FuzzyObserver) -> None:
    run = synthetic.run(4000, seed=11, noise_V=1e-3)
    found = observe(tuned, run, 0.3, None)
    assert run.soc_ref is not None
    filtered, smoothed = (np.abs(each - run.soc_ref) for each in (found.soc, found.smoothed.soc))
    assert smoothed[:50].max() < 0.01 < filtered[0]
    assert smoothed.max() < 0.01
    told = answer_of(tuned, [found])["runs"][0]["smoothed"]
    assert told["soc_rmse"] < 0.01 and told["converged_after_s"] == 0.0
    assert abs(told["initial_soc"]["value"] - 0.6) < 3.0 * told["initial_soc"]["std"]
    # At the end both know the same.
    assert found.smoothed.soc[-1] == np.float64(found.soc[-1])
    np.testing.assert_allclose(found.smoothed.soc_std[-1], found.soc_std[-1], rtol=1e-6)


def test_an_offset_of_the_sensor_is_counted_out_backwards(tuned: FuzzyObserver) -> None:
    offset_A = 0.01 * synthetic.CAPACITY_AH
    run = synthetic.run(5000, seed=12, noise_V=1e-3)
    off = replace(run, current_A=run.current_A + offset_A)
    found = observe(tuned, off, 0.6, 0.01)
    assert run.soc_ref is not None
    error = found.smoothed.soc - run.soc_ref
    assert np.abs(error).max() < 0.005
    counted = np.concatenate([[0.0], np.cumsum(off.current_A[1:])]) / (3600.0 * synthetic.CAPACITY_AH) + 0.6
    assert np.sqrt(np.mean(error**2)) < 0.7 * np.sqrt(np.mean((counted - run.soc_ref) ** 2))
