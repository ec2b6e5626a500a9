"""What an effect is: how it shows in a voltage or a temperature, and how its parameters are read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from models.data.timeseries import FloatArray
from models.effects.expected import Expected
from models.effects.reading import Assumption, InputCorrection, Values
from models.effects.thermal_view import ThermalView
from models.effects.view import ReferenceTerm, View
from models.effects.ways_in import WayIn
from models.network.signals import parse_signal
from models.network.structure import Structure

Regressors = Callable[[View], FloatArray]
# What the error of a model is drawn over, `comparison.profile`.
# What a change is estimated in, see `Effect.renews`: the current without delay, with its low-passes, the curve.
AT_ONCE = ("current", "scaled_current")
LINEAR = (*AT_ONCE, "low_pass", "squared_current")
CURVE = "ocv"
# What ages: charge that a cell holds, resistance at any state of charge, the open-circuit curve.
Life = Literal["capacity", "resistance", "curve"]
# What a capacity is lost by: lithium, or material of either electrode.
Cause = Literal["lithium", "negative", "positive"]
Variable = Literal["soc", "soc_at_rest", "since_step_s", "current_A", "throughput_Ah", "time_h", "temperature_degC"]


@dataclass(frozen=True)
class Parameter:
    """One physical parameter: its name with the unit as a suffix, the unit as printed, and what it means."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Shift:
    """An effect with one parameter whose change of voltage is simulated again, because first order is not enough.

    Attributes
    ----------
    voltage : (view, value) -> (m,) change of the model's voltage in V
    step : view -> size of a small value, for derivatives
    limits : view -> (low, high) values that are tried
    physical : (view, value) -> what a person is told, in the unit of the effect's first parameter
    soc : (view, value) -> (n,) state of charge that the effect makes of the counted one; None: it leaves it alone
    current_A : (view, value) -> (n,) current that truly warms the cell; None: the measured one
    searched : whether the steps start from the best of a grid; else from nothing
    of : what the name of the parameter is followed by, where an effect has several of them
    also : (view, value) -> values of the effect's further parameters, which go with the first
    """

    voltage: Callable[[View, float], FloatArray]
    step: Callable[[View], float]
    limits: Callable[[View], tuple[float, float]]
    physical: Callable[[View, float], float] = lambda _view, value: value
    soc: Callable[[View, float], FloatArray] | None = None
    current_A: Callable[[View, float], FloatArray] | None = None
    searched: bool = True
    of: str = ""
    also: Callable[[View, float], tuple[float, ...]] = lambda _view, _value: ()


@dataclass(frozen=True)
class Lean:
    """The smallest form of an effect with many regressors: one shape parameter on a grid, the rest linear.

    Attributes
    ----------
    columns : (view, shape) -> (m, j); the first belongs to the effect's first parameter
    shapes : view -> values of the shape parameter that are tried
    scale : what one unit of the first coefficient is in the unit of the first parameter
    largest : of the first coefficient alone, as far as physics goes; None: nothing is known
    possible : view -> largest size of the first coefficient that any cell shows; beyond it stands for something else
    """

    columns: Callable[[View, float], FloatArray]
    shapes: Callable[[View], tuple[float, ...]]
    scale: float = 1.0
    largest: float | None = None
    possible: Callable[[View], float] | None = None


@dataclass(frozen=True)
class Local:
    """An effect whose parameters are values of a curve over SoC that is linear in the regressors' coefficients.

    Attributes
    ----------
    size : number of spline coefficients along the SoC
    scale : what one unit of the curve is in the unit of the parameter
    """

    size: int
    scale: float = 1.0


@dataclass(frozen=True)
class Warmth:
    """How an effect shows in the cell's temperature.

    Attributes
    ----------
    temperature : (view, values) -> (n,) temperature in degC for values of the parameters
    start : values that change nothing
    step : small values, for derivatives
    physical : (view, values) -> what a person is told
    moved : (view, values) -> the heat balance with the effect; None: it is none of the balance but of the reading
    least : values below which there is no such effect; none: any
    """

    temperature: Callable[[ThermalView, tuple[float, ...]], FloatArray]
    start: tuple[float, ...]
    step: tuple[float, ...]
    physical: Callable[[ThermalView, tuple[float, ...]], tuple[float, ...]]
    moved: Callable[[ThermalView, tuple[float, ...]], ThermalView] | None = None
    least: tuple[float, ...] = ()


