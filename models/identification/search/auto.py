"""`--structure auto`: inputs and partition chosen from the data, without output feedback.

The overvoltage is made of low-passes of the current, so that the free run has no memory of its own errors and the fit
is linear throughout. Offered are: time constants, the temperature's effect on resistance (Arrhenius scaling of the
current), a charge-transfer term, the open-circuit voltage's change with temperature, diffusion (open-circuit voltage at
the surface's state of charge instead of the mean one), one-state hysteresis, and direction and temperature as partition
variables.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from models.identification.search.temperature_parts import temperature_parts
from models.network.regression import SignalBank
from models.network.structure import InputChannel, PartitionAxis, Structure

_TIME_CONSTANTS_S = (
    (3.0, 20.0, 100.0, 600.0, 3000.0),
    (3.0, 20.0, 100.0, 600.0),
    (2.0, 10.0, 60.0, 400.0),
    (4.0, 40.0, 400.0),
    (2.0, 8.0, 30.0, 120.0, 500.0, 2000.0),
    (2.0, 8.0, 30.0, 120.0, 500.0),
)
_ACTIVATION_K = (0.0, 1500.0, 2500.0, 3500.0, 5000.0)
# Activations of a part of the resistance beside one that temperature does not move, and of one more part.
_PART_ACTIVATION_K = (4000.0, 7000.0, 11000.0)
_SECOND_ACTIVATION_K = (2500.0, 7500.0)
_EXCHANGE_C_RATE = (None, 0.02, 0.2, 0.6, 2.0, 6.0)
_SURFACE_DEPTH = (0.02, 0.05, 0.1)
_SURFACE_S = (100.0, 400.0, 1500.0, 4000.0)
_SURFACE_ACTIVATION_K = (2500.0, 4000.0, 6000.0)
_SQUARED_S = (30.0, 100.0)
_HYSTERESIS_RATES = ((), (10.0,), (40.0,), (150.0,), (20.0, 100.0))
_SOC_K_SIGMA = (0.5, 0.7, 1.0)
_TEMPERATURE_K_SIGMA = (0.7, 1.0, 1.5, 2.0)
_SIZES = (8, 12, 16, 24, 32, 48)
# Low-passes that are held against the state of charge; of what is offered at most this share may be a function of it.
_SLOW_S = (3000.0, 2000.0, 1500.0, 1000.0, 600.0, 400.0, 200.0, 100.0)
_LARGEST_SHARE = 0.5
_LARGEST_FITTED_SHARE = 0.7
# How far towards its ends, at 1 and -1, a hysteresis must move.
_LEAST_SIDE = 0.5
_SOC_PIECES = 24
# Temperatures that differ by less than this cannot show what temperature does.
_TEMPERATURE_RANGE_K = 3.0
# Over fewer kelvin one activation serves as well as several, which then differ only where nothing was measured.
_PARTS_RANGE_K = 15.0


@dataclass(frozen=True)
class AutoCandidate:
    """One set of choices.

    Attributes
    ----------
    capacity_Ah : of the cell; C-rates below refer to it
    time_constants_s : of the low-passes of the current
    activation_K : scaling of the current by temperature; 0: none
    unscaled : whether the low-passes of the unscaled current are there too
    second_activation_K : of one more set of low-passes; 0: none
    entropic : whether temperature is an input of its own
    exchange_c_rate : exchange current of the charge-transfer term as a C-rate; None: no such term
    surface : (depth, time constant in s, activation in K) of the surface's state of charge; None: the mean one
    squared : (time constant in s, activation in K) of a term in the squared current; None: no such term
    hysteresis_rates : of one-state hysteresis inputs
    direction : whether the current's held sign partitions
    temperature_parts : parts of the temperature axis; 0: no such axis
    soc_k_sigma, temperature_k_sigma : sharpness along the two
    n_models : number of local models asked for
    """

    capacity_Ah: float
    time_constants_s: tuple[float, ...] = _TIME_CONSTANTS_S[0]
    activation_K: float = 0.0
    unscaled: bool = False
    second_activation_K: float = 0.0
    entropic: bool = False
    exchange_c_rate: float | None = None
    surface: tuple[float, float, float] | None = None
    squared: tuple[float, float] | None = None
    hysteresis_rates: tuple[float, ...] = ()
    direction: bool = False
    temperature_parts: int = 0
    soc_k_sigma: float = 0.7
    temperature_k_sigma: float = 1.0
    n_models: int = 16

    @property
    def poles_s(self) -> tuple[float, ...]:
        """No output feedback."""
        return ()

    def structure(self, dt_s: float) -> Structure:
        """Build the structure that these choices stand for."""
        soc = "soc" if self.surface is None else "surface_soc:" + "/".join(f"{part:g}" for part in self.surface)
        axes = [PartitionAxis(soc, k_sigma=self.soc_k_sigma)]
        if self.direction:
            axes.append(PartitionAxis("hysteresis", initial=2, splittable=False, k_sigma=0.25))
        if self.temperature_parts:
            parts, k_sigma = self.temperature_parts, self.temperature_k_sigma
            axes.append(PartitionAxis("inverse_temperature", initial=parts, splittable=False, k_sigma=k_sigma))
        inputs = [InputChannel(soc, delay=1), *(InputChannel(name) for name in self._overvoltage(dt_s))]
        return Structure(0, tuple(inputs), tuple(axes), dt_s, name="searched")

    def _overvoltage(self, dt_s: float) -> Iterator[str]:
        constants = [tau for tau in self.time_constants_s if tau >= 1.5 * dt_s]
        for scaling_K in dict.fromkeys((self.activation_K, self.second_activation_K)):
            if scaling_K:
                yield f"scaled_current:{scaling_K:g}"
                yield from (f"low_pass:{tau:g}/{scaling_K:g}" for tau in constants)
        if not self.activation_K or self.unscaled:
            yield "current"
            yield from (f"low_pass:{tau:g}" for tau in constants)
        if self.exchange_c_rate is not None:
            exchange = f"charge_transfer:{self.exchange_c_rate * self.capacity_Ah:g}/{self.activation_K:g}"
            yield exchange
            yield f"{exchange}/20"
        if self.squared is not None:
            yield "squared_current:" + "/".join(f"{part:g}" for part in self.squared)
        yield from (f"hysteresis_state:{rate:g}" for rate in self.hysteresis_rates)
        if self.entropic:
            yield "temperature"

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    def __str__(self) -> str:
        """Say in a few words what is tried."""
        parts = [f"{len(self.time_constants_s)} time constants", f"{self.n_models} local models"]
        parts += [f"activation {self.activation_K:g} K"] if self.activation_K else []
        parts += ["charge transfer"] if self.exchange_c_rate else []
        parts += ["surface SoC"] if self.surface else []
        parts += ["squared current"] if self.squared else []
        parts += ["hysteresis"] if self.hysteresis_rates or self.direction else []
        return ", ".join(parts)


@dataclass(frozen=True)
class Offer:
    """What the training runs can tell apart.

    Attributes
    ----------
    temperature_range_K : of all runs together; 0 where temperature is not known throughout
    longest_s : slowest low-pass of the current that is not nearly a function of the state of charge
    hysteresis_rates : sets of one-state hysteresis signals that the runs show, see `shows_hysteresis`
    temperature_parts : into how many parts temperature can be divided, each of them measured in
    """

    temperature_range_K: float
    longest_s: float
    hysteresis_rates: tuple[tuple[float, ...], ...]
    temperature_parts: int

    @property
    def warm(self) -> bool:
        """Whether the temperature varies enough to show what it does."""
        return self.temperature_range_K >= _TEMPERATURE_RANGE_K

    @property
    def several_activations(self) -> bool:
        """Whether it varies enough to show that parts of the resistance depend on it unlike each other."""
        return self.temperature_range_K >= _PARTS_RANGE_K


def find_offer(bank: SignalBank) -> Offer:
    """Find out which terms the runs can tell from the open-circuit curve."""
    known = np.concatenate([run.temperature_degC for run in bank.runs])
    apart = [tau_s for tau_s in _SLOW_S if share_of_soc(bank, f"low_pass:{tau_s:g}") <= _LARGEST_SHARE]
    every = sorted({rate for rates in _HYSTERESIS_RATES for rate in rates})
    rates = [rate for rate in every if shows_hysteresis(bank, rate)]
    return Offer(
        temperature_range_K=0.0 if np.isnan(known).any() else float(np.ptp(known)),
        longest_s=max(apart, default=_SLOW_S[-1]),
        hysteresis_rates=tuple(dict.fromkeys(tuple(r for r in found if r in rates) for found in _HYSTERESIS_RATES)),
        temperature_parts=temperature_parts(bank),
    )


def share_of_soc(bank: SignalBank, name: str) -> float:
    """Share of a signal's variance that is a function of the state of charge.

    Where every run discharges at much the same mean current, a slow low-pass or a slow hysteresis is nearly a function
    of the state of charge, and the open-circuit curve could be had from either: exact on such runs, and far off at
    another load.
    """
    soc, values = np.concatenate(bank.values("soc")), np.concatenate(bank.values(name))
    edges = np.linspace(soc.min(), soc.max(), _SOC_PIECES + 1)
    piece = np.clip(np.searchsorted(edges, soc, side="right") - 1, 0, _SOC_PIECES - 1)
    level = np.bincount(piece, values, _SOC_PIECES) / np.maximum(np.bincount(piece, minlength=_SOC_PIECES), 1)
    return 1.0 - float(np.mean((values - level[piece]) ** 2)) / max(float(np.var(values)), 1e-30)


def shows_hysteresis(bank: SignalBank, rate: float) -> bool:
    """Whether a one-state hysteresis moves to both sides and is not nearly a function of the state of charge.

    Runs that only ever discharge, with short charging pulses, leave it at one side: what it would take up there is the
    shape of those pulses, and their resistance would be missing in the rest of the model.
    """
    name = f"hysteresis_state:{rate:g}"
    values = np.concatenate(bank.values(name))
    if min(values.max(), -values.min()) < _LEAST_SIDE:
        return False
    return share_of_soc(bank, name) <= _LARGEST_SHARE


def stands_apart(candidate: AutoCandidate, bank: SignalBank) -> bool:
    """Whether the runs tell the slowest low-pass and the hysteresis of a candidate from the open-circuit curve.

    A candidate for which they do not is exact on these runs and far off at another load, see `share_of_soc`. A time
    constant that fits better than its neighbours may be a little closer to the curve than one that is offered.
    """
    slow = share_of_soc(bank, f"low_pass:{max(candidate.time_constants_s):g}") <= _LARGEST_FITTED_SHARE
    return slow and all(shows_hysteresis(bank, rate) for rate in candidate.hysteresis_rates)


def first_candidate(capacity_Ah: float, offer: Offer) -> AutoCandidate:
    """Where the search begins: with what nearly every lithium-ion cell shows; the data may take it away again."""
    warm = offer.warm
    return AutoCandidate(
        capacity_Ah,
        time_constants_s=_up_to(offer.longest_s)[0],
        activation_K=2500.0 if warm else 0.0,
        exchange_c_rate=0.6,
        surface=(0.05, 400.0, 2500.0 if warm else 0.0),
    )


def alternatives(best: AutoCandidate, offer: Offer, stage: int) -> list[AutoCandidate]:
    """What is tried next to `best` in one stage of the search; an empty list ends a pass.

    Parameters
    ----------
    best : the best candidate so far
    offer : what the training runs can tell apart
    stage : number of the stage
    """
    warm = offer.warm
    surface_K = _SURFACE_ACTIVATION_K if warm else (0.0,)
    parts = (0, *range(2, offer.temperature_parts + 1)) if warm else (0,)
    stages = (
        lambda: [replace(best, n_models=size) for size in _SIZES],
        lambda: [replace(best, temperature_parts=n, n_models=max(best.n_models, 8 * n)) for n in parts],
        lambda: [replace(best, time_constants_s=taus) for taus in _up_to(offer.longest_s)],
        lambda: [
            replace(best, surface=None),
            *(replace(best, surface=(d, s, surface_K[0])) for d in _SURFACE_DEPTH for s in _SURFACE_S),
        ],
        lambda: [replace(best, surface=(*best.surface[:2], k)) for k in surface_K] if best.surface else [],
        lambda: _activations(best, offer) if warm else [],
        lambda: [replace(best, exchange_c_rate=rate) for rate in _EXCHANGE_C_RATE],
        lambda: [
            replace(best, squared=None),
            *(replace(best, squared=(s, 3000.0 if warm else 0.0)) for s in _SQUARED_S),
        ],
        lambda: [replace(best, hysteresis_rates=rates) for rates in offer.hysteresis_rates],
        lambda: [replace(best, direction=not best.direction)],
        lambda: [replace(best, entropic=not best.entropic)] if warm else [],
        lambda: _parts(best) if best.activation_K and offer.several_activations else [],
        lambda: [replace(best, soc_k_sigma=k) for k in _SOC_K_SIGMA],
        lambda: [replace(best, temperature_k_sigma=k) for k in _TEMPERATURE_K_SIGMA] if best.temperature_parts else [],
        lambda: [replace(best, n_models=size) for size in _SIZES],
    )
    # A stage without a choice still counts: the present best stands for it.
    return (stages[stage]() or [best]) if stage < len(stages) else []


def _activations(best: AutoCandidate, offer: Offer) -> list[AutoCandidate]:
    """One activation for all resistances, or parts that temperature moves unlike, with the open-circuit voltage moving.

    These are tried together: a single resistance that rises with cold takes up what each of the others would show.
    """
    one = [replace(best, activation_K=k) for k in _ACTIVATION_K]
    if not offer.several_activations:
        return one
    apart = replace(best, unscaled=True, entropic=True)
    return [
        *one,
        *(replace(apart, activation_K=k) for k in _PART_ACTIVATION_K),
        replace(apart, activation_K=_SECOND_ACTIVATION_K[0], second_activation_K=_SECOND_ACTIVATION_K[1]),
    ]


def _parts(best: AutoCandidate) -> list[AutoCandidate]:
    """With or without a part that temperature does not move, and a second part that it moves."""
    second = [replace(best, second_activation_K=k) for k in (0.0, *_SECOND_ACTIVATION_K) if k != best.activation_K]
    return [replace(best, unscaled=not best.unscaled), *second]


def _up_to(longest_s: float) -> list[tuple[float, ...]]:
    """Sets of time constants without those that are too slow, each once; the largest first."""
    kept = [tuple(tau for tau in taus if tau <= longest_s) for taus in _TIME_CONSTANTS_S]
    return sorted(dict.fromkeys(taus for taus in kept if taus), key=len, reverse=True) or [_TIME_CONSTANTS_S[0][:1]]
