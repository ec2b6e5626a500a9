"""Requests as users write them: the keys of the public contract, checked one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.design.constraints.limits import Limits, Window
from models.design.information.criteria import CRITERIA
from models.design.optimise.block_design import OPTIMAL
from models.design.sequence.sequence_plan import REST_RATIO
from models.design.test_signals import find_families

DISCRIMINATE = "discriminate"
LIMIT_NAMES = ("current_A", "voltage_V", "temperature_degC", "soc", "ramp_A_per_s", "net_charge_Ah")
_KEYS = (
    "model",
    "runs",
    "capacity_Ah",
    "initial_soc",
    "duration_s",
    "dt_s",
    "criterion",
    "signal",
    "limits",
    "load_cycle",
    "soc_levels",
    "rest_ratio",
    "final_rest_s",
    "target_std",
    "rivals",
    "seed",
)
# Levels given as a number lie in the middle of as many equal parts of the window, but no further from its ends than
# this share of it.
_LEVEL_MARGIN = 0.1
_MOST_LEVELS = 50
_MOST_SAMPLES = 200_000


class RequestError(ModelError):
    """A request that cannot be read; the message names the key, its value and what is needed."""


@dataclass(frozen=True)
class WrittenRequest:
    """A request as it was written, every value checked.

    Attributes
    ----------
    limits, duration_s, criterion, signal, soc_levels, rest_ratio, final_rest_s, target_std, seed : see `DesignRequest`
    capacity_Ah, dt_s, initial_soc : None where not given
    model, load_cycle : names of files or stored things, None where not given
    runs, rivals : the same, empty where not given
    """

    limits: Limits
    duration_s: float
    criterion: str
    signal: str
    soc_levels: tuple[float, ...]
    rest_ratio: float
    final_rest_s: float | None
    target_std: float | None
    seed: int
    capacity_Ah: float | None = None
    dt_s: float | None = None
    initial_soc: float | None = None
    model: str | None = None
    load_cycle: str | None = None
    runs: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()


def read_request(document: Mapping[str, Any]) -> WrittenRequest:
    """Check a request.

    Raises
    ------
    RequestError
        An unknown key, a missing one, or a value of the wrong kind.
    InfeasibleError
        Limits that contradict themselves.
    """
    _known(document, _KEYS, "request")
    limits = _limits(document.get("limits"))
    duration_s, dt_s = _number(document, "duration_s", "s"), _optional(document, "dt_s", "s")
    if dt_s is not None and not dt_s > 0.0:
        raise RequestError(f"dt_s is {dt_s:g} s; it must be positive")
    if dt_s is not None and duration_s / dt_s > _MOST_SAMPLES:
        raise RequestError(
            f"duration_s is {duration_s:g} s, {duration_s / dt_s:.0f} samples; at most {_MOST_SAMPLES} are designed"
        )
    capacity_Ah = _optional(document, "capacity_Ah", "Ah")
    if capacity_Ah is not None and not capacity_Ah > 0.0:
        raise RequestError(f"capacity_Ah is {capacity_Ah:g} Ah; it must be positive")
    rest_ratio, target_std = _optional(document, "rest_ratio", ""), _optional(document, "target_std", "")
    criterion = _choice(document, "criterion", "D", (*CRITERIA, DISCRIMINATE))
    signal = _choice(document, "signal", OPTIMAL, (OPTIMAL, *find_families()))
    if target_std is not None and (criterion == DISCRIMINATE or signal != OPTIMAL):
        raise RequestError(
            f"target_std ends a designed sequence early, but criterion {criterion!r} with signal {signal!r} makes none"
        )
    return WrittenRequest(
        limits=limits,
        duration_s=duration_s,
        criterion=criterion,
        signal=signal,
        soc_levels=_levels(document.get("soc_levels"), limits.soc),
        rest_ratio=REST_RATIO if rest_ratio is None else rest_ratio,
        final_rest_s=_optional(document, "final_rest_s", "s"),
        target_std=target_std,
        seed=_whole(document, "seed"),
        capacity_Ah=capacity_Ah,
        dt_s=dt_s,
        initial_soc=_optional(document, "initial_soc", ""),
        model=_text(document, "model"),
        load_cycle=_text(document, "load_cycle"),
        runs=_texts(document, "runs"),
        rivals=_texts(document, "rivals"),
    )


def _known(document: Mapping[str, Any], keys: tuple[str, ...], what: str) -> None:
    if not isinstance(document, Mapping):
        raise RequestError(f"{what}: a table of keys is needed")
    unknown = [key for key in document if key not in keys]
    if unknown:
        raise RequestError(f"{what}: {unknown[0]!r} is unknown; known are {', '.join(keys)}")


def _limits(table: Any) -> Limits:
    if table is None:
        raise RequestError("limits are missing: at least current_A = [low, high] in A is needed")
    _known(table, LIMIT_NAMES, "limits")
    if "current_A" not in table:
        raise RequestError("limits.current_A is missing: the largest discharge (negative) and charge current in A")
    return Limits(**{name: _window(f"limits.{name}", table[name]) for name in table})


def _window(name: str, value: Any) -> Window:
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(_is_number(part) for part in value):
        raise RequestError(f"{name} is {value!r}; two numbers [low, high] are needed")
    return float(value[0]), float(value[1])


def _levels(value: Any, window: Window) -> tuple[float, ...]:
    """Levels as they are, or as many evenly over the window."""
    if value is None:
        return ()
    if isinstance(value, int) and not isinstance(value, bool):
        if not 0 <= value <= _MOST_LEVELS:
            raise RequestError(f"soc_levels is {value}; 0 to {_MOST_LEVELS} levels are possible")
        edge = min(_LEVEL_MARGIN, 0.5 / max(value, 1)) * (window[1] - window[0])
        spread = np.linspace(window[0] + edge, window[1] - edge, value) if value != 1 else [0.5 * sum(window)]
        return tuple(float(level) for level in spread)
    if not isinstance(value, list | tuple) or len(value) > _MOST_LEVELS or not all(_is_number(part) for part in value):
        raise RequestError(f"soc_levels is {value!r}; a number of levels, or a list of states of charge, is needed")
    return tuple(float(part) for part in value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _optional(document: Mapping[str, Any], key: str, unit: str) -> float | None:
    return None if document.get(key) is None else _number(document, key, unit)


def _number(document: Mapping[str, Any], key: str, unit: str) -> float:
    value = document.get(key)
    if not _is_number(value):
        shown = "missing" if value is None else f"{value!r}"
        raise RequestError(f"{key} is {shown}; a finite number{f' in {unit}' if unit else ''} is needed")
    return float(value)  # pyright: ignore[reportArgumentType]  # checked above


def _whole(document: Mapping[str, Any], key: str) -> int:
    value = document.get(key, 0)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**32:
        raise RequestError(f"{key} is {value!r}; a whole number from 0 to {2**32 - 1} is needed")
    return value


def _choice(document: Mapping[str, Any], key: str, default: str, known: tuple[str, ...]) -> str:
    value = document.get(key, default)
    if value not in known:
        raise RequestError(f"{key} is {value!r}; use one of {', '.join(known)}")
    return value


def _text(document: Mapping[str, Any], key: str) -> str | None:
    value = document.get(key)
    if value is not None and (not isinstance(value, str) or not value):
        raise RequestError(f"{key} is {value!r}; a name is needed")
    return value


def _texts(document: Mapping[str, Any], key: str) -> tuple[str, ...]:
    value = document.get(key, ())
    if not isinstance(value, list | tuple) or not all(isinstance(part, str) and part for part in value):
        raise RequestError(f"{key} is {value!r}; a list of names is needed")
    return tuple(value)
