"""Constants of the estimate of a cell's state, each with its unit and reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How far a cell may have aged, and what is looked at.

    Attributes
    ----------
    points : samples of a run that are looked at, beside those around its steps
    steps, after_step : largest steps of the current whose neighbourhood is looked at, and which samples from each
    step_C : smallest of these, in units of the capacity per hour
    nodes : over the whole SoC, at which resistances are told; between them they change in proportion
    capacity : usual change over a life, relative
    resistance, alike_soc : the same of the resistance of the first moment, over its own; and over how much SoC it is
        alike
    slower : the same of all that the current runs through, the first moment's included
    curve_V, curve_soc : the same of the open-circuit curve, V, which slips as the electrodes lose lithium
    slip : by how much a place on that curve moves along the SoC, alike over the same
    end_soc, end_std : how near to full or empty a run ends that tells the capacity, and how surely, SoC
    far_soc : how far such an end is from the start, at least, to begin the search there
    load_C : least current of a charge or discharge that ends, in units of the capacity per hour
    scales : factors by which that and the model's error elsewhere may be larger than is usual, equally likely
    capacities : lowest and highest capacity that is looked for, over that of the model, and how many between
    clipped_V : an error that counts no more when it is larger, in the search for the first guess
    rounds, closer : covariances that are made, and steps of the capacity with each
    settled : relative change of the capacity that ends the steps
    share : of the samples of a diagnosis that a verdict looks at: there are hundreds of runs
    alarms : share of false claims among all that are made over a series
    """

    points: int = 160
    steps: int = 6
    after_step: tuple[int, ...] = (-1, 0, 1, 3, 10)
    step_C: float = 0.1
    nodes: int = 11
    capacity: float = 0.2
    resistance: float = 0.7
    alike_soc: float = 0.15
    slower: float = 0.3
    curve_V: float = 0.006
    curve_soc: float = 0.12
    slip: float = 0.004
    end_soc: float = 0.05
    end_std: float = 0.01
    far_soc: float = 0.3
    load_C: float = 0.02
    scales: tuple[float, ...] = (0.6, 1.0, 1.7, 2.9, 6.0)
    capacities: tuple[float, float, int] = (0.4, 1.2, 81)
    clipped_V: float = 0.05
    rounds: int = 2
    closer: int = 4
    settled: float = 1e-3
    share: float = 0.3
    alarms: float = 0.05


SETTINGS = Settings()
