"""How well each parameter of a network is known, by its name."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import cho_factor

from models.data.timeseries import FloatArray
from models.design.information.criteria import root_of_inverse
from models.network.local_model_network import LocalModelNetwork


def parameter_std(information: FloatArray) -> FloatArray:
    """Standard deviation of each parameter, normalised units: the Cramer-Rao bound."""
    factor, _ = cho_factor(information, lower=True, check_finite=False)
    return np.sqrt(np.sum(root_of_inverse(factor) ** 2, axis=0))


def parameter_names(network: LocalModelNetwork) -> list[str]:
    """Name of each parameter, as the information matrix orders them; of hats with the place of their knot."""
    names: Any = network.structure.regressor_names()
    places = [f"local model {i + 1}" for i in range(network.n_models)]
    if network.structure.kernel == "hat":
        low, high = network.scaling[network.structure.axes[0].signal]
        places = [f"SoC {low + (high - low) * at:.3f}" for at in network.partition.centres[:, 0].tolist()]
    return [f"{place}: {name}" for place in places for name in names]
