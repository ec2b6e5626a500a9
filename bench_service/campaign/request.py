"""What a campaign is asked to do, with what follows from the bench where the client says nothing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from bench_service.campaign.benches import Bench
from bench_service.errors import BadRequestError

# The mildest defaults that still show resistance and dynamics: twice the capacity out, once in.
_DISCHARGE_C_RATE = -2.0
_CHARGE_C_RATE = 1.0
_SOC_WINDOW = (0.1, 0.9)
# The live observer starts this far from the counted state of charge, so that its convergence is seen.
OBSERVER_OFFSET_SOC = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRequest:
    """A campaign: design, run, fit, observe on a second run, compare, report.

    Attributes
    ----------
    bench, name : where, and what people call it
    seed : of the random parts of both profiles
    dt_s : sampling time in s
    duration_s : of each of the two runs
    capacity_Ah : of the cell
    current_A : (low, high) that the profiles use
    soc : (low, high) window that the profiles stay in
    initial_soc : where the cell stands at the start
    structure : "full" or "minimal"
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
    structure: str

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object."""
        return asdict(self)


def complete(bench: Bench, given: dict[str, Any]) -> CampaignRequest:
    """Fill in what the client left out from the bench.

    Parameters
    ----------
    bench : Bench
    given : dict
        Fields of `CampaignRequest`; None or absent where the client says nothing.

    Raises
    ------
    BadRequestError
        Something is needed that neither client nor configuration gives.
    """
    wanted = {key: value for key, value in given.items() if value is not None}
    capacity_Ah = wanted.get("capacity_Ah", bench.config.capacity_Ah)
    low_A, high_A = bench.limits.current_A
    simulate = bench.config.simulate
    initial_soc = wanted.get("initial_soc", None if simulate is None else simulate.initial_soc)
    if initial_soc is None:
        raise BadRequestError(
            "the state of charge at the start is not known", ("initial_soc",), remedy="give initial_soc as a fraction"
        )
    defaults = {
        "name": f"campaign on {bench.name}",
        "seed": 1,
        "dt_s": 1.0,
        "duration_s": 14_000.0,
        "current_A": (max(low_A, _DISCHARGE_C_RATE * capacity_Ah), min(high_A, _CHARGE_C_RATE * capacity_Ah)),
        "soc": (max(_SOC_WINDOW[0], bench.limits.soc[0]), min(_SOC_WINDOW[1], bench.limits.soc[1])),
        "structure": "full",
    }
    return CampaignRequest(**(defaults | wanted | {"capacity_Ah": capacity_Ah, "initial_soc": float(initial_soc)}))
