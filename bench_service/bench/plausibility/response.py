"""How the voltage answers to steps of the current: sign and size of the resistance.

A step of the current shows in the voltage of the same sample or, where the device measures the two one after the
other, of the next: ``dV_k = a dI_k + b dI_(k-1)``, by weighted least squares over the last few steps (older ones fade).
The resistance is ``a + b``. Nothing is said before its uncertainty is small enough, so small or too quick currents are
never judged. Of a record that begins under load nobody knows what still relaxes: its first change tells nothing, and
what may go on of it is uncertain in the later ones.
"""

import math
from dataclasses import dataclass, replace

from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.sample import Sample

# Noise of one difference of two voltages, for each cell in series; real cyclers are at a tenth of it.
NOISE_V = 2e-3
SIGMAS = 4.0
_FADE = 0.8
# A change of the voltage that the charge of one interval can bring is no answer to a step.
_USUAL_SHARE_OF_SLOPE = 0.1


@dataclass(frozen=True, slots=True)
class Response:
    """What is known of the resistance.

    Parameters
    ----------
    s11, s12, s22, t1, t2, n, rest : float
        Weighted sums of the squares of the steps, of their products with the voltage, of samples and of its squares.
    step_A : float
        The step before.
    relaxing_V, taken : float, int
        First change of the voltage where the record began under load, else 0 (no number before the first sample), and
        how many have come since.
    """

    s11: float = 0.0
    s12: float = 0.0
    s22: float = 0.0
    t1: float = 0.0
    t2: float = 0.0
    n: float = 0.0
    rest: float = 0.0
    step_A: float = 0.0
    relaxing_V: float = math.nan
    taken: int = 0

    @property
    def resistance_Ohm(self) -> tuple[float, float]:
        """Estimate and standard deviation; infinite where the steps do not tell."""
        a, b, std = self.parts_Ohm
        return a + b, std

    @property
    def parts_Ohm(self) -> tuple[float, float, float]:
        """What shows at once, what shows with the next sample, and the standard deviation of their sum."""
        determinant = self.s11 * self.s22 - self.s12 * self.s12
        if not determinant > 1e-9 * self.s11 * self.s22:
            return 0.0, 0.0, math.inf
        a = (self.s22 * self.t1 - self.s12 * self.t2) / determinant
        b = (self.s11 * self.t2 - self.s12 * self.t1) / determinant
        variance = (self.s11 + self.s22 - 2.0 * self.s12) / determinant
        misfit = (self.rest - a * self.t1 - b * self.t2) / max(1.0, self.n - 2.0)
        return a, b, math.sqrt(variance * max(1.0, misfit))


def follow(response: Response, band: CellBand, before: Sample, now: Sample, least_A: float) -> Response:
    """Return what is known after one sample more; steps below `least_A` are noise."""
    change_V = now.voltage_V - before.voltage_V
    started, relaxing_V = _follow_start(response, change_V, abs(before.current_A) <= least_A)
    step_A = now.current_A - before.current_A
    step_A = step_A if abs(step_A) > least_A else 0.0
    if step_A == 0.0 and response.step_A == 0.0:
        return started
    charge_As = max(abs(now.current_A), abs(before.current_A)) * (now.time_s - before.time_s)
    sigma_V = math.hypot(
        NOISE_V * band.cells_in_series, _USUAL_SHARE_OF_SLOPE * band.slope_V_per_As * charge_As, relaxing_V
    )
    weight, last_A = 1.0 / (sigma_V * sigma_V), response.step_A
    return replace(
        started,
        s11=_FADE * response.s11 + weight * step_A * step_A,
        s12=_FADE * response.s12 + weight * step_A * last_A,
        s22=_FADE * response.s22 + weight * last_A * last_A,
        t1=_FADE * response.t1 + weight * step_A * change_V,
        t2=_FADE * response.t2 + weight * last_A * change_V,
        n=_FADE * response.n + 1.0,
        rest=_FADE * response.rest + weight * change_V * change_V,
        step_A=step_A,
    )


def _follow_start(response: Response, change_V: float, at_rest: bool) -> tuple[Response, float]:
    """How far a record that began under load has come, and what may still relax of that."""
    taken = response.taken + 1
    if not math.isnan(response.relaxing_V):
        # Diffusion: its voltage goes on with the root of the time, each change is the first one's over twice the root.
        return replace(response, taken=taken), response.relaxing_V / (2.0 * math.sqrt(response.taken))
    if at_rest:
        return replace(response, relaxing_V=0.0, taken=taken), 0.0
    return replace(response, relaxing_V=abs(change_V), taken=taken), math.inf


def judge(response: Response, band: CellBand) -> Finding | None:
    """Return what is not plausible about the resistance."""
    resistance, std = response.resistance_Ohm
    low, high = resistance - SIGMAS * std, resistance + SIGMAS * std
    shown = f"the voltage answers to steps of the current with {resistance:.3g} +- {std:.2g} Ohm"
    possible, usual = band.possible_Ohm, band.usual_Ohm
    plausible = f", plausible are {usual[0]:.2g} to {usual[1]:.2g} Ohm"
    if high < 0.0:
        remedy = "check the sign of the current in the map, the wiring, and the cell: a short in a step looks like this"
        return Finding("trip", "reversed_current", f"{shown}: it falls when the cell is charged", remedy)
    if high < usual[0]:
        remedy = "check sense leads and cell: a short, or a voltage that is not the cell's"
        return Finding("trip" if high < possible[0] else "warn", "resistance_low", shown + plausible, remedy)
    if low > usual[1]:
        remedy = "check contacts and sense leads"
        return Finding("trip" if low > possible[1] else "warn", "resistance_high", shown + plausible, remedy)
    return None
