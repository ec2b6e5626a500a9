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

from models.structure import InputChannel, PartitionAxis, Structure

_TIME_CONSTANTS_S = (
    (3.0, 20.0, 100.0, 600.0, 3000.0),
    (2.0, 10.0, 60.0, 400.0),
    (4.0, 40.0, 400.0),
    (2.0, 8.0, 30.0, 120.0, 500.0, 2000.0),
)
_ACTIVATION_K = (0.0, 1500.0, 2500.0, 3500.0, 5000.0)
_EXCHANGE_C_RATE = (None, 0.2, 0.6, 2.0, 6.0)
_SURFACE_DEPTH = (0.01, 0.025, 0.05, 0.1)
_SURFACE_S = (100.0, 400.0, 1500.0)
_HYSTERESIS_RATES = ((), (10.0,), (40.0,), (150.0,), (20.0, 100.0))
_SOC_K_SIGMA = (0.5, 0.7, 1.0)
_SIZES = (8, 12, 16, 24, 32)
# Temperatures that differ by less than this cannot show what temperature does.
_TEMPERATURE_RANGE_K = 3.0


@dataclass(frozen=True)
class AutoCandidate:
    """One set of choices.

    Attributes
    ----------
    capacity_Ah : of the cell; C-rates below refer to it
    time_constants_s : of the low-passes of the current
    activation_K : scaling of the current by temperature; 0: none
    unscaled : whether the low-passes of the unscaled current are there too
    entropic : whether temperature is an input of its own
    exchange_c_rate : exchange current of the charge-transfer term as a C-rate; None: no such term
    surface : (depth, time constant in s) of the surface's state of charge; None: the mean one is used
    hysteresis_rates : of one-state hysteresis inputs
    direction : whether the current's held sign partitions
    temperature_parts : parts of the temperature axis; 0: no such axis
    soc_k_sigma : sharpness along the SoC
    n_models : number of local models asked for
    """

    capacity_Ah: float
    time_constants_s: tuple[float, ...] = _TIME_CONSTANTS_S[0]
    activation_K: float = 0.0
    unscaled: bool = False
    entropic: bool = False
    exchange_c_rate: float | None = None
    surface: tuple[float, float] | None = None
    hysteresis_rates: tuple[float, ...] = ()
    direction: bool = False
    temperature_parts: int = 0
    soc_k_sigma: float = 0.7
    n_models: int = 16

    @property
    def poles_s(self) -> tuple[float, ...]:
        """No output feedback."""
        return ()

    def structure(self, dt_s: float) -> Structure:
        """Build the structure that these choices stand for."""
        soc = "soc" if self.surface is None else f"surface_soc:{self.surface[0]:g}/{self.surface[1]:g}"
        if self.surface is not None and self.activation_K:
            soc += f"/{self.activation_K:g}"
        axes = [PartitionAxis(soc, k_sigma=self.soc_k_sigma)]
        if self.direction:
            axes.append(PartitionAxis("hysteresis", initial=2, splittable=False, k_sigma=0.25))
        if self.temperature_parts:
            axes.append(
                PartitionAxis("inverse_temperature", initial=self.temperature_parts, splittable=False, k_sigma=1.0)
            )
        inputs = [InputChannel(soc, delay=1), *(InputChannel(name) for name in self._overvoltage(dt_s))]
        return Structure(0, tuple(inputs), tuple(axes), dt_s, name="auto")

    def _overvoltage(self, dt_s: float) -> Iterator[str]:
        constants = [tau for tau in self.time_constants_s if tau >= 1.5 * dt_s]
        if self.activation_K:
            yield f"scaled_current:{self.activation_K:g}"
            yield from (f"low_pass:{tau:g}/{self.activation_K:g}" for tau in constants)
        if not self.activation_K or self.unscaled:
            yield "current"
            yield from (f"low_pass:{tau:g}" for tau in constants)
        if self.exchange_c_rate is not None:
            exchange = f"charge_transfer:{self.exchange_c_rate * self.capacity_Ah:g}/{self.activation_K:g}"
            yield exchange
            yield f"{exchange}/20"
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
        parts += ["hysteresis"] if self.hysteresis_rates or self.direction else []
        return ", ".join(parts)


def first_candidate(capacity_Ah: float, temperature_range_K: float) -> AutoCandidate:
    """Where the search begins: with what nearly every lithium-ion cell shows; the data may take it away again."""
    return AutoCandidate(
        capacity_Ah,
        activation_K=2500.0 if temperature_range_K >= _TEMPERATURE_RANGE_K else 0.0,
        exchange_c_rate=0.6,
        surface=(0.05, 100.0),
    )


def alternatives(best: AutoCandidate, temperature_range_K: float, stage: int) -> list[AutoCandidate]:
    """What is tried next to `best` in one stage of the search; an empty list ends a pass."""
    warm = temperature_range_K >= _TEMPERATURE_RANGE_K
    stages = (
        lambda: [replace(best, n_models=size) for size in _SIZES],
        lambda: [replace(best, time_constants_s=taus) for taus in _TIME_CONSTANTS_S],
        lambda: [replace(best, activation_K=k) for k in _ACTIVATION_K] if warm else [best],
        lambda: [replace(best, exchange_c_rate=rate) for rate in _EXCHANGE_C_RATE],
        lambda: [
            replace(best, surface=None),
            *(replace(best, surface=(d, s)) for d in _SURFACE_DEPTH for s in _SURFACE_S),
        ],
        lambda: [replace(best, entropic=not best.entropic)] if warm else [best],
        lambda: [replace(best, unscaled=not best.unscaled)] if best.activation_K else [best],
        lambda: [replace(best, hysteresis_rates=rates) for rates in _HYSTERESIS_RATES],
        lambda: [replace(best, direction=not best.direction)],
        lambda: [replace(best, temperature_parts=parts) for parts in (0, 2, 3)] if warm else [best],
        lambda: [replace(best, soc_k_sigma=k) for k in _SOC_K_SIGMA],
        lambda: [replace(best, n_models=size) for size in _SIZES],
    )
    return stages[stage]() if stage < len(stages) else []