@dataclass(frozen=True)
class Effect:
    """One physical effect: everything that the rest of the program knows of it.

    Attributes
    ----------
    name : as in the public contract, and of its file
    title : what a person calls it
    recognise : how a person recognises it in a record
    source : where the equation comes from
    parameters : the first one is the primary one
    shows_over : variables over which the error is drawn so that a person recognises it, as `error_profiles` names them:
        the first of them that a record has
    slow : it shows over hours only, so that an experiment for it has to be long
    regressors : how it shows in the voltage to first order, (m, k); None: it does not
    shift, lean, local : how the parameters are read from a record; at most one of them
    or_shifts : further ones of the same parameter, as likely as `shift`, of which a change is one alone
    warmth : how it shows in the temperature; None: it does not
    inner_heat_W : (n,) open-circuit voltage -> (n,) heat in the cell for a `shift` of 1, which no current at the
        terminals tells of; it is named where voltage and temperature ask for the same value. None: there is none
    heats_as : effect on the temperature by which the same cause shows, their first parameters being the same
    absorbed : a network that is refitted takes it in unseen, so that only a comparison with an earlier model shows it
    overpotential : it is a loss inside the cell, which warms it
    needs_temperature : it cannot be seen where the temperature is missing or does not move
    seen_in : views of runs -> whether these tell it from what a cell does anyway; None: it is seen in any runs
    twin : an effect that one log can hardly tell from it; one of the two has to say so
    like : effects that most runs can hardly tell from it: rivals where they explain nearly as much
    seems : pairs of other effects that stand for it in a cell whose electrodes nobody knows: it is their rival
    contains : effects that are special cases of this one
    part_of : effects that this one is a special case of: `contains`, said by the other
    reference_terms : terms of the diagnosis' reference model that stand for it; they are left out where it is sized
    activation_K : values of the parameters -> change of the activation temperature by which it scales every current,
        that of other effects as well; None: it scales none
    extend : (structure, values of the parameters, capacity in Ah) -> structure that has the effect; None: it is put in
        by `correction` or `assumption`, or by a refit alone
    bounded_part : part of a bounded network that stands for it; "": it is always in one; None: it cannot be
    renews : what of a bounded network a change of it is estimated in, beside that part: kinds of signals, or `CURVE`
    read_out : figure of a bounded network's `summary` that its first parameter is, and the share of it; None: none is
    ways_in : steps to a richer structure, tried beside `extend`
    correction : how it is put right in a run's columns; None: it is not in the sensors
    fault_V : (view, values of the parameters) -> (n,) voltage that it makes of a run now and then, or more and more,
        which no model can have: it is taken out of the runs that a network is refitted to. None: it is nothing of the
        kind
    assumption : how it is put right in what a fit is told; None: it is not in that
    expected : how large a change of it is to be expected
    life : what of a cell's life it stands for, where that is followed over many runs; None: it is nothing that ages
    causes : of a lost capacity that it stands for there
    """

    name: str
    title: str
    recognise: str
    source: str
    parameters: tuple[Parameter, ...]
    shows_over: tuple[Variable, ...] = ("soc",)
    slow: bool = False
    regressors: Regressors | None = None
    shift: Shift | None = None
    or_shifts: tuple[Shift, ...] = ()
    lean: Lean | None = None
    local: Local | None = None
    warmth: Warmth | None = None
    inner_heat_W: Callable[[FloatArray], FloatArray] | None = None
    heats_as: str | None = None
    absorbed: bool = False
    overpotential: bool = False
    needs_temperature: bool = False
    seen_in: Callable[[Sequence[View]], bool] | None = None
    twin: str | None = None
    like: tuple[str, ...] = ()
    seems: tuple[frozenset[str], ...] = ()
    contains: tuple[str, ...] = ()
    part_of: tuple[str, ...] = ()
    reference_terms: tuple[ReferenceTerm, ...] = ()
    activation_K: Callable[[Values], float] | None = None
    extend: Callable[[Structure, Values, float], Structure] | None = None
    bounded_part: str | None = None
    renews: tuple[str, ...] = ()
    read_out: tuple[str, float] | None = None
    ways_in: tuple[WayIn, ...] = ()
    correction: InputCorrection | None = None
    fault_V: Callable[[View, Values], FloatArray] | None = None
    assumption: Assumption | None = None
    expected: Expected = Expected()
    life: Life | None = None
    causes: tuple[Cause, ...] = ()

    def tells(self, views: Sequence[View]) -> bool:
        """Whether runs tell it from what a cell does anyway."""
        return self.seen_in is None or self.seen_in(views)

    @property
    def own_heat(self) -> bool:
        """Whether it shows in the temperature by more than the voltage that it makes lose."""
        return self.warmth is not None or self.inner_heat_W is not None or self.heats_as is not None

    @property
    def channel(self) -> Literal["voltage", "temperature"]:
        """Where it is looked for first."""
        return "voltage" if self.regressors is not None else "temperature"


def has_signal(structure: Structure, kind: str) -> bool:
    """Whether a structure has an input of a kind of signal, whatever its constants."""
    return any(parse_signal(channel.signal).kind == kind for channel in structure.inputs)
