import numpy as np

from models.network.signals import soc_by_counting


def test_soc_counts_charge_and_applies_efficiency_to_charging_only() -> None:
    charge = np.array([0.0, 1.0, 0.5])
    np.testing.assert_allclose(soc_by_counting(charge, 0.2, 2.0), [0.2, 0.7, 0.45])
    np.testing.assert_allclose(soc_by_counting(charge, 0.2, 2.0, 0.9), [0.2, 0.65, 0.4])
