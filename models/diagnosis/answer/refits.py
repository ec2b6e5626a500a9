"""Effects tried by refits, where the sensitivities of the network as it is do not tell what it lacks.

A network that is far from its cell is far from linear in what it lacks: a term that is given the parameters' own
freedom, other poles or another curve does more than its first-order share. So each effect is put into the structure and
the network refitted. Training runs that the refit has not seen decide which effect it is; the diagnosed runs have to
confirm it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.diagnosis.answer.findings import Finding
from models.diagnosis.evidence.candidates import Candidate
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.reference.record import Record
from models.diagnosis.structure.extension import Extension, ExtensionSearch
from models.diagnosis.structure.structure import StructureAnalysis
from models.effects import Effect, effect
from models.identification.progress import silent
from models.identification.search.search import Search
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork

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
        None where no effect clearly lowers the error of held-out training runs and that of the diagnosed runs, or none
        by more than it does to first order; and for networks by hats, which are not fitted by this search.
    """
    if network.structure.kernel == "hat":
        return None
    search = Search(train, train_soc, network.cell, silent)
    extensions = ExtensionSearch(search)
    own, comparison = extensions.own(network), analysis.comparison
    tried: list[tuple[Candidate, Extension]] = []
    for each in analysis.ranking.candidates:
        if each.effect.extend is not None:
            values = {name: value.value for name, value in parameters(comparison, each).items()}
            extension = extensions.extended(own, each.effect, values)
            tried += [] if extension is None else [(each, extension)]
    least_V = min((extension.error_V for _, extension in tried), default=np.inf)
    # The best, and what comes near to it, as far as they lower the error clearly.
    most_V = min((1.0 - _WORTH) * own.error_V, least_V / (1.0 - _WORTH))
    clear = sorted((pair for pair in tried if pair[1].error_V <= most_V), key=lambda pair: pair[1].error_V)
    named = Named(comparison, analysis.ranking)
    found = tuple(
        Refit(
            each.effect,
            Readings((named,)).parameters(named, each),
            1e3 * extension.error_V,
            _error_mV(search, extension, record),
        )
        for each, extension in clear
    )
    # A refit that explains no more of unseen samples than sensitivities do is none to listen to.
    explained = 1.0 - (least_V / own.error_V) ** 2
    confirmed = bool(found) and found[0].error_mV < record.rms_mV and explained > analysis.ranking.held_out_share
    return Refits(found, 1e3 * own.error_V) if confirmed else None


def _error_mV(search: Search, extension: Extension, record: Record) -> float:
    fitted = search.fitted(extension.choice)
    network = LocalModelNetwork(fitted.structure, fitted.partition, fitted.theta, fitted.scaling, search.cell)
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
        words = (
            f"{each.effect.title} is missing in the model: a refit with it lowers the error of held-out training runs "
            f"from {refits.held_out_mV:.1f} to {each.held_out_mV:.1f} mV. How to recognise it: {each.effect.recognise}."
        )
        if others:
            titles = ", ".join(effect(name).title.lower() for name in others)
            words += f" These data cannot tell it from: {titles}."
        errors_mV = {"held_out_before_mV": refits.held_out_mV, "held_out_after_mV": each.held_out_mV}
        finding = Finding(
            each.effect.name, rank, record.rms_mV, each.error_mV, sure, each.parameters, others, words, errors_mV
        )
        findings.append(finding)
    return findings
