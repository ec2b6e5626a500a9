"""Effects tried by refits, where the sensitivities of the network as it is do not tell what it lacks.

A network that is far from its cell is far from linear in what it lacks: a term that is given the parameters' own
freedom, other poles or another curve does more than its first-order share. So each effect is put into the structure and
the network refitted. Training runs that the refit has not seen decide which effect it is; the diagnosed runs have to
confirm it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from models.data.resampling import GridRun
from models.diagnosis.answer.confidence import of_rivals
from models.diagnosis.answer.findings import Finding
from models.diagnosis.evidence.candidates import Candidate
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.reference.record import Record
from models.diagnosis.structure.extension import Extension, ExtensionSearch
from models.diagnosis.structure.structure import StructureAnalysis
from models.effects import Effect, effect
from models.effects.bounded_parts import parts_of
from models.identification.bounded.fitted import fit_variant, network_parts
from models.identification.bounded.variants import Trials, clearly_better, mean_V, variant_of
from models.identification.progress import silent
from models.identification.search.search import Search
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import SignalBank

# An effect must lower the held-out error by this share; others that come as near to it are its rivals.
_WORTH = 0.05
# Not calibrated: few simulated cells need a refit.
_CONFIDENCE, _CONFIDENCE_WITH_RIVALS = 0.8, 0.6


@dataclass(frozen=True)
class Refit:
    """An effect with what a refit makes of it.

    Attributes
    ----------
    effect : put into the structure
    parameters : as the network without it shows them, to first order
    held_out_mV : free-run RMSE on held-out training runs
    error_mV : free-run RMSE on the diagnosed runs
    """

    effect: Effect
    parameters: dict[str, Value]
    held_out_mV: float
    error_mV: float


@dataclass(frozen=True)
class _Trial:
    """An effect put into the structure: its error on held-out training runs, and the network when it is asked for.

    `clearly` says whether it is lower by more than the parts of the training runs differ in that.
    """

    candidate: Candidate
    error_V: float
    network: Callable[[], LocalModelNetwork]
    clearly: bool = True


@dataclass(frozen=True)
class Refits:
    """Effects that a refit asks for, the best first, then its rivals; `held_out_mV` is without any of them."""

    named: tuple[Refit, ...]
    held_out_mV: float


def try_refits(
    network: LocalModelNetwork,
    train: list[GridRun],
    train_soc: list[float],
    record: Record,
    analysis: StructureAnalysis,
) -> Refits | None:
    """Put every effect that can be into the structure, and refit.

    Parameters
    ----------
    network : without them
    train, train_soc : runs that it was fitted to
    record : runs to be diagnosed
    analysis : of all these runs, which gives the effects that they show and their parameters

    Returns
    -------
    Refits
        None where no effect clearly lowers the error of held-out training runs and that of the diagnosed runs, or,
        but of a bounded network, none by more than it does to first order. To a bounded network only effects that were
        left out of it are given back.
    """
    comparison = analysis.comparison
    bounded = network.structure.kernel == "hat"
    own_V, tried = (_bounded if bounded else _searched)(network, train, train_soc, analysis)
    clear = [trial for trial in tried if trial.error_V <= (1.0 - _WORTH) * own_V]
    judged = [(trial, _error_mV(trial.network(), record)) for trial in clear]
    # Where the training runs alone leave it open, the diagnosed runs, which no fit has seen, have to say as much.
    judged = [(trial, mV) for trial, mV in judged if trial.clearly or mV <= (1.0 - _WORTH) * record.rms_mV]
    judged.sort(key=lambda each: each[0].error_V)
    if not judged or judged[0][1] >= record.rms_mV:
        return None
    least_V = judged[0][0].error_V
    named = Named(comparison, analysis.ranking)
    readings = Readings((named,))
    found = tuple(
        Refit(trial.candidate.effect, readings.parameters(named, trial.candidate), 1e3 * trial.error_V, after_mV)
        for trial, after_mV in judged
        if trial.error_V <= least_V / (1.0 - _WORTH)
    )
    # A refit that explains no more of unseen samples than sensitivities do is none to listen to; bounds, which those do
    # not know, make that of a bounded network the better judge.
    explained = 1.0 - (least_V / own_V) ** 2
    return Refits(found, 1e3 * own_V) if bounded or explained > analysis.ranking.held_out_share else None


def _searched(
    network: LocalModelNetwork, train: list[GridRun], train_soc: list[float], analysis: StructureAnalysis
) -> tuple[float, list[_Trial]]:
    """Held-out error in V of the network's structure, and every structure that has one effect more."""
    search = Search(train, train_soc, network.cell, silent)
    extensions = ExtensionSearch(search)
    own = extensions.own(network)

    def fitted(extension: Extension) -> LocalModelNetwork:
        found = search.fitted(extension.choice)
        return LocalModelNetwork(found.structure, found.partition, found.theta, found.scaling, search.cell)

    tried: list[_Trial] = []
    for each in analysis.ranking.candidates:
        if each.effect.extend is not None:
            values = {name: value.value for name, value in parameters(analysis.comparison, each).items()}
            extension = extensions.extended(own, each.effect, values)
            tried += [] if extension is None else [_Trial(each, extension.error_V, partial(fitted, extension))]
    return own.error_V, tried


