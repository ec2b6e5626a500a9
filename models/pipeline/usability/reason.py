"""Verdict on a model, with its reasons in a laboratory's words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

from models.network.model_record import Json


class Verdict(IntEnum):
    """How far a model can be used; the larger, the worse."""

    USABLE = 0
    LIMITED = 1
    UNUSABLE = 2


@dataclass(frozen=True)
class Reason:
    """One thing that limits a model: what it is, what it means, and what to do about it."""

    verdict: Verdict
    text: str


def limited(text: str) -> Reason:
    """Something that part of the model's answers stand on does not hold."""
    return Reason(Verdict.LIMITED, text)


def unusable(text: str) -> Reason:
    """Nothing that the model says can be relied on."""
    return Reason(Verdict.UNUSABLE, text)


def usability(reasons: Iterable[Reason]) -> Json:
    """Document of a verdict: the worst of its reasons, these from the worst on."""
    known = sorted(dict.fromkeys(reasons), key=lambda reason: -reason.verdict)
    worst = max((reason.verdict for reason in known), default=Verdict.USABLE)
    return {"verdict": worst.name.lower(), "reasons": [reason.text for reason in known]}
