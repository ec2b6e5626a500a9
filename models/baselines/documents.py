"""Reading the documents of baselines: what is wrong with one is said in one clear line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from models.data.errors import StructureError
from models.data.timeseries import FloatArray
from models.network.regression import CellContext


def check_kind(document: Any, kind: str, schema_version: int) -> None:
    """Refuse a document of another kind or schema version."""
    if not isinstance(document, dict) or document.get("kind") != kind:
        raise StructureError(f"not a model document of this kind: its 'kind' must be {kind!r}")
    if document.get("schema_version") != schema_version:
        raise StructureError(
            f"model document has schema version {document.get('schema_version')!r}; {schema_version} is supported"
        )


@contextmanager
def reading(kind: str) -> Iterator[None]:
    """Turn what goes wrong in reading a damaged document into a StructureError."""
    try:
        yield
    except StructureError as error:
        raise StructureError(f"{kind} document is damaged: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise StructureError(f"{kind} document is damaged: {error!r}") from None


def array(values: Any) -> FloatArray:
    """Finite numbers of a document as an array."""
    out = np.array(values, dtype=np.float64)
    if not np.isfinite(out).all():
        raise StructureError("a parameter is not finite")
    return out


def read_step_s(document: dict[str, Any]) -> float:
    """Grid step of a document in s."""
    step_s = float(document["dt_s"])
    if not (np.isfinite(step_s) and step_s > 0.0):
        raise StructureError(f"grid step {step_s:g} s must be positive and finite")
    return step_s


def read_cell(document: dict[str, Any]) -> CellContext:
    """Capacity and efficiency of a document."""
    cell = CellContext(float(document["cell"]["capacity_Ah"]), float(document["cell"]["efficiency"]))
    if not (np.isfinite([cell.capacity_Ah, cell.efficiency]).all() and cell.capacity_Ah > 0.0):
        raise StructureError(f"capacity {cell.capacity_Ah:g} Ah must be positive and finite")
    return cell
