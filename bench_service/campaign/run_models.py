"""The models that a run works with: its observer's, and that whose band its voltage must not leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench_service.bench.request import BandOrder, ObserverOrder
from bench_service.store.models import ModelTable

_ROOM_DEGC = 25.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BandWish:
    """A model whose band the voltage must not leave by more than a margin for longer than a time."""

    model_id: str
    margin_V: float = 0.05
    for_s: float = 30.0


def observer_order(models: ModelTable, model_id: str | None, initial_soc: float) -> ObserverOrder | None:
    """Return the order for a live observer; raises `NotFoundError`."""
    if model_id is None:
        return None
    return ObserverOrder(model=models.document(model_id), settings={"initial_soc": initial_soc})


def band_order(models: ModelTable, wish: BandWish | None, live: Mapping[str, Any] | None) -> BandOrder | None:
    """Return the order for a band, with temperature and voltage that the cell has now; raises `NotFoundError`."""
    if wish is None:
        return None
    measured = (live or {}).get("temperature_degC")
    return BandOrder(
        model=models.document(wish.model_id),
        temperature_degC=_ROOM_DEGC if measured is None else float(measured),
        voltage_V=(live or {}).get("voltage_V"),
        margin_V=wish.margin_V,
        for_s=wish.for_s,
    )
