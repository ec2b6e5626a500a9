"""Which plan a fit follows: the one that was asked for, or of several the one that simulates unseen runs best.

Of searched networks only those count that are physical wherever they are read out: a negative resistance or a falling
curve between trained points is a sign that other points are worse. A bounded network is physical wherever it is asked,
and simple: it is taken unless another is better by more than the standard error of the difference between outer folds
(Breiman et al., "Classification and Regression Trees", 1984, ch. 3.4.3), of 1.5 of them for one or two runs. A
network that a search has found among many was chosen on folds of the same runs, so its error is stated too low, and
elsewhere it may be anything: fewer than five runs speak for one only where it leaves little but the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError
from models.effects.bounded_parts import parts_of, resolved_parts
from models.identification.bounded.best_variant import best_variant
from models.identification.bounded.variants import Trials, Variant, clearly_better
from models.identification.progress import Progress, part_of
from models.identification.search.search import Search
from models.network.folds import N_FOLDS, WHOLE_RUNS
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json
from models.network.regression import SignalBank
from models.network.signals import parse_signal
from models.network.structure import Structure
from models.pipeline.plans import BoundedPlan, Built, HeldOutError, Plan, SearchedPlan
from models.pipeline.training import Training
from models.readouts.ocv import ocv_table
from models.readouts.resistance import resistance_table

STRUCTURES = ("auto", "full", "minimal", "bounded", "searched")
# Families that are searched, in the order in which they are tried beside the bounded network.
_SEARCHED = ("searched", "full", "minimal")
# The full structure takes the temperature in; the others do without where none was measured.
_SEARCHED_COLD = ("searched", "minimal")
# Where the bounded network is as near to the noise as this, nothing better can be found.
_AT_NOISE = 1.02
# What leaves no more than so many times the noise of samples that it did not see describes the cell, by whatever runs.
_NEAR_NOISE = 2.0
_ROUNDING_V = 1e-9
# Blocks of one or two runs share what a run has in common, and are few: there the difference has to be as large as only
# one in ten would be by chance (Student's t of five folds).
_ERRORS_OF_BLOCKS = 1.53


@dataclass(frozen=True)
class Chosen:
    """A plan with what it makes of the training data.

    Attributes
    ----------
    plan : to be built again from other starts
    built : the network
    held_out : its error on runs that it did not see
    compared : kinds of networks that were held against each other, with their errors on unseen runs
    bounded : form of the bounded network that was held against it; None: none was
    """

    plan: Plan
    built: Built
    held_out: HeldOutError
    compared: list[Json] = field(default_factory=list)
    bounded: Variant | None = None


def choose(
    data: Training,
    structure: str | Structure,
    without: tuple[str, ...],
    report: Progress,
    bounded: Chosen | None = None,
    finer: tuple[str, ...] = (),
) -> Chosen:
    """Choose a plan and build it.

    Parameters
    ----------
    data : training data
    structure : one of `STRUCTURES`, or a structure of one's own, which is kept
    without : effects that are left out; of the bounded network only
    report : called with a share 0..1 and a short text
    bounded : the bounded network of these data, where it is known
    finer : effects that a bounded network is to have with more resolution than usual

    Raises
    ------
    ModelError
        No such structure, or an effect that cannot be left out of it.
    """
    if (without or finer) and structure not in ("bounded", "auto"):
        raise ModelError(
            f"effects can be left out of the bounded network, or made finer in it, only, not of {structure!r}; "
            "use --structure bounded"
        )
    if not data.has_temperature:
        _check_without_temperature(structure)
    if isinstance(structure, Structure):
        return _built(_given(data, structure, part_of(report, 0.0, 0.7)), data, part_of(report, 0.7, 0.3))
    if structure == "bounded" or without or finer:
        plan = _bounded(data, without, part_of(report, 0.0, 0.7), finer)
        return _built(plan, data, part_of(report, 0.7, 0.3))
    if structure in _SEARCHED:
        search = _search(data, part_of(report, 0.0, 0.7))
        return _built(SearchedPlan(search, search.best(structure)), data, part_of(report, 0.7, 0.3))
    if structure != "auto":
        raise ModelError(f"structure {structure!r} is unknown; use one of {', '.join(STRUCTURES)}")
    return _automatic(data, report, bounded)


def _check_without_temperature(structure: str | Structure) -> None:
    """Refuse what needs a temperature, where not all runs have one."""
    signals = structure.signals if isinstance(structure, Structure) else ()
    if structure == "full" or any(parse_signal(name).depends_on_temperature for name in signals):
        what = structure if isinstance(structure, str) else structure.name
        raise NotIdentifiableError(
            f"structure {what} takes the temperature in, and it is missing in some run: log a temperature, or use "
            "--structure minimal (or auto), which does without"
        )


def _automatic(data: Training, report: Progress, bounded: Chosen | None) -> Chosen:
    """The bounded network, unless one of the searched ones is clearly better."""
    found = bounded or _built(_bounded(data, (), part_of(report, 0.0, 0.2)), data, part_of(report, 0.2, 0.1))
    noise_mV = data.noise_floor_mV
    if noise_mV is not None and 1e3 * found.held_out.rmse_V <= _AT_NOISE * noise_mV:
        return found
    others = []
    families = _SEARCHED if data.has_temperature else _SEARCHED_COLD
    for number, family in enumerate(families):
        begin, width = 0.3 + 0.7 * number / len(families), 0.7 / len(families)
        search = _search(data, part_of(report, begin, 0.8 * width))
        plan = SearchedPlan(search, search.best(family))
        others.append(_built(plan, data, part_of(report, begin + 0.8 * width, 0.2 * width)))
    tried = [_row(each) for each in (found, *others)]
    form = found.plan.variant if isinstance(found.plan, BoundedPlan) else None
    others = [each for each in others if is_physical(each.built.network) and _is_proven(each, data)]
    best = min(others, key=lambda each: each.held_out.rmse_V, default=found)
    errors = 1.0 if len(data.grid) >= WHOLE_RUNS else _ERRORS_OF_BLOCKS
    if clearly_better(best.held_out.mse, found.held_out.mse, found.held_out.count, errors):
        found = best
    return replace(found, compared=tried, bounded=form)


def _is_proven(searched: Chosen, data: Training) -> bool:
    """Whether runs have shown that a network which is held by nothing but them can be trusted on others."""
    noise_mV = data.noise_floor_mV
    near = noise_mV is not None and 1e3 * searched.held_out.rmse_V <= _NEAR_NOISE * noise_mV
    return near or len(data.grid) >= N_FOLDS


def is_physical(network: LocalModelNetwork) -> bool:
    """Whether resistance is positive and the open-circuit curve rises wherever they are read out."""
    ocv, resistance = ocv_table(network), resistance_table(network)
    rises = bool((np.diff(ocv.voltage_V, axis=-1) >= -_ROUNDING_V).all())
    return rises and bool((resistance.resistance_Ohm > 0.0).all())


def _built(plan: Plan, data: Training, report: Progress) -> Chosen:
    built = plan.build(data, report)
    return Chosen(plan, built, built.held_out())


def _bounded(data: Training, without: tuple[str, ...], report: Progress, finer: tuple[str, ...] = ()) -> BoundedPlan:
    bank = SignalBank(data.fit_grid, data.fit_soc, data.cell)
    tried: list[Variant] = []

    def begun(variant: Variant) -> None:
        tried.append(variant)
        report(min(0.1 * len(tried), 0.9), f"bounded network over {variant.axis}")

    trials = Trials(bank, parts_of(without), begun, finer=resolved_parts(finer))
    best = best_variant(trials)
    table: list[Json] = [
        {"family": "bounded", **variant.to_json(), "held_out_rmse_mV": 1e3 * held.mean_mse(logs) ** 0.5}
        for variant, (held, logs) in trials.known.items()
    ]
    return BoundedPlan(best, without, table, trials, finer=finer)


def _search(data: Training, report: Progress) -> Search:
    return Search(data.fit_grid, data.fit_soc, data.cell, report)


def _given(data: Training, structure: Structure, report: Progress) -> Plan:
    search = _search(data, report)
    return SearchedPlan(search, search.best_within(structure))


def _row(chosen: Chosen) -> Json:
    """What is said of a rival."""
    return {"structure": chosen.built.network.structure.name, "held_out_rmse_mV": 1e3 * chosen.held_out.rmse_V}
