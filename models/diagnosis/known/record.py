"""What is known of the training runs as a document of plain types, in a model's record."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import OWN_LOAD, PLACES, TIMES, WHITE, Elsewhere, Points
from models.diagnosis.known.lacks import NOTHING_LACKS, Lacks
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.thermal.heat_balance import HeatBalance
from models.identification.bounded.knots import Knots
from models.identification.bounded.layout import Layout, slope_limit
from models.identification.bounded.terms import Basis, Term
from models.network.local_model_network import LocalModelNetwork

SCHEMA_VERSION = 6
# Documents of these versions know nothing of what a run has of its own of the load there, or of what the cell may lack:
# they are read as if it were nothing. Of the last of them errors of a minute were learned under a current that was
# low-passed by 20 s: they are read as if it had been under the current. In all of them the heat balance is left out: it
# took what was supposed to have flowed before a run for measured, and charge that had not spread yet for no loss.
_WITHOUT_OWN_LOAD, _PLACE_OF_OWN_LOAD = 2, len(PLACES) + TIMES.index(OWN_LOAD)
_WITHOUT_LACKS, _LOW_PASSED, _OTHER_HEAT = 3, 4, 5
# Digits that are written: far more than the estimates are good for; of what is open enough for a standard deviation.
_DIGITS, _DIGITS_OPEN = 8, 4


def to_json(known: KnownRuns) -> dict[str, Any]:
    """Return a document; of the symmetric covariance one half is written."""
    cell, elsewhere = known.cell, known.elsewhere
    layout = cell.layout
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "diagnosis_memory",
        "terms": [
            {"signal": term.signal, "parts": list(term.parts), "bounded": term.bounded} for term in layout.basis.terms
        ],
        "axis": layout.basis.axis,
        "knots": {each.name: getattr(layout.knots, each.name).tolist() for each in fields(Knots)},
        "scale": layout.scale.tolist(),
        "first": layout.first.tolist(),
        "coefficients": cell.coefficients.tolist(),
        "covariance": _short(cell.covariance[np.triu_indices(layout.size)]),
        "capacity_Ah": cell.capacity_Ah,
        "dt_s": cell.dt_s,
        "domain": {name: list(span) for name, span in cell.domain.items()},
        "typical_Ohm": cell.typical_Ohm,
        "usual": cell.usual.tolist(),
        "variances": elsewhere.variances.tolist(),
        "granted": elsewhere.granted,
        "rate_scale": elsewhere.rate_scale.tolist(),
        "points": {each.name: _short(getattr(elsewhere.known, each.name)) for each in fields(Points)},
        "left_V": _short(elsewhere.left_V),
        "unseen_V": _short(elsewhere.unseen_V),
        "noise_V2": elsewhere.noise_V2,
        "own_V2": elsewhere.own_V2,
        "balance": None if known.balance is None else asdict(known.balance),
        "lacks": {
            "effects": list(known.lacks.effects),
            "root": _short(known.lacks.root, _DIGITS_OPEN),
            "follow": _short(known.lacks.follow, _DIGITS_OPEN),
        },
    }


def from_json(document: dict[str, Any]) -> KnownRuns:
    """Read what `to_json` wrote.

    Raises
    ------
    ModelError
        It is none, or damaged.
    """
    known_versions = (_WITHOUT_OWN_LOAD, _WITHOUT_LACKS, _LOW_PASSED, _OTHER_HEAT, SCHEMA_VERSION)
    if document.get("kind") != "diagnosis_memory" or document.get("schema_version") not in known_versions:
        raise ModelError(f"not a diagnosis memory of schema version {SCHEMA_VERSION}; fit the model again")
    try:
        cell, elsewhere, lacks = _cell(document), _elsewhere(document), _lacks(document)
        heat = document["balance"] if document["schema_version"] > _OTHER_HEAT else None
        balance = None if heat is None else HeatBalance(**heat)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ModelError(f"diagnosis memory is damaged: {error!r}; fit the model again") from None
    counts = {len(getattr(elsewhere.known, each.name)) for each in fields(Points)} | {
        len(elsewhere.left_V),
        len(elsewhere.unseen_V),
    }
    causes = len(PLACES) + len(TIMES) + len(WHITE)
    fits = len(cell.coefficients) == cell.layout.size and len(counts) == 1 and len(elsewhere.variances) == causes
    if lacks.effects:
        fits = fits and lacks.root.ndim == 2 and len(lacks.root) == len(lacks.effects)
        fits = fits and lacks.follow.shape == (cell.layout.size, len(lacks.effects))
    if not fits:
        raise ModelError("diagnosis memory is damaged: its sizes do not fit; fit the model again")
    return KnownRuns(cell, elsewhere, balance, lacks)


def known_in(network: LocalModelNetwork) -> KnownRuns | None:
    """Read what a network's record knows of its training runs; None where it knows nothing."""
    document = network.record.diagnosis
    return None if document is None else from_json(document)


def _cell(document: dict[str, Any]) -> KnownCell:
    terms = tuple(Term(str(each["signal"]), tuple(each["parts"]), bool(each["bounded"])) for each in document["terms"])
    knots = document["knots"]
    places = Knots(_array(knots["soc"]), np.array(knots["gain"], np.int64), np.array(knots["slope"], np.int64))
    coefficients = _array(document["coefficients"])
    layout = Layout(
        Basis(str(document["axis"]), terms),
        places,
        _array(document["scale"]),
        np.array(document["first"], np.int64),
        slope_limit(places, coefficients[: len(places.soc)]),
    )
    covariance = np.zeros((layout.size, layout.size))
    covariance[np.triu_indices(layout.size)] = document["covariance"]
    covariance += np.triu(covariance, 1).T
    return KnownCell(
        layout,
        coefficients,
        covariance,
        float(document["capacity_Ah"]),
        float(document["dt_s"]),
        {name: (float(span[0]), float(span[1])) for name, span in document["domain"].items()},
        float(document["typical_Ohm"]),
        _array(document["usual"]),
    )


def _elsewhere(document: dict[str, Any]) -> Elsewhere:
    variances = _array(document["variances"])
    return Elsewhere(
        np.insert(variances, _PLACE_OF_OWN_LOAD, 0.0) if document["schema_version"] == _WITHOUT_OWN_LOAD else variances,
        {str(name): float(value) for name, value in document["granted"].items()},
        _array(document["rate_scale"]),
        Points(**{each.name: _array(document["points"][each.name]) for each in fields(Points)}),
        _array(document["left_V"]),
        _array(document["unseen_V"]),
        float(document["noise_V2"]),
        float(document["own_V2"]),
    )


def _lacks(document: dict[str, Any]) -> Lacks:
    if document["schema_version"] <= _WITHOUT_LACKS:
        return NOTHING_LACKS
    own = document["lacks"]
    return Lacks(tuple(str(name) for name in own["effects"]), _array(own["root"]), _array(own["follow"]))


def _array(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64)


def _short(values: FloatArray, digits: int = _DIGITS) -> Any:
    if values.ndim > 1:
        return [_short(row, digits) for row in values]
    return [float(f"{each:.{digits}g}") for each in values.tolist()]
