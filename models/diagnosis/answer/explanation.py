"""Findings in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.diagnosis.evidence.parameters import Value
from models.effects import Effect, effect, effects

_KEEP_SHORT = 3


def explain(
    found: Effect,
    share: float,
    remaining_mV: float,
    values: dict[str, Value],
    rivals: Sequence[str],
    mode: str,
    beside: Sequence[str] = (),
) -> str:
    """One paragraph on a finding.

    Parameters
    ----------
    found : the effect
    share : of what is new that it explains, 0..1
    remaining_mV : of the reference model's error with it
    values : its parameters
    rivals : effects that the data cannot tell from it
    mode : "change" or "structure"
    beside : effects that are named before it, with which its figures are given
    """
    verb = "has changed" if mode == "change" else "is missing in the model"
    parts = [
        f"{found.title} {verb}: {_listed(values)}.",
        f"It explains {100 * max(min(share, 1.0), 0.0):.0f} % of what the model's own error leaves open; "
        f"{remaining_mV:.1f} mV remain.",
        f"How to recognise it: {found.recognise}.",
    ]
    if beside:
        parts.append(f"The error that is left is given together with: {_titles(beside)}.")
    if rivals:
        parts.append(f"These data cannot tell it from: {_titles(rivals[:_KEEP_SHORT])}.")
    return " ".join(parts)


def explain_power(hidden: Sequence[tuple[Effect, float]]) -> str:
    """One sentence on effects that could be there unseen.

    Parameters
    ----------
    hidden : effects, with the smallest size of the first parameter that would have been seen
    """
    parts = [f"{one.title.lower()} {_size(one, size)}" for one, size in hidden]
    return f"with 90 % probability these runs would have shown, of what could hide best: {'; '.join(parts)}"


def explain_no_heat(known: bool) -> str:
    """One sentence on what is not asked about where the temperature is not looked at.

    Parameters
    ----------
    known : whether the heat balance of the training runs is known, so that the diagnosed runs are what it lacks
    """
    titles = [one.title.lower() for one in effects().values() if one.channel == "temperature"]
    why = "the diagnosed runs lack a temperature, or that of their surroundings, at some of their samples"
    if not known:
        why = (
            "no heat balance of the training runs is known: they lack temperature or ambient temperature, or hardly "
            "warm the cell, or the model is of an older version; fit it again"
        )
    return f"the temperature is not looked at, so that nothing is said of: {', '.join(titles)}; {why}"


def _size(one: Effect, size: float) -> str:
    unit = one.parameters[0].unit
    return f"from {size:.2g}{'' if unit == '1' else ' ' + unit} on" if np.isfinite(size) else "at no size"


def _titles(names: Sequence[str]) -> str:
    return ", ".join(effect(name).title.lower() for name in names)


def _listed(values: dict[str, Value]) -> str:
    return ", ".join(_one(name, each) for name, each in values.items())


def _one(name: str, each: Value) -> str:
    in_words = each.unit.replace("/", " per ").removeprefix("1 ")
    label = name.replace("_", " ").removesuffix(f" {in_words}")
    unit = "" if each.unit == "1" else f" {each.unit}"
    band = "" if each.std is None else f" +- {float(f'{each.std:.1g}'):g}"
    return f"{label} {each.value:.3g}{band}{unit}"
