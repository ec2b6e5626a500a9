"""The memory of a diagnosis: its parts must belong together, and its covariance be one."""

from __future__ import annotations

import numpy as np

from models.data.errors import StructureError
from models.diagnosis.known.record import known_in
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import is_soc, parse_signal

# Of the largest eigenvalue: numbers are written with eight digits.
_ROUNDING = 1e-5
_MOST = 1e6


def check_memory(network: LocalModelNetwork) -> None:
    """Refuse a memory whose parts do not belong together; raises `ModelError`."""
    known = known_in(network)
    if known is None:
        return
    cell, elsewhere = known.cell, known.elsewhere
    layout, knots, n_terms = cell.layout, cell.layout.knots, len(cell.layout.basis.terms)
    for term in layout.basis.terms:
        parse_signal(term.signal)
    last = len(knots.soc) - 1
    points = elsewhere.known
    fits = {
        "axis": is_soc(layout.basis.axis),
        "scale": layout.scale.shape == (n_terms,) and bool((layout.scale > 0.0).all()),
        "first": layout.first.shape == (n_terms + 1,) and bool((np.diff(layout.first) > 0).all()),
        "knots.soc": bool((np.diff(knots.soc) > 0.0).all()) and bool((np.abs(knots.soc - 0.5) <= 1.0).all()),
        "knots.gain": bool((np.diff(knots.gain) > 0).all()) and 0 <= knots.gain.min() <= knots.gain.max() <= last,
        "knots.slope": bool((np.diff(knots.slope) > 0).all()) and 0 <= knots.slope.min() <= knots.slope.max() <= last,
        "coefficients": _finite(cell.coefficients) and cell.coefficients.shape == (layout.size,),
        "covariance": _finite(cell.covariance) and _is_covariance(cell.covariance),
        "capacity_Ah": cell.capacity_Ah > 0.0,
        "dt_s": cell.dt_s > 0.0,
        "domain": all(low <= high for low, high in cell.domain.values()) and {"soc", "current_A"} <= set(cell.domain),
        "typical_Ohm": cell.typical_Ohm > 0.0,
        "usual": _finite(cell.usual) and cell.usual.shape == (n_terms,),
        "variances": _finite(elsewhere.variances) and elsewhere.variances.ndim == 1,
        "rate_scale": _finite(elsewhere.rate_scale) and bool((elsewhere.rate_scale > 0.0).all()),
        "points.rates": _finite(points.rates) and points.rates.shape == (len(points.run), len(elsewhere.rate_scale)),
        "left_V": _finite(elsewhere.left_V) and elsewhere.left_V.ndim == 1,
        "unseen_V": _finite(elsewhere.unseen_V) and elsewhere.unseen_V.ndim == 1,
    }
    if wrong := [name for name, right in fits.items() if not right]:
        raise StructureError(f"model document is damaged: record.diagnosis.{wrong[0]} does not fit the rest of it")


def _finite(values: np.ndarray) -> bool:
    return bool((np.abs(values) <= _MOST).all())


def _is_covariance(covariance: np.ndarray) -> bool:
    spread = np.linalg.eigvalsh(covariance)
    return bool(spread[0] >= -_ROUNDING * max(spread[-1], 0.0))
