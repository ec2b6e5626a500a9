"""What a kind of signal says of itself, and what it is made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.loop_form import LoopForm


class Points(Protocol):
    """Current, temperature and state of charge, (n,) each: of a run, of held points or around a step."""

    @property
    def current_A(self) -> FloatArray:
        """(n,) positive charges."""
        ...

    @property
    def temperature_degC(self) -> FloatArray:
        """(n,)."""
        ...

    @property
    def soc(self) -> FloatArray:
        """(n,) fraction."""
        ...

    @property
    def capacity_Ah(self) -> float:
        """Cell capacity."""
        ...

    @property
    def driven(self) -> dict[tuple[float, float], FloatArray]:
        """What signals of the same constants take in of the current, kept by `driven.drive`."""
        ...


class Shared:
    """Remembers what several signals of the same points are made from."""

    @property
    def driven(self) -> dict[tuple[float, float], FloatArray]:
        """By activation in K and exchange current in A."""
        return self.__dict__.setdefault("_driven", {})


class Run(Points, Protocol):
    """The same, evenly spaced in time from a long rest on."""

    @property
    def dt_s(self) -> float:
        """Sampling time."""
        ...


@dataclass(frozen=True)
class Held(Shared):
    """Points at each of which everything has been held for ever.

    Attributes
    ----------
    current_A, temperature_degC, soc : (n,)
    direction : (n,) +1 after charge, -1 after discharge
    capacity_Ah : cell capacity
    """

    current_A: FloatArray
    temperature_degC: FloatArray
    soc: FloatArray
    direction: FloatArray
    capacity_Ah: float


@dataclass(frozen=True)
class Step(Shared):
    """Samples around a step of the current; before it everything has been held for ever.

    Attributes
    ----------
    current_A, temperature_degC, soc : (n,)
    direction : (n,) +1 after charge, -1 after discharge
    since : (n,) samples since the step, 0 before it
    dt_s : sampling time
    capacity_Ah : cell capacity
    """

    current_A: FloatArray
    temperature_degC: FloatArray
    soc: FloatArray
    direction: FloatArray
    since: np.ndarray
    dt_s: float
    capacity_Ah: float


@dataclass(frozen=True)
class Parameter:
    """One number after the colon of a signal's name.

    Attributes
    ----------
    name : with its unit
    unit : as a person reads it
    optional : it may be left out, and all after it; it is then 0
    positive : it must be positive; where it is optional, 0 is allowed too
    """

    name: str
    unit: str
    optional: bool = False
    positive: bool = True


@dataclass(frozen=True)
class SignalKind:
    """One kind of signal: everything that the program knows of it.

    Attributes
    ----------
    name : that of its file; what stands before the colon
    title : what it is, for a person
    example : a signal of this kind with all its parameters
    values : (n,) over a whole run, in its physical unit; this is its definition
    settled : (n,) where everything is held
    after_step : (n,) around a step of the current, from the settled value on
    loop : its row for the compiled loops, from sampling time in s and capacity in Ah; None where no form fits
    parameters : in the order in which they follow the colon. One that is named activation_K scales the current by
        temperature; where it is not 0, the signal needs a temperature
    soc : it is the state of charge plus something that does not depend on it
    of_temperature : it needs a temperature whatever its parameters
    as_resistance : its gain is taken for a resistance where a network is updated while it runs: it moves as a cell
        ages, and the signal is 0 at rest
    """

    name: str
    title: str
    example: str
    values: Callable[[Signal, Run], FloatArray]
    settled: Callable[[Signal, Held], FloatArray]
    after_step: Callable[[Signal, Step], FloatArray]
    loop: Callable[[Signal, float, float], LoopForm] | None
    parameters: tuple[Parameter, ...] = ()
    soc: bool = False
    of_temperature: bool = False
    as_resistance: bool = False


@dataclass(frozen=True)
class Signal:
    """One parsed signal name.

    Attributes
    ----------
    name : as it was given
    definition : its kind
    parameters : by name; those left out are missing
    """

    name: str
    definition: SignalKind
    parameters: dict[str, float]

    @property
    def kind(self) -> str:
        """Name of its kind."""
        return self.definition.name

    @property
    def depends_on_temperature(self) -> bool:
        """Whether its values change with the temperature."""
        return self.definition.of_temperature or self.get("activation_K") != 0.0

    def get(self, name: str) -> float:
        """Value of a parameter; 0 where it was left out or the kind has none of that name."""
        return self.parameters.get(name, 0.0)
