"""Rows of other people's programs on the same splits; used by `real_cells.py --peers`, see `peers.py`."""

from typing import Any

from peers import PEERS, Data, judge_peer
from real_cells_table import Split, read_runs

from models.baselines import EquivalentCircuit, fit_equivalent_circuit
from models.data.errors import ModelError
from models.data.resampling import typical_interval_s


def peer_row(split: Split, peer: str, python: str, limit_s: float) -> dict[str, Any]:
    """Fit and judge a peer; it judges all samples, not a range of SoC.

    Raises
    ------
    ModelError
        It is not installed in that interpreter, or failed.
    """
    train, judge = read_runs(split, split.train), read_runs(split, split.judge)
    own = train.with_reference(split.capacity_Ah), judge.with_reference(split.capacity_Ah)
    dt_s = split.dt_s if split.dt_s is not None else typical_interval_s(train.series)
    answer = judge_peer(
        peer, Data(*own, split.capacity_Ah, dt_s), _emf(own[0], split.capacity_Ah, dt_s), python, limit_s
    )
    if answer["failure"]:
        raise ModelError(answer["failure"])
    overall = answer["overall"]
    if overall is None:
        raise ModelError("a free run diverges")
    return {
        "held_out_rmse_mV": None if split.judge_soc else overall["rmse_mV"],
        "held_out_all_rmse_mV": overall["rmse_mV"],
        "runs": {run["run"]: run.get("rmse_mV") for run in answer["runs"]},
        "seconds": answer["fit_seconds"],
        "model": answer["model"],
        "setting": answer["setting"],
    }


def _emf(runs: list[Any], capacity_Ah: float, dt_s: float) -> EquivalentCircuit | None:
    """A circuit whose open-circuit voltage a peer may need; None where it cannot be fitted."""
    try:
        return fit_equivalent_circuit(runs, capacity_Ah=capacity_Ah, n_branches=2, dt_s=dt_s)
    except ModelError:
        return None


__all__ = ["PEERS", "peer_row"]
