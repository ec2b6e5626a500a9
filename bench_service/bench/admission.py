"""What is checked before the first command of a run; the same rules as in the API, once more at the cycler."""

import math

import numpy as np

from bench_service.bench.player import Player
from bench_service.bench.request import RunRequest
from bench_service.bench.safety import SOC_TOLERANCE
from bench_service.bench.settings import LONGEST_WATCHDOG_S, BenchSettings
from drivers.cycler import Capabilities

# The heartbeat must come at least this often within the device's watchdog.
_TICKS_PER_WATCHDOG = 3
_TICK_TOLERANCE = 1e-9


class RefusedError(Exception):
    """A run that must not start; the message says why and what to do."""


def check_start(
    settings: BenchSettings, capabilities: Capabilities, request: RunRequest, player: Player | None = None
) -> None:
    """Check a run before any command is sent; a protocol, which has no player, checks its steps itself.

    Raises
    ------
    RefusedError
        The first reason not to start.
    """
    _check_request(request)
    check_watchdog(settings, capabilities)
    if not capabilities.has_temperature:
        low, high = request.limits.temperature_degC
        raise RefusedError(
            f"{capabilities.name} measures no temperature of the cell, so limits of {low:g} to {high:g} degC cannot "
            "be watched; use a cycler, or a map of it, with a sensor at the cell (role 'temperature')"
        )
    if outside := request.limits.wider_than(settings.limits):
        raise RefusedError(f"the run's limits leave the bench's: {outside}; narrow them")
    if settings.lock_step and not capabilities.lock_step:
        raise RefusedError("lock-step is configured, but the device has none; remove lock_step")
    if player is None:
        return
    _check_currents(request, capabilities, player)
    _check_charge(request, player)
    duration_s = player.n_ticks * player.dt_s
    if not (duration_s <= request.limits.duration_s + _TICK_TOLERANCE):
        raise RefusedError(f"profile lasts {duration_s:g} s, limit {request.limits.duration_s:g} s; shorten it")


def ticks_per_sample(dt_s: float, watchdog_s: float, lock_step: bool) -> int:
    """Return how many control ticks there are to one recorded sample.

    On the wall clock the device's watchdog needs a heartbeat from a fresh sample at least every third of its time,
    even where samples are recorded less often.
    """
    if lock_step:
        return 1
    return max(1, math.ceil(_TICKS_PER_WATCHDOG * dt_s / watchdog_s - _TICK_TOLERANCE))


def _check_request(request: RunRequest) -> None:
    if not (0 < request.capacity_Ah < math.inf):
        raise RefusedError(f"capacity {request.capacity_Ah} Ah must be positive")
    if not (0 <= request.settle_s < math.inf):
        raise RefusedError(f"settling time {request.settle_s} s must not be negative")
    if request.stale_limit < 1:
        raise RefusedError(f"stale_limit {request.stale_limit} must be at least 1")
    if request.initial_soc is not None and not (0 <= request.initial_soc <= 1):
        raise RefusedError(f"initial state of charge {request.initial_soc} must be 0 to 1")


def check_watchdog(settings: BenchSettings, capabilities: Capabilities) -> None:
    """Raise `RefusedError` where the device does not switch itself off soon enough and nothing else does."""
    if settings.external_interlock:
        return
    remedy = "set external_interlock = true only if hardware of its own cuts the cell off"
    if capabilities.watchdog_s is None:
        raise RefusedError(f"{capabilities.name} has no communication watchdog; {remedy}")
    if not (settings.watchdog_s <= LONGEST_WATCHDOG_S):
        raise RefusedError(
            f"watchdog of {settings.watchdog_s:g} s is over {LONGEST_WATCHDOG_S:g} s; shorten it, or {remedy}"
        )
    low, high = capabilities.watchdog_s
    if not (low <= settings.watchdog_s <= high):
        raise RefusedError(
            f"watchdog of {settings.watchdog_s:g} s is outside the device's {low:g} to {high:g} s; change watchdog_s"
        )


def _check_currents(request: RunRequest, capabilities: Capabilities, player: Player) -> None:
    for owner, (low, high) in (("run's", request.limits.current_A), ("device's", capabilities.current_A)):
        for tick, value in enumerate(player.setpoint_A):
            if not (low <= value <= high):
                raise RefusedError(
                    f"profile wants {value:g} A at {tick * player.dt_s:g} s, the {owner} limits are "
                    f"{low:g} to {high:g} A; change the profile"
                )
    ramp = request.limits.ramp_A_per_s
    if ramp is None:
        return
    steps = np.abs(np.diff((0.0, *player.setpoint_A)))
    worst = int(np.argmax(steps))
    if not (steps[worst] <= ramp * player.dt_s * (1 + _TICK_TOLERANCE)):
        raise RefusedError(
            f"profile changes by {steps[worst]:g} A within {player.dt_s:g} s at {worst * player.dt_s:g} s, "
            f"limit {ramp:g} A/s; make it gentler"
        )


def _check_charge(request: RunRequest, player: Player) -> None:
    if request.initial_soc is None:
        return
    path = request.initial_soc + np.cumsum((0.0, *player.setpoint_A)) * player.dt_s / (3600 * request.capacity_Ah)
    low, high = request.limits.soc
    lowest, highest = float(path.min()), float(path.max())
    if not (low - SOC_TOLERANCE <= lowest and highest <= high + SOC_TOLERANCE):
        raise RefusedError(
            f"profile moves the state of charge from {request.initial_soc:.3f} through {lowest:.3f} to "
            f"{highest:.3f}, limits {low:g} to {high:g}; change the profile or the initial state of charge"
        )
