"""All that an unsealed model's document is looked through for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from models.data.errors import ModelError, StructureError
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.meaning.agreement import check_domain, check_parts_agree, check_tables_agree, read_out_now
from models.pipeline.meaning.memory import check_memory
from models.pipeline.meaning.physics import check_runs, check_tables, check_voltages
from models.pipeline.meaning.quantities import check_quantities
from models.thermal.cell_temperature import thermal_of
from models.uncertainty.model_uncertainty import uncertainty_of

_DAMAGE = (ArithmeticError, AttributeError, IndexError, KeyError, MemoryError, TypeError, ValueError)
_KINDS: Mapping[str, type | tuple[type, ...]] = {
    "output_order": int,
    "order": int,
    "delay": int,
    "initial": int,
    "splittable": bool,
    "signal": str,
    "kernel": str,
    "name": str,
    "dt_s": (int, float),
    "k_sigma": (int, float),
}


def check_form(document: Mapping[str, Any]) -> None:
    """Refuse values of another kind in the structure, and quantities out of range; before anything is built of them.

    Raises
    ------
    StructureError
    """
    structure = document.get("structure")
    parts = structure if isinstance(structure, dict) else {}
    for part in (parts, *_objects(parts.get("inputs")), *_objects(parts.get("axes"))):
        for name, value in part.items():
            kind = _KINDS.get(name)
            if kind is not None and (not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool)):
                raise StructureError(f"model document is damaged: structure has {name} {value!r:.60}")
    check_quantities(document)


def check_meaning(network: LocalModelNetwork) -> None:
    """See whether a network is a cell that can be, and whether what its document says twice is the same.

    Raises
    ------
    ModelError
        It is not; one line that says where.
    """
    try:
        with np.errstate(all="ignore"):
            _check(network)
    except _DAMAGE as error:
        if isinstance(error, ModelError):
            raise
        raise StructureError(f"model document is damaged: it cannot be read out: {error!r:.100}") from error


def _check(network: LocalModelNetwork) -> None:
    check_voltages(network)
    check_domain(network)
    check_parts_agree(network)
    _check_uncertainty(network)
    _check_heat(network)
    ocv, resistance = read_out_now(network)
    check_tables_agree(network, ocv, resistance)
    tables = network.record.tables
    check_tables(network, ocv, resistance, tables is not None and bool(tables["resistance"]["reservations"]))
    check_runs(network)
    check_memory(network)


def _check_uncertainty(network: LocalModelNetwork) -> None:
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        return
    correlation = uncertainty.correlation
    whole = correlation.white + correlation.shares.sum()
    right = {
        "covariance_factor": np.isfinite(uncertainty.parameters.factor).all()
        and len(uncertainty.parameters.theta_factor) == network.theta.size,
        "correlation.shares": correlation.shares.shape == correlation.keep.shape and 0.5 < whole < 1.5,
        "local_models": (uncertainty.level_V > 0.0).all() and uncertainty.samples.sum() > 0.0,
    }
    if wrong := [name for name, is_right in right.items() if not is_right]:
        raise StructureError(f"model document is damaged: record.uncertainty.{wrong[0]} is none")


def _check_heat(network: LocalModelNetwork) -> None:
    found = thermal_of(network)
    if found is not None and not found[0].heat_transfer_W_per_K > 0.0:
        raise StructureError("model document is damaged: record.thermal: the cell gives no heat to the ambient")


def _objects(value: Any) -> list[dict[str, Any]]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []
