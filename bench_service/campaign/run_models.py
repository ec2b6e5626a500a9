"""The model whose band a run's voltage must not leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench_service.bench.request import BandOrder
from bench_service.store.models import ModelTable

_ROOM_DEGC = 25.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BandWish:
    """A model whose band the voltage must not leave by more than a margin for longer than a time."""

    model_id: str
    margin_V: float = 0.05
    for_s: float = 30.0


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
