"""How a signal is made sample by sample: its row in the arrays that the compiled loops read.

The loops (`compiled_network.step_signals`, the observer's `running_inputs.move_on`, the design's `signal_path`) know no
kinds of signals, only the forms below. A kind whose equations fit none of them has no form: it is made over whole runs
only, and what needs a loop refuses it. Compiled functions (njit) take the constants in as they are.

=====================  ================================================================================================
form                   value of the signal
=====================  ================================================================================================
DRIVEN                 current, times exp(activation (1/T - 1/298.15 K)), asinh(. / exchange) where there is an
                       exchange current, bent as `entry` says, through a first-order low-pass (`poles[0]`; 0: none),
                       bent as `result` says
CASCADE                the current's change through three low-passes one after the other (`poles`), over 1 - poles[0]
LOOP                   h = e h + (1 - e) sign(current), e = exp(-factor |current|): between -1 and 1, starting at 0
DIRECTION              +1 after charge, -1 after discharge, held through rests
TEMPERATURE            degC, beyond `poles[0]` to `poles[1]` ever less (`temperature_scale.within_degC`)
INVERSE_TEMPERATURE    1/K
SOC                    state of charge; where `factor` is not 0, plus factor times the current, scaled by temperature,
                       through the modes of diffusion in a sphere (`poles` holds their rates per sample at 25 degC),
                       and where `exchange_A` is not 0 the slower the emptier it is (`filters.slower_at`)
DIFFUSION              what SOC adds to the state of charge alone, at most `filters.FURTHEST_BEHIND` either way
=====================  ================================================================================================
"""

from __future__ import annotations

from typing import NamedTuple

CASCADE, LOOP, DIRECTION, TEMPERATURE, INVERSE_TEMPERATURE, SOC, DIFFUSION = range(7)
# How DRIVEN bends what it is given: x, x|x|, |x|, x^2, and x where it charges or discharges, else 0. The result is bent
# in the first two ways only: from them the design's gradient reads back what was bent.
AS_IS, SIGNED_SQUARE, MAGNITUDE, SQUARE, CHARGE, DISCHARGE = range(6)
# The loops read form and bends as one whole number (each array that they are handed costs a live step time): DRIVEN and
# above is driven, the lowest three bits are the entry's bend, the next one is a squared result.
ENTRY_BITS, SQUARED_BIT, DRIVEN = 7, 8, 16


class LoopForm(NamedTuple):
    """One signal as data for the compiled loops.

    Attributes
    ----------
    form : one of those in the table
    entry : how DRIVEN bends what enters its low-pass
    result : how DRIVEN bends what leaves it, AS_IS or SIGNED_SQUARE
    poles : of the filter's stages, 0 where there is none; of a diffusion: rates of its modes; of a temperature: what it
        is taken as it is between
    activation_K : scaling of the current by temperature; 0: none
    exchange_A : scale of asinh; 0: none; of a diffusion in its place how many times its time more it takes at empty
    factor : of a diffusion per ampere, or of LOOP per ampere and sample
    """

    form: int
    entry: int = AS_IS
    result: int = AS_IS
    poles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    activation_K: float = 0.0
    exchange_A: float = 0.0
    factor: float = 0.0

    @property
    def code(self) -> int:
        """Form and bends as the loops read them."""
        return self.form + self.entry + (SQUARED_BIT if self.result == SIGNED_SQUARE else 0)


def is_overpotential(code: int) -> bool:
    """Whether a signal is what the current does beyond counting charge and turning a loop: 0 after a long rest.

    What a mean is behind a surface is none: it takes back a part of the curve, and no resistance.
    """
    return code == CASCADE or code >= DRIVEN
