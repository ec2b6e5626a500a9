"""Constants of the estimate of a cell's state, each with its unit and reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """Standard deviations of what may differ from the cell as it was.

    Attributes
    ----------
    capacity : relative
    resistance : of the first moment, over its own; half of it is alike at all states of charge
    slower : of all that the current runs through, the first moment's included, the same way
    series : in ohms that are the same at all states of charge, over what the current runs through in the mean
    overall : of all that the current runs through, by one factor at all states of charge
    curve_V : of the open-circuit curve, V
    slip : by how much a place on that curve moves along the SoC
    shift : by how much all places together do, because full is not sharp
    loop_V : of the hysteresis, V
    """

    capacity: float
    resistance: float
    slower: float
    curve_V: float
    slip: float
    shift: float
    loop_V: float
    series: float = 0.0
    overall: float = 0.0


# What differs from run to run of the same cell and is no news: counted charge by some parts in a thousand, resistances
# as a clamp or a chamber makes them differ (30Q cells grow by a tenth in their first 100 cycles), the curve by what a
# converter makes of it and because full is not sharp.
USUAL = Sizes(capacity=0.007, resistance=0.07, slower=0.035, curve_V=0.002, slip=0.003, shift=0.01, loop_V=0.002)
# What may have changed over a life. Resistances that are alike everywhere are weighed as an explanation of their own:
# taken for one at each state of charge, that of a contact was told 58 % too small to 38 % too large in simulated cells.
CHANGED = Sizes(
    capacity=0.2, resistance=0.7, slower=0.5, curve_V=0.02, slip=0.03, shift=0.03, loop_V=0.01, series=0.5, overall=0.5
)


@dataclass(frozen=True)
class Settings:
    """How far a cell may have aged, and what is looked at.

    Attributes
    ----------
    fewest : samples with a voltage without which nothing is told: a handful fits many capacities
    points : samples of a run that are looked at, beside those around its steps
    steps, after_step : largest steps of the current whose neighbourhood is looked at, and which samples from each
    step_C : smallest of these, in units of the capacity per hour
    nodes : over the whole SoC, at which resistances and the curve are told; they change in proportion between them
    alike_soc, curve_soc, slip_soc : over how much SoC resistances, curve and slip are alike: electrodes slip as a whole
    slip_of_capacity : of a lost share of the capacity, what the curve slips by as an electrode slips against the other
    slip_of_loss, curve_of_loss_V : the same beside a loss whose curve is known, and by how much that curve may be off,
        because half-cell curves, and what the current makes of them, are not known quite
    near_ends, near_none : how near the capacity of a loss has to be to that which a run asks for, relative, to be
        tried: where the run ends full or empty, and where it does not
    plain : probability that a lost capacity has none of the known causes, or several
    sizes : of a change, in units of the largest that is usual, equally likely
    end_soc, end_std, pulse_end_std : how near to full or empty a run ends that tells the capacity, and how surely, SoC,
        where it ends with a steady current and with a pulse. With 0.006 for both, the capacity of
        measured cells was up to 2.5 % off; 0.003 was set on Samsung's
    pulsed : current of a pulse over the mean
    sharp : what is called full and empty is not sharper than this, SoC
    end_samples : before such an end that are taken together
    far_soc : how far such an end is from the start, at least, to begin the search there
    tapered : current at the end of a charge that held its voltage, over the largest
    load_C : least current of a charge or discharge that ends, in units of the capacity per hour
    scales, weights : factors by which the model's error elsewhere may be larger than is usual, and how likely each is
        beside something that is known
    unknown_scales : the same where something is there that none of these changes stands for
    capacities : lowest and highest capacity that is looked for, over that of the model, and how many between
    clipped_V : an error that counts no more when it is larger, in the search for the first guess
    closer, settled : steps of the capacity, and the relative change of it that ends them
    tempering : power of the likelihood: neither equations nor errors are quite those that were assumed. With 0.35 a
        resistance that had grown by 45 % in measured cells beside lost capacity was no news
    nothing, unknown : prior probability of nothing new, and of something that none of these changes stands for
    more : of each further change, over the same without it
    beside : how much likelier than without it a change has to be to be named beside others: a capacity that is off by
        a thousandth of the true one makes a resistance half as likely again as none
    begins, ends : probability that a change begins, or is gone again, from one run of a series to the next
    other_way : probability that what is lost from one run of a series to the next is lost in another way
    cause : probability of a cause from which on a lost capacity is called by its name
    cause_alike : the same where several pairs of electrodes make the curve alike: then a run has to bear them out
    claim : probability of nothing new below which a run alone says something
    alarms : share of false claims among all that are made over a series
    """

    fewest: int = 30
    points: int = 160
    steps: int = 6
    after_step: tuple[int, ...] = (-1, 0, 1, 3, 10)
    step_C: float = 0.1
    nodes: int = 11
    alike_soc: float = 0.15
    curve_soc: float = 0.12
    slip_soc: float = 0.4
    slip_of_capacity: float = 0.15
    slip_of_loss: float = 0.08
    curve_of_loss_V: float = 0.05
    near_ends: float = 0.03
    near_none: float = 0.1
    plain: float = 0.4
    sizes: tuple[float, ...] = (0.3, 1.0)
    end_soc: float = 0.05
    end_std: float = 0.003
    pulse_end_std: float = 0.006
    pulsed: float = 1.2
    sharp: float = 0.01
    end_samples: int = 9
    far_soc: float = 0.3
    tapered: float = 0.5
    load_C: float = 0.02
    scales: tuple[float, ...] = (0.6, 1.0, 1.7, 2.9, 6.0, 12.0)
    weights: tuple[float, ...] = (0.2, 0.38, 0.28, 0.12, 0.02, 0.0)
    unknown_scales: tuple[float, ...] = (6.0, 12.0)
    capacities: tuple[float, float, int] = (0.4, 1.2, 81)
    clipped_V: float = 0.05
    closer: int = 4
    settled: float = 1e-3
    tempering: float = 0.7
    nothing: float = 0.5
    unknown: float = 0.02
    more: float = 0.3
    beside: float = 2.0
    begins: float = 0.05
    ends: float = 0.01
    other_way: float = 0.02
    cause: float = 0.7
    cause_alike: float = 0.95
    claim: float = 0.05
    alarms: float = 0.05


SETTINGS = Settings()
