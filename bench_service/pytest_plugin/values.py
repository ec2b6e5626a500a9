"""What an emulated bench is made of, and what a run on it gave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class EmulatedCell:
    """Which cell there is; units are in the names, `effects` by their public names."""

    cell: str = "nmc"
    capacity_Ah: float | None = None
    initial_soc: float = 0.5
    ambient_degC: float = 25.0
    effects: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class EmulatedRun:
    """What a played profile gave: arrays of equal length, and how it ended.

    `state` is "completed" or "fault"; `code` and `reason` name the cause; `at_rest` says whether the cycler has
    confirmed rest. `flags` holds the quality of each sample (`bench_service.streams.Flag`), 0 is good.
    """

    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
    sequence: np.ndarray
    flags: np.ndarray
    state: str
    code: str
    reason: str | None
    at_rest: bool
