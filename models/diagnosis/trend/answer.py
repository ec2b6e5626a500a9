"""From what a run's evidence, and that of its series, says to a diagnosis of the public contract."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.answer.findings import Diagnosis, Finding
from models.diagnosis.answer.next_experiment import discriminating_request
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.reference.record import Record
from models.diagnosis.trend.estimate import Weighed
from models.diagnosis.trend.loss.origin import Origin, origin_of
from models.diagnosis.trend.prior import aged
from models.diagnosis.trend.series import likeliest_set
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weights import latent
from models.diagnosis.trend.weights.sizes import CAPACITY, CHANGES, CURVE, EVERY, RESISTANCE, Changes
from models.diagnosis.trend.weights.weighing import Held
from models.effects import Effect, effects
from models.effects.bent_curve import slow_rate
from models.effects.view import View

# Places that a person names, and the name of each.
_PLACES = ((1.0, "full"), (0.5, "half"), (0.0, "empty"))
_RIVAL = 10.0
# A resistance has grown wherever it has by this part of what it has where that is surest.
_PART = 0.5
# Samples for which the explanation is simulated; between them it is drawn straight.
_SIMULATED = 900


def effect_of(change: str) -> str:
    """Name of the effect that stands for a change."""
    return _effect(change).name


def _effect(change: str) -> Effect:
    return next(each for each in effects().values() if each.life == change)


def answer(
    weighed: Weighed,
    record: Record,
    by_set: FloatArray,
    borne_out: bool,
    started: float,
    by_way: FloatArray | None = None,
    beside: Sequence[Weighed] = (),
) -> Diagnosis:
    """Make it.

    Parameters
    ----------
    weighed : the run
    record : with the network's error
    by_set : (sets,) probability of each set of changes by the whole series, in the order of `EVERY`
    borne_out : whether the series lets anything be said of this run
    started : reading of `time.perf_counter` when the run began
    by_way : (ways + 1,) probability of each way to lose the capacity by the whole series, last of none that is known
    beside : other runs at the same place of the series
    """
    changes = likeliest_set(by_set)
    own = weighed.chances
    unknown = borne_out and own.unknown > max([own.nothing, *own.of.values()])
    if unknown or not borne_out:
        changes = ()
    remarks = []
    if not borne_out and own.nothing < SETTINGS.claim:
        remarks.append("alone this run would say more than nothing; among so many, one that does is expected by chance")
    if changes:
        open_ones = [each for each in EVERY[int(np.argmax(by_set))] if each not in changes]
        names = [(effect_of(each).replace("_", " "), _there(by_set, each)) for each in open_ones]
        remarks += [f"{name} may have come as well, with {100.0 * chance:.0f} %" for name, chance in names]
    origin = origin_of(weighed, changes, by_way, beside)
    findings, left = _findings(weighed, record, by_set, origin.beside(weighed, changes), origin)
    rivals = findings[0].confounded_with if len(findings) == 1 else ()
    return Diagnosis(
        verdict="unknown_effect" if unknown else "ambiguous" if rivals else "missing" if changes else "nothing_missing",
        mode="change",
        findings=tuple(findings),
        noise_floor_mV=record.noise_floor_mV,
        unexplained_mV=left.rms_mV,
        depends_on=(),
        next_experiment=_settling(weighed, findings[0].effect, rivals[0]) if rivals else None,
        seconds=time.perf_counter() - started,
        remarks=tuple(remarks),
    )


def _settling(weighed: Weighed, first: str, second: str) -> dict[str, Any]:
    """Request for the profile that tells two changes apart, from where the run has left the cell."""
    given, run = weighed.given, weighed.given.run
    left = given.soc + float(run.charge_Ah[-1]) / weighed.state.capacity_Ah
    measured_V = run.voltage_V[np.isfinite(run.voltage_V)]
    return discriminating_request(given.known.cell, (first, second), measured_V, float(np.clip(left, 0.0, 1.0)))


def _findings(
    weighed: Weighed, record: Record, by_set: FloatArray, changes: Changes, origin: Origin
) -> tuple[list[Finding], Record]:
    """The changes, that which explains most first, each with what it leaves beside those before it."""
    if not changes:
        return [], record
    found = weighed.told(changes, origin.way)
    parts = parts_V(weighed, found, origin.way)
    order = _order(_above_empty(record, weighed), parts, changes, bool(origin.cause))
    named = {each: effect_of(each) for each in order} | ({CAPACITY: origin.effect} if origin.cause else {})
    findings: list[Finding] = []
    left = record
    for rank, change in enumerate(order):
        after = left.less([parts[change]])
        there = _there(by_set, change)
        rivals = tuple(effect_of(each) for each in _rivals(by_set, changes, change))
        values = _values(weighed, found, change)
        figures: dict[str, Any] = {"beside": [named[each] for each in order[:rank]]}
        title = _effect(change).title
        if change == RESISTANCE:
            figures["where"] = where(weighed, found)
            title = f"Resistance {figures['where']}"
        figures["takes_capacity"] = change == CAPACITY
        if change == CAPACITY and origin.chances:
            figures["causes"] = origin.chances
        if change == CAPACITY and origin.cause:
            there, values, rivals = there * origin.chance, origin.values | values, ()
            title = effects()[origin.effect].title
        finding = Finding(
            named[change], rank + 1, record.rms_mV, after.rms_mV, there, values, rivals,
            _explained(change, title, values, rivals), figures,
        )  # fmt: skip
        findings.append(finding)
        left = after
    return findings, left


def _there(by_set: FloatArray, change: str) -> float:
    """Probability that a change is there, alone or beside others."""
    return sum(float(p) for p, each in zip(by_set, EVERY, strict=True) if change in each)


def _above_empty(record: Record, weighed: Weighed) -> Record:
    """The record without what lies near empty, where a slip of a hundredth is worth more than all else."""
    given = weighed.given
    soc = given.soc + given.run.charge_Ah / weighed.state.capacity_Ah
    kept = soc > SETTINGS.end_soc
    if not kept.any():
        return record
    return replace(record, error_V=[np.where(kept, each, np.nan) for each in record.error_V])


def _order(record: Record, parts: dict[str, FloatArray], changes: Changes, caused: bool) -> list[str]:
    """Changes, the one first that leaves least of the error, beside those before it: parts may undo each other.

    A curve that moved freely stands for whatever is left, so that a loss that bends it in its own way goes before.
    """
    out, left, open_ones = list[str](), record, list(changes)
    while open_ones:
        next_ones = [each for each in open_ones if not (each == CURVE and caused and CAPACITY in open_ones)]
        best = min(next_ones, key=lambda each: left.less([parts[each]]).rms_mV)
        left = left.less([parts[best]])
        out.append(best)
        open_ones.remove(best)
    return out


def _rivals(by_set: FloatArray, changes: tuple[str, ...], change: str) -> list[str]:
    """Changes that explain a run nearly as well in the place of one."""
    chance: dict[tuple[str, ...], float] = dict(zip(EVERY, by_set.tolist(), strict=True))
    out = []
    for other in CHANGES:
        swapped = tuple(each for each in CHANGES if each == other or (each in changes and each != change))
        if other not in changes and chance[swapped] * _RIVAL >= chance[changes]:
            out.append(other)
    return out


def parts_V(weighed: Weighed, found: Held, way: int = -1) -> dict[str, FloatArray]:
    """(n,) of the whole run, the voltage that each change stands for.

    Parameters
    ----------
    weighed : the run
    found : weights
    way : in which a capacity is lost, by its number; -1: in none that is known
    """
    given, run = weighed.given, weighed.given.run
    index = np.unique(np.round(np.linspace(0, len(run) - 1, min(len(run), _SIMULATED))).astype(np.int64))
    index = np.union1d(index, given.index)
    change = float(found.mean[0])
    old = View(given.known.cell, run, given.soc, index)
    view = View(aged(given.known.cell, change), run, given.soc, index)
    low, high = view.soc[index] - 5e-3, view.soc[index] + 5e-3
    slope_V = (view.model.open_circuit_V(high) - view.model.open_circuit_V(low)) / 1e-2
    bent_V = 0.0 * slope_V
    if way in weighed.causes:
        bent_V = weighed.causes[way].loss.bent.voltage_V(view.soc[index], slow_rate(old), change)
    columns = latent.latent(view, slope_V, weighed.now.usual_Ohm).volts
    # The columns begin after that of the capacity.
    weights = found.mean[1:]
    resistive = np.r_[latent.QUICK, latent.SLOWER, latent.SERIES, latent.OVERALL] - 1
    slip = np.r_[latent.SLIP, latent.SHIFT] - 1
    local = np.r_[latent.CURVE, latent.LOOP] - 1
    out = {
        RESISTANCE: columns[:, resistive] @ weights[resistive],
        CAPACITY: view.voltage_V + bent_V - old.voltage_V,
        CURVE: columns[:, local] @ weights[local],
    }
    # What electrodes slip by as they lose capacity is part of that loss, where the curve is not named itself.
    out[CURVE if CURVE in found.changes else CAPACITY] += columns[:, slip] @ weights[slip]
    return {name: np.interp(np.arange(len(run)), index, each) for name, each in out.items()}


def _values(weighed: Weighed, found: Held, change: str) -> dict[str, Value]:
    state = weighed.state
    if change == CAPACITY:
        return {"capacity_Ah": Value(state.capacity_Ah, state.capacity_std_Ah, "Ah")}
    if change == RESISTANCE:
        grown, std = growth_Ohm(weighed, found)
        at = {name: int(round(soc * (len(grown) - 1))) for soc, name in _PLACES}
        return {f"{name}_Ohm": Value(float(grown[k]), float(std[k]), "Ohm") for name, k in at.items()}
    moved, std = moved_V(weighed, found)
    at = {name: int(round(soc * (len(moved) - 1))) for soc, name in _PLACES}
    return {f"{name}_mV": Value(1e3 * float(moved[k]), 1e3 * float(std[k]), "mV") for name, k in at.items()}


def growth_Ohm(weighed: Weighed, found: Held) -> tuple[FloatArray, FloatArray]:
    """(n,) growth of the resistance of the first moment over SoC since the cell was fresh, and its std."""
    now = weighed.now
    turn = latent.resistances(now.fresh_Ohm, now.usual_Ohm, now.typical_Ohm)
    std = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", turn, found.covariance, turn), 0.0))
    return turn @ found.mean, std


def moved_V(weighed: Weighed, found: Held) -> tuple[FloatArray, FloatArray]:
    """(n,) by how much the open-circuit curve has moved over SoC, and its std."""
    cell = weighed.given.known.cell
    slope_V = (cell.open_circuit_V(latent.NODES + 5e-3) - cell.open_circuit_V(latent.NODES - 5e-3)) / 1e-2
    turn = np.zeros((len(latent.NODES), latent.COUNT))
    turn[:, latent.CURVE] = np.eye(len(turn))
    turn[:, latent.SLIP] = np.diag(slope_V)
    turn[:, latent.SHIFT] = slope_V[:, None]
    return turn @ found.mean, np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", turn, found.covariance, turn), 0.0))


def where(weighed: Weighed, found: Held) -> str:
    """Where a resistance has grown, as a person says it: "when full", "when empty", "in the middle" or "everywhere"."""
    grown, std = growth_Ohm(weighed, found)
    # Where one has grown that is told rather than where one has fallen: cells age.
    surest = int(np.argmax(grown / std)) if float(np.max(grown / std)) >= 1.0 else int(np.argmax(np.abs(grown) / std))
    places = latent.NODES[grown * np.sign(grown[surest]) >= _PART * abs(grown[surest])]
    low, high = float(places.min()), float(places.max())
    if low >= 0.5:
        return "when full"
    if high <= 0.5:
        return "when empty"
    return "in the middle" if low > 0.2 and high < 0.8 else "everywhere"


def _explained(change: str, title: str, values: dict[str, Value], rivals: tuple[str, ...]) -> str:
    parts = [(name.rsplit("_", 1)[0] if change != CAPACITY else name, each) for name, each in values.items()]
    named = ((name.removesuffix(f"_{each.unit}").replace("_", " "), each) for name, each in parts)
    listed = ", ".join(f"{name} {each.value:.3g} +- {each.std or 0.0:.1g} {each.unit}" for name, each in named)
    against = "" if change == CAPACITY else " against the cell as it was"
    beside = f" This run cannot tell it from: {', '.join(rivals)}." if rivals else ""
    return f"{title} has changed: {listed}{against}.{beside}"