def _bounded(
    network: LocalModelNetwork, train: list[GridRun], train_soc: list[float], analysis: StructureAnalysis
) -> tuple[float, list[_Trial]]:
    """Held-out error in V of the same form of a bounded network, and with each effect that was left out of it.

    Of three or four runs whole ones are held out: what a block of a run lacks, the rest of the run makes up for, such
    as the branch of a loop that its curve has taken in.
    """
    choices = network.record.choices or {}
    left_out = tuple(str(name) for name in choices.get("without", ()))
    if choices.get("family") != "bounded" or not left_out:
        return np.inf, []
    bank, variant = SignalBank(train, train_soc, network.cell), variant_of(choices)
    own = Trials(bank, parts_of(left_out))
    own_mse, counts = own.outer_error(variant)

    def fitted(trials: Trials) -> LocalModelNetwork:
        structure, partition, theta, scaling = network_parts(fit_variant(trials, variant), "bounded")
        return LocalModelNetwork(structure, partition, theta, scaling, network.cell)

    tried: list[_Trial] = []
    for each in analysis.ranking.candidates:
        if each.effect.name in left_out:
            trials = Trials(bank, parts_of(name for name in left_out if name != each.effect.name))
            mse, _ = trials.outer_error(variant)
            clearly = clearly_better(mse, own_mse, counts)
            tried.append(_Trial(each, mean_V(mse, counts), partial(fitted, trials), clearly))
    return mean_V(own_mse, counts), tried


def _error_mV(network: LocalModelNetwork, record: Record) -> float:
    runs = zip(record.runs, record.soc, strict=True)
    left = np.concatenate([run.voltage_V - free_run_V(network, run, soc) for run, soc in runs])
    return 1e3 * float(np.sqrt(np.nanmean(left**2)))


def refit_findings(refits: Refits, record: Record) -> list[Finding]:
    """The named effect and its rivals in the form of the answer."""
    names = [each.effect.name for each in refits.named]
    sure = _CONFIDENCE if len(names) == 1 else _CONFIDENCE_WITH_RIVALS
    findings = []
    for rank, each in enumerate(refits.named, 1):
        others = tuple(name for name in names if name != each.effect.name)
        chance = sure if rank == 1 else of_rivals(sure, len(others))
        words = (
            f"{each.effect.title} is missing in the model: a refit with it lowers the error of held-out training runs "
            f"from {refits.held_out_mV:.1f} to {each.held_out_mV:.1f} mV. How to recognise it: {each.effect.recognise}."
        )
        if others:
            titles = ", ".join(effect(name).title.lower() for name in others)
            words += f" These data cannot tell it from: {titles}."
        errors_mV = {"held_out_before_mV": refits.held_out_mV, "held_out_after_mV": each.held_out_mV}
        finding = Finding(
            each.effect.name, rank, record.rms_mV, each.error_mV, chance, each.parameters, others, words, errors_mV
        )
        findings.append(finding)
    return findings
