"""The temperature chamber of a bench, from its configuration to what bench and protocols know of it."""

from __future__ import annotations

from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.config import BenchConfig
from bench_service.protocol.program import ChamberWindow


def chamber_settings(config: BenchConfig, simulated_url: str | None) -> ChamberSettings | None:
    """Return what the control process needs to know; None where there is no chamber.

    Parameters
    ----------
    config : BenchConfig
    simulated_url : str or None
        Where the simulator serves it, if it is simulated.
    """
    chamber, window = config.chamber, config.chamber_degC
    if chamber is None or window is None:
        return None
    return ChamberSettings(
        url=chamber.url or simulated_url or "",
        map=chamber.map,
        temperature_degC=window,
        tolerance_K=chamber.tolerance_K,
        overshoot_K=chamber.overshoot_K,
        timeout_s=chamber.timeout_s,
        lost_s=chamber.lost_s,
        at_end=chamber.at_end,
    )


def chamber_window(config: BenchConfig) -> ChamberWindow | None:
    """Return what protocols may ask of the chamber; None where there is none."""
    window = config.chamber_degC
    return None if config.chamber is None or window is None else ChamberWindow(window, config.chamber.tolerance_K)
