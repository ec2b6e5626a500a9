"""Constants of the evidence, each with its unit and reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """Prior weights and sizes.

    Attributes
    ----------
    voltage_points, temperature_points : samples of all judged runs that are looked at
    simulated : samples of all runs for which effects are simulated
    soc_margin : how far beyond the trained SoC a sample may lie
    asked : gain of the logarithm from which runs ask for another state of charge, which must be a trained one, too
    share_kept : of the samples, without which they are all looked at
    scales, scale_weights : factors by which the model's error elsewhere may be larger than was learned, and how likely
        each is
    beside, beside_weight : such a factor beside an effect, and how likely: the effect and something more
    unknown_scales : the same where something is there that no effect stands for
    sizes : of an effect, in units of its usual size
    tempering : power of the likelihood: neither equations nor errors are quite those that were assumed
    tempering_white : the same against nothing, of a cell whose errors on unseen runs all are white noise: they are what
        was assumed. Of 22 logs without an effect of such cells (in class, seed 901, and many branches, seed 52) no
        effect raised the logarithm by more than 4.7
    nothing, unknown, pairs : prior probabilities; the rest is shared by the effects
    twins : weight of a pair that one log can hardly tell apart, beside that of any other
    claim : probability of "nothing" below which something is said to be there: with 0.05 6 of 80 foreign logs without
        an effect draw a claim, with 0.02 3, with 0.01 3, and of 160 with one 81, 80 and 78 are named right (particle
        and many branches, seeds 1401 and 1501)
    worse : factor by which an explanation may raise the voltage's error, start and all that is open left aside: more is
        an explanation by what nobody knows, which only its opposite hides
    as_good : part of a free curve's gain of the logarithm with which a special case of one size stands in its place
    one_curve : the same with which it is told as a rival
    sure_of_curve : most confidence beside such a rival
    in_question : difference of logarithms to the likeliest, within which pairs are asked for that
    equation : share of a change by which it is off because no cell follows an effect's equation to the letter: of sizes
        on foreign cells (seed 1801) 58 of 67 lie within two standard deviations without it, 61 with 0.05, 63 with 0.1
    rival : factor of the probability within which two effects cannot be told apart
    two : factor by which two effects must be likelier than one alone to be named: nearer by, one is the simpler answer
    power : share of cases in which an effect of the stated size is seen
    start_spreads : standard deviations by which a stated state of charge at the start may be off and no news: one in
        370 logs is further off (many branches, seed 3001: one at 2.6 was told for sure)
    start_K : of the temperature at the start, K
    heat_error : of the model's temperature, in units of its training error: another run is off by its own error too
    resistance : usual share by which all resistances of a run may differ together
    usual_V : voltage of an effect that does not say how large it usually is, V
    white_K : resolution of a thermometer, K
    """

    voltage_points: int = 600
    temperature_points: int = 200
    simulated: int = 20_000
    soc_margin: float = 0.03
    asked: float = 10.0
    share_kept: float = 0.3
    scales: tuple[float, ...] = (0.6, 1.0, 1.7, 2.9)
    scale_weights: tuple[float, ...] = (0.2, 0.4, 0.28, 0.12)
    beside: float = 6.0
    beside_weight: float = 0.01
    unknown_scales: tuple[float, ...] = (3.0, 6.0, 12.0)
    sizes: tuple[float, ...] = (0.3, 1.0, 3.0)
    tempering: float = 0.35
    tempering_white: float = 0.7
    nothing: float = 0.5
    unknown: float = 0.05
    pairs: float = 0.1
    twins: float = 0.1
    claim: float = 0.02
    worse: float = 1.2
    as_good: float = 0.85
    one_curve: float = 0.5
    sure_of_curve: float = 0.6
    in_question: float = 8.0
    equation: float = 0.05
    rival: float = 10.0
    two: float = 2.0
    power: float = 0.9
    start_spreads: float = 3.0
    start_K: float = 3.0
    heat_error: float = 1.4
    resistance: float = 0.3
    usual_V: float = 0.01
    white_K: float = 0.05

    @property
    def effect_scales(self) -> tuple[tuple[float, float], ...]:
        """Factors of the model's error where an effect is there, each with its weight."""
        return (*zip(self.scales, self.scale_weights, strict=True), (self.beside, self.beside_weight))


THRESHOLDS = Thresholds()
