"""Open-circuit voltage of the simulated cells as smooth, strictly rising functions of the state of charge.

The curves are parametric and belong to this project. They are shaped after typical values of the chemistry, not
after one cell's record:

- NMC against graphite: 3.0 V empty, about 3.7 V at half charge, 4.19 V full, as 18650 power cells of 2.5 Ah show
  (data sheet of the Samsung INR18650-25R).
- LFP against graphite: two plateaus near 3.29 V and 3.34 V that rise by about 0.1 V per 100 %, joined by the step
  of graphite's stage transition near 0.7 (data sheet of the A123 ANR26650M1B; Dreyer et al., Nature Materials 9,
  2010, for the plateau).
- Ni-MH: 1.05 V empty, about 1.3 V at half charge, 1.4 V full at rest (data sheet of the Panasonic BK-3MCCE).
"""

import math
from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["OPEN_CIRCUIT_CURVES", "OpenCircuitCurve", "Step", "Tail"]


@dataclass(frozen=True, slots=True)
class Tail:
    """An exponential end of the curve, `height_V` at the end itself and 1/e of it one `width` away."""

    height_V: float
    width: float


@dataclass(frozen=True, slots=True)
class Step:
    """A sigmoid rise of `height_V` around the state of charge `centre`; slope height / (4 width) there."""

    height_V: float
    centre: float
    width: float


@dataclass(frozen=True, slots=True)
class OpenCircuitCurve:
    """Open-circuit voltage in volt over state of charge (fraction).

    A sum of terms that each rise with the state of charge, so the whole is monotone by construction:
    base + slope * soc + steps - tails at the empty end + tails at the full end. Outside 0..1 it goes on as the
    straight line of its end slope, because an exponential tail would reach absurd voltages there.

    Attributes
    ----------
    base_V : float
        Voltage at `soc` 0 without the tails.
    slope_V : float
        Volt per full charge of the straight part; positive.
    steps, empty_tails, full_tails : tuple
        Rising terms, heights and widths all positive.
    """

    base_V: float
    slope_V: float
    steps: tuple[Step, ...]
    empty_tails: tuple[Tail, ...]
    full_tails: tuple[Tail, ...]

    def __post_init__(self) -> None:
        """Reject terms that would let the curve fall.

        Raises
        ------
        ValueError
            If the slope, a height or a width is not positive.
        """
        terms = (*self.steps, *self.empty_tails, *self.full_tails)
        if self.slope_V <= 0 or any(term.height_V <= 0 or term.width <= 0 for term in terms):
            raise ValueError("open-circuit curve: slope, heights and widths must be positive, or the curve falls")

    def voltage_V(self, soc: float) -> float:
        """Return the open-circuit voltage in volt at a state of charge."""
        if soc < 0.0:
            return self._inside_V(0.0) + soc * self.slope_at_V(0.0)
        if soc > 1.0:
            return self._inside_V(1.0) + (soc - 1.0) * self.slope_at_V(1.0)
        return self._inside_V(soc)

    def slope_at_V(self, soc: float) -> float:
        """Return the slope of the curve in volt per full charge; that of the nearer end outside 0..1."""
        soc = min(max(soc, 0.0), 1.0)
        slope = self.slope_V
        for step in self.steps:
            slope += step.height_V / (4 * step.width * math.cosh((soc - step.centre) / (2 * step.width)) ** 2)
        for tail in self.empty_tails:
            slope += tail.height_V / tail.width * math.exp(-soc / tail.width)
        for tail in self.full_tails:
            slope += tail.height_V / tail.width * math.exp((soc - 1.0) / tail.width)
        return slope

    def aged(self, lithium_lost: float = 0.0, negative_lost: float = 0.0) -> "OpenCircuitCurve":
        """Return the curve of a cell whose electrodes have slipped, or of which the negative one has shrunk.

        Steps and the empty tail are the negative electrode's, slope and the full tails the positive one's. With a
        share d of the lithium gone the negative electrode is empty where d of the positive one's charge has passed;
        charge is counted over what is left, 1 - d. With a share m of the negative material gone, its steps come after
        1 - m of the charge.

        Parameters
        ----------
        lithium_lost : float
            Over the fresh capacity, below 1.
        negative_lost : float
            Share of the negative material, below 1, lost empty of lithium.
        """
        left = 1.0 - lithium_lost
        closer = (1.0 - negative_lost) / left
        return OpenCircuitCurve(
            base_V=self.base_V + self.slope_V * lithium_lost,
            slope_V=self.slope_V * left,
            steps=tuple(Step(each.height_V, each.centre * closer, each.width * closer) for each in self.steps),
            empty_tails=tuple(Tail(each.height_V, each.width * closer) for each in self.empty_tails),
            full_tails=tuple(Tail(each.height_V, each.width / left) for each in self.full_tails),
        )

    def _inside_V(self, soc: float) -> float:
        voltage = self.base_V + self.slope_V * soc
        for step in self.steps:
            voltage += 0.5 * step.height_V * (1.0 + math.tanh((soc - step.centre) / (2 * step.width)))
        for tail in self.empty_tails:
            voltage -= tail.height_V * math.exp(-soc / tail.width)
        for tail in self.full_tails:
            voltage += tail.height_V * math.exp((soc - 1.0) / tail.width)
        return voltage


OPEN_CIRCUIT_CURVES: MappingProxyType[str, OpenCircuitCurve] = MappingProxyType(
    {
        "nmc": OpenCircuitCurve(
            base_V=3.457,
            slope_V=0.454,
            steps=(Step(0.086, 0.623, 0.046),),
            empty_tails=(Tail(0.457, 0.047),),
            full_tails=(Tail(0.193, 0.21),),
        ),
        "lfp": OpenCircuitCurve(
            base_V=3.201,
            slope_V=0.09,
            steps=(Step(0.052, 0.234, 0.036), Step(0.0175, 0.684, 0.0147)),
            empty_tails=(Tail(0.50, 0.0255),),
            full_tails=(Tail(0.07, 0.011),),
        ),
        "nimh": OpenCircuitCurve(
            base_V=1.2565,
            slope_V=0.0833,
            steps=(),
            empty_tails=(Tail(0.082, 0.0165), Tail(0.124, 0.070)),
            full_tails=(Tail(0.060, 0.0706),),
        ),
    }
)
