"""Signals that a network takes in: state of charge, hysteresis, relaxation and their kin, one file for each kind.

A signal is named "kind" or "kind:p1/p2/...", for example "low_pass:600" or "surface_soc:0.05/400/3500". A kind is a
file of this package that holds a `KIND`; the package is listed, so a new file is all that a new kind needs. Files
without one hold what several kinds are made with.
"""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from models.data.errors import StructureError
from models.data.timeseries import FloatArray
from models.network.signals.charge_counting import soc_by_counting
from models.network.signals.direction import REST_C_RATE, held_sign
from models.network.signals.kind import Held, Parameter, Shared, Signal, SignalKind, Step
from models.network.signals.temperature_scale import KELVIN, REFERENCE_K, arrhenius

# Filters are imported from `filters` and the state of hysteresis from `direction`: kinds have files of these names.
__all__ = [
    "KELVIN",
    "REFERENCE_K",
    "REST_C_RATE",
    "Held",
    "Parameter",
    "RunSignals",
    "Signal",
    "SignalKind",
    "Step",
    "arrhenius",
    "held_sign",
    "is_soc",
    "parse_signal",
    "signal_kinds",
    "slower",
    "soc_by_counting",
]


@dataclass(frozen=True)
class RunSignals(Shared):
    """What signals of one run are made from, evenly spaced.

    Attributes
    ----------
    current_A, temperature_degC, soc : (n,)
    dt_s : sampling time
    capacity_Ah : cell capacity
    """

    current_A: FloatArray
    temperature_degC: FloatArray
    soc: FloatArray
    dt_s: float
    capacity_Ah: float

    def values(self, name: str) -> FloatArray:
        """(n,) values of a named signal in its physical unit.

        Raises
        ------
        StructureError
            The name is no signal's, or the signal needs a temperature and the run has none.
        """
        signal = parse_signal(name)
        if signal.depends_on_temperature and np.isnan(self.temperature_degC).all():
            raise StructureError(
                f"signal {name!r} needs a temperature, but none was measured: give that of the room as "
                "temperature_degC, or take a model fitted to runs without one"
            )
        return signal.definition.values(signal, self)


@cache
def signal_kinds() -> dict[str, SignalKind]:
    """All kinds of signals by name, in alphabetical order."""
    found: list[SignalKind] = []
    for module in pkgutil.iter_modules(__path__):
        candidate = getattr(importlib.import_module(f"{__name__}.{module.name}"), "KIND", None)
        if isinstance(candidate, SignalKind):
            found.append(candidate)
    return {each.name: each for each in sorted(found, key=lambda each: each.name)}


@lru_cache(maxsize=1024)
def parse_signal(name: str) -> Signal:
    """Take a signal's name apart.

    Raises
    ------
    StructureError
        Unknown kind, parameters missing, too many, not finite, or not positive where they must be.
    """
    kind, _, text = name.partition(":")
    definition = signal_kinds().get(kind)
    if definition is None:
        raise StructureError(f"signal {name!r} is unknown; known are {', '.join(signal_kinds())}")
    known = definition.parameters
    try:
        values = [float(part) for part in text.split("/")] if text else []
    except ValueError:
        raise StructureError(f"signal {name!r}: {text!r} is not a list of numbers") from None
    if not sum(not each.optional for each in known) <= len(values) <= len(known):
        names = "/".join(each.name for each in known)
        raise StructureError(f"signal {name!r}: {kind} takes {names or 'no parameters'}")
    for parameter, value in zip(known, values, strict=False):
        left_out = value == 0.0 and parameter.optional
        if not np.isfinite(value) or (parameter.positive and not value > 0.0 and not left_out):
            raise StructureError(f"signal {name!r}: {parameter.name} is {value:g}; it must be positive")
    return Signal(name, definition, {each.name: value for each, value in zip(known, values, strict=False)})


def slower(name: str, times: float) -> str:
    """Name of the signal where diffusion to the surface takes so many times as long; of any other one its own."""
    signal = parse_signal(name)
    if "depth" not in signal.parameters:
        return name
    # Settled differences go with the time of diffusion.
    moved = {key: signal.get(key) * times for key in ("depth", "time_constant_s")}
    return f"{signal.kind}:" + "/".join(f"{value:.6g}" for value in {**signal.parameters, **moved}.values())


def is_soc(name: str) -> bool:
    """Whether a signal is the state of charge plus something that does not depend on it."""
    kind = signal_kinds().get(name.partition(":")[0])
    return kind is not None and kind.soc
