"""What makes simulated time move: the wall clock, or the client's lock-step register."""

import math
from collections.abc import Callable

from simulators.cycler import Cycler, ValueRefusedError

__all__ = ["CLIENT_GONE_S", "LockStepClock", "SimulatedClock", "WallClock"]

MEASURING_PERIOD_S = 1e-3  # of the simulated device: well below any tick, so that no healthy poll reads a stale value
LIMIT_CHECK_S = 0.01
MOST_CHECKS = 50  # bounds the work of one request at a high speed factor
CLIENT_GONE_S = 2.0
TICK_SPAN = 1 << 32


class WallClock:
    """Simulated time runs with a monotonic clock, times a speed factor; the device's watchdog runs without the factor.

    Parameters
    ----------
    now : Callable
        Monotonic seconds.
    speed : float
        Simulated seconds per second.
    """

    lock_step = False
    tick = 0
    period_s = 0.0

    def __init__(self, now: Callable[[], float], speed: float) -> None:
        self._now = now
        self._speed = speed
        self._start = now()
        self._periods = 0

    def poll(self, cycler: Cycler) -> bool:
        """Bring the cycler to the present; return whether it moved."""
        periods = int((self._now() - self._start) * self._speed / MEASURING_PERIOD_S)
        new = periods - self._periods
        if new <= 0:
            return False
        self._periods = periods
        checks = min(max(math.ceil(new * MEASURING_PERIOD_S / LIMIT_CHECK_S), 1), MOST_CHECKS, new)
        share, rest = divmod(new, checks)
        for index in range(checks):
            count = share + (index < rest)
            cycler.advance(count * MEASURING_PERIOD_S, count, self._speed)
        return True

    def heard(self) -> None:
        """Take note of a message: on the wall clock the device's own watchdog looks after that."""

    def check_tick(self, tick: int) -> None:
        """Refuse a lock-step tick.

        Raises
        ------
        ValueRefusedError
            If it is not zero: there is nothing to move.
        """
        if tick != 0:
            raise ValueRefusedError(f"lock-step tick {tick}, but this device runs on the wall clock")

    def move_to(self, tick: int, cycler: Cycler) -> None:
        """Do nothing: tick zero asks for no move."""

    def set_period(self, period_s: float) -> None:
        """Keep the period, which means nothing here, so that it reads back as written."""
        self.period_s = period_s


class LockStepClock:
    """Simulated time moves by one period for each tick that the client writes, and never by itself.

    Only the age of the last message is taken from the wall clock: a client gone for `CLIENT_GONE_S` trips the output.
    """

    lock_step = True

    def __init__(self, now: Callable[[], float], period_s: float = 0.1) -> None:
        self._now = now
        self._heard = now()
        self.period_s = period_s
        self.tick = 0

    def poll(self, cycler: Cycler) -> bool:
        """Trip the output if the client is gone; return whether that happened."""
        if cycler.output_on and self._now() - self._heard > CLIENT_GONE_S:
            cycler.trip("client_gone")
            return True
        return False

    def heard(self) -> None:
        """Take note of a message from the client."""
        self._heard = self._now()

    def check_tick(self, tick: int) -> None:
        """Say whether a tick would be taken.

        Raises
        ------
        ValueRefusedError
            If it is neither the last tick nor the next.
        """
        if (tick - self.tick) % TICK_SPAN > 1:
            raise ValueRefusedError(f"lock-step tick {tick} after {self.tick}; only a repeat or the next is taken")

    def move_to(self, tick: int, cycler: Cycler) -> None:
        """Move to a checked tick: one period, or nothing when it repeats the last one."""
        if tick != self.tick:
            self.tick = tick
            cycler.advance(self.period_s)

    def set_period(self, period_s: float) -> None:
        """Set the period of a tick and start counting at zero again."""
        self.period_s = period_s
        self.tick = 0


SimulatedClock = WallClock | LockStepClock
