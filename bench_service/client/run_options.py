"""What may be said about a run beside bench, profile, sampling time and initial state of charge."""

from __future__ import annotations

from typing import TypedDict

from bench_service.client.connection import Record


class RunOptions(TypedDict, total=False):
    """Options of a run; what is left out or None the service decides.

    ``limits`` names only what is narrower than the bench's own. With ``model_id`` the observer runs live, starting at
    ``observer_initial_soc``, with ``observer_gain`` ("kalman" or "steady"). With ``finish_alone`` the run plays on
    where the service is gone; else it comes to rest. With ``learn`` the newest version of the model is used, and it
    learns from the run when that is completed.
    ``band`` names a model whose band the voltage must not leave: ``model_id``, ``margin_V``, ``for_s``.
    ``protocol_id`` is played in place of a profile; ``continues`` names the run of it that is taken up again where it
    was cut off, and ``on_interruption="resume"`` lets that happen by itself when the service starts.
    ``cell_id`` names the cell that must be on the bench; where another one is there the run is refused.
    """

    limits: Record | None
    model_id: str | None
    observer_initial_soc: float | None
    observer_gain: str | None
    name: str | None
    seed: int | None
    finish_alone: bool
    learn: bool
    band: Record | None
    protocol_id: str | None
    continues: str | None
    on_interruption: str | None
    cell_id: str | None
