"""Design blocks of a protocol: made into profiles for the bench before anything is stored or played."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.fields import Fields
from bench_service.protocol.program import Window

_DT_S = 1.0


def with_designs(document: dict[str, Any], window: Window, capacity_Ah: float) -> dict[str, Any]:
    """Return a document in which every design block is the profile that it asks for.

    Parameters
    ----------
    document : dict
    window : Window
        Limits of the run.
    capacity_Ah : float
        Of the cell, where the document does not state it.

    Raises
    ------
    ProtocolError
        A request is not understood, or contradicts itself; the sequences are longer than a run may be.
    """
    own = document.get("capacity_Ah")
    capacity_Ah = own if isinstance(own, int | float) and own > 0 else capacity_Ah
    return {**document, "steps": _Designer(window, capacity_Ah).steps(document.get("steps"), ("steps",))}


class _Designer:
    """Makes the designs of one document, and no more of them than a run of it may take."""

    def __init__(self, window: Window, capacity_Ah: float) -> None:
        self._window, self._capacity_Ah, self._left_s = window, capacity_Ah, window.duration_s

    def steps(self, steps: Any, where: Where) -> Any:
        """Return steps in which every design block is a profile."""
        return [self._step(each, (*where, k)) for k, each in enumerate(steps)] if isinstance(steps, list) else steps

    def _step(self, step: Any, where: Where) -> Any:
        if not isinstance(step, Mapping):
            return step
        if step.get("step") == "design":
            return self._designed(step, where)
        if "steps" in step:
            return {**step, "steps": self.steps(step["steps"], (*where, "steps"))}
        return step

    def _designed(self, step: Mapping[str, Any], where: Where) -> dict[str, Any]:
        # Lazy: numpy's random numbers and the design take 100 ms.
        import numpy as np

        from models.data.errors import ModelError
        from models.design import StepProfileRequest, final_rest_s, step_profile

        fields = Fields(step.get("request"), (*where, "request"))
        soc, initial_soc = fields.window("soc") or (0.1, 0.9), fields.number("initial_soc", 0.0, 1.0)
        rate, duration_s = fields.positive("rate_C"), fields.positive("duration_s")
        seed, dt_s = fields.count("seed") or 1, fields.positive("dt_s") or _DT_S
        fields.done()
        if initial_soc is None or duration_s is None:
            raise ProtocolError("a design needs initial_soc and duration_s", fields.where)
        self._take(duration_s, fields.at("duration_s"))
        low_A, high_A = self._window.current_A
        most_A = (rate or 1.0) * self._capacity_Ah
        try:
            profile = step_profile(
                StepProfileRequest(
                    capacity_Ah=self._capacity_Ah,
                    current_A=(max(low_A, -most_A), min(high_A, most_A)),
                    soc=soc,
                    initial_soc=initial_soc,
                    duration_s=duration_s,
                    dt_s=dt_s,
                    final_rest_s=final_rest_s(duration_s),
                ),
                np.random.default_rng(seed),
            )
        except ModelError as error:
            raise ProtocolError(f"no design: {error}", fields.where) from error
        kept = {name: value for name, value in step.items() if name not in ("step", "request")}
        points = {"time_s": profile.time_s.tolist(), "current_A": profile.current_A.tolist()}
        return {"step": "profile", "name": "designed sequence", **kept, **points}

    def _take(self, duration_s: float, where: Where) -> None:
        # Before the design: its time and memory grow with the length that is asked for.
        if duration_s > self._left_s:
            raise ProtocolError(
                "designed sequences longer than a run may be",
                where,
                value=duration_s,
                unit="s",
                limit=self._left_s,
                remedy="shorten them, or raise the limit duration_s of the bench",
            )
        self._left_s -= duration_s
