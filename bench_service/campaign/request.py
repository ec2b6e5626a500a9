"""What a campaign is asked to do, with what follows from the bench where the client says nothing."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Literal

from bench_service.campaign.benches import Bench
from bench_service.campaign.standing import Standing
from bench_service.errors import BadRequestError
from bench_service.store.records import Json
from models.data.errors import ModelError

# The mildest defaults that still show resistance and dynamics: twice the capacity out, once in.
_DISCHARGE_C_RATE = -2.0
_CHARGE_C_RATE = 1.0
_SOC_WINDOW = (0.1, 0.9)
_SHORTEST_S = 15_000.0
# Duration over the time in which the weaker of the two currents alone would move the charge.
_TIME_RATIO = 7500.0 / 3600.0
# Structures that effects can be left out of.
_LEAVING_OUT = ("bounded", "auto")
# The live observer starts this far from the counted state of charge, so that its convergence is seen.
OBSERVER_OFFSET_SOC = 0.2
# Beyond these a round adds hours of test and next to nothing to the model.
MOST_ROUNDS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRequest:
    """A campaign: design, run, fit, design again, observe on another run, compare, report.

    Attributes
    ----------
    bench, name : where, and what people call it
    seed : of the random parts of both profiles
    dt_s : sampling time in s
    duration_s : of each run
    capacity_Ah : of the cell
    current_A : (low, high) that the profiles use
    soc : (low, high) window that the profiles stay in
    initial_soc : where the cell stands at the start
    initial_soc_from : where that is known from, for people
    structure : "auto", "full", "minimal", "bounded" or "searched"
    without : effects that are left out of a bounded network, which "auto" is then
    rounds : training runs; the first covers the whole window, each further one is the sequence that tells most about
        what the model of those before it does not know, and the model is fitted to all of them
    diagnose : "change": after the comparison two more runs are played, and it is found out what has changed in the cell
        or the rig since the first; "structure": what the model's structure lacks; None: neither
    changed_bench : the bench of those two runs; None: the same one
    changed_initial_soc : where the cell on that bench stands
    on_interruption : "resume": after a crash, a power cut or the loss of a process it goes on by itself from the last
        stored sample, once the bench has been identified and is safe; "stop": it stands still until somebody says so
    retries : faults of the bench that are acknowledged and tried again, from the last sample too
    """

    bench: str
    name: str
    seed: int
    dt_s: float
    duration_s: float
    capacity_Ah: float
    current_A: tuple[float, float]
    soc: tuple[float, float]
    initial_soc: float
    initial_soc_from: str
    structure: str
    without: tuple[str, ...] = ()
    rounds: int = 1
    diagnose: Literal["structure", "change"] | None = None
    changed_bench: str | None = None
    changed_initial_soc: float = 0.5
    on_interruption: Literal["stop", "resume"] = "stop"
    retries: int = 0

    @classmethod
    def from_json(cls, document: Json) -> CampaignRequest:
        """Read what `to_json` wrote, also of a version that knew less."""
        known: Json = {each.name: document[each.name] for each in fields(cls) if each.name in document}
        listed: Json = {name: tuple(known[name]) for name in ("current_A", "soc", "without") if name in known}
        return cls(**(known | listed))

    def to_json(self) -> Json:
        """Return a JSON object."""
        return asdict(self)


def complete(bench: Bench, given: Json, last: Standing | None, changed: Standing | None = None) -> CampaignRequest:
    """Fill in what the client left out from the bench.

    Parameters
    ----------
    bench : Bench
    given : dict
        Fields of `CampaignRequest`; None or absent where the client says nothing.
    last : Standing or None
        Where the bench's last run has left the cell, see `standing.last_standing`.
    changed : Standing or None
        The same of the bench on which something may have changed, where that is another one.

    Raises
    ------
    BadRequestError
        Something is needed that neither client nor configuration nor an earlier run gives, or an effect cannot be left
        out.
    """
    wanted = {key: value for key, value in given.items() if value is not None}
    standing = known_standing(bench, wanted.get("initial_soc"), last)
    capacity_Ah = wanted.get("capacity_Ah", bench.config.capacity_Ah)
    low_A, high_A = bench.limits.current_A
    defaults = {
        "name": f"campaign on {bench.name}",
        "seed": 1,
        "dt_s": 1.0,
        "capacity_Ah": capacity_Ah,
        "current_A": (max(low_A, _DISCHARGE_C_RATE * capacity_Ah), min(high_A, _CHARGE_C_RATE * capacity_Ah)),
        "soc": (max(_SOC_WINDOW[0], bench.limits.soc[0]), min(_SOC_WINDOW[1], bench.limits.soc[1])),
        "structure": "auto",
    }
    stated = defaults | wanted | {"initial_soc": standing.soc, "initial_soc_from": standing.source}
    stated["without"] = _left_out(stated)
    if changed is not None:
        stated["changed_initial_soc"] = changed.soc
    stated.setdefault("duration_s", _duration_s(stated))
    return CampaignRequest(**stated)


def _left_out(stated: Json) -> tuple[str, ...]:
    """Effects that the model is to lack, checked now and not when hours of runs have been played."""
    names = tuple(dict.fromkeys(stated.get("without", ())))
    if not names:
        return ()
    if stated["structure"] not in _LEAVING_OUT:
        raise BadRequestError(
            f"effects can be left out of a bounded network only, not of structure {stated['structure']!r}",
            ("without",),
            value=", ".join(names),
            remedy=f"choose structure {' or '.join(_LEAVING_OUT)}, or leave out nothing",
        )
    from models.effects.bounded_parts import parts_of  # lazy: numpy and the catalogue, for those who ask

    try:
        parts_of(names)
    except ModelError as error:
        raise BadRequestError(str(error), ("without",)) from error
    return names


def _duration_s(stated: Json) -> float:
    """Long enough for the whole window down and up, from wherever the cell stands."""
    (low, high), (low_A, high_A) = stated["soc"], stated["current_A"]
    if not low_A < 0 < high_A:
        return _SHORTEST_S  # no plan at all: refused with its own reason
    start = min(stated["initial_soc"], stated.get("changed_initial_soc", high))
    if stated.get("rounds", 1) > 1:
        start = min(start, lowest_round_end((low, high)))
    way_Ah = (2.0 * (high - low) + high - start) * stated["capacity_Ah"]
    return max(_SHORTEST_S, float(round(_TIME_RATIO * 3600.0 * way_Ah / min(-low_A, high_A))))


def known_standing(bench: Bench, stated_soc: float | None, last: Standing | None) -> Standing:
    """Where the cell on a bench stands: as a client says, as its last run has left it, or as it is simulated.

    Raises
    ------
    BadRequestError
        Nobody knows.
    """
    if stated_soc is not None:
        return Standing(float(stated_soc), "the request")
    return last or standing_of(bench)


def standing_of(bench: Bench) -> Standing:
    """Where the cell on a bench stands that has not run yet.

    Raises
    ------
    BadRequestError
        It is real, and nobody has said.
    """
    if bench.config.simulate is not None:
        return Standing(bench.config.simulate.initial_soc, "the configuration")
    raise BadRequestError(
        "the state of charge at the start is not known: the bench's last run has not completed, or there is none",
        ("initial_soc",),
        remedy="give initial_soc as a fraction",
    )


def lowest_round_end(soc: tuple[float, float]) -> float:
    """State of charge above which a round's sequence ends: at the highest of its levels, give or take a block."""
    return soc[0] + 0.8 * (soc[1] - soc[0])
