"""Does the device hold what it was told? Pure: told of every set-point and of every sample."""

from __future__ import annotations

from collections import deque

from drivers.cycler import Reading
from drivers.errors import SetPointRefusedError

# A device tick may pass between a sample and the set-point that follows it, so only the second later
# measurement is sure to come after the set-point.
WHOLE_TICKS = 2
REMEMBERED = 64
COUNTER = 1 << 32  # values of a reading's sequence number, whatever the device's counter has


def unrolled(raw: int | None, last: int, counter: int) -> int:
    """Return the sequence number of a reading: a device's counter, which may be short, on from the reading before.

    Parameters
    ----------
    raw : int or None
        Of the device's counter; None where it has none, and readings are counted.
    last : int
        Sequence number of the reading before.
    counter : int
        How many values the device's counter has.
    """
    return (last + (1 if raw is None else (raw - last) % counter)) % COUNTER


class SetPointWatch:
    """Compares the set-point in force with those that were written.

    Parameters
    ----------
    exact : bool
        True in lock-step: the very next sample shows the new set-point. False on the wall clock: an earlier
        set-point is accepted until the device's sequence shows that a whole device tick has passed.
    """

    def __init__(self, *, exact: bool) -> None:
        self._exact = exact
        # (expected value, tolerance, sequence of the last sample before it was written), oldest first
        self._written: deque[tuple[float, float, int]] = deque(maxlen=REMEMBERED)

    def written(self, value_A: float, tolerance_A: float, sequence: int) -> None:
        """Note a set-point that was written after the sample with the given sequence number."""
        if self._exact:
            self._written.clear()
        self._written.append((value_A, tolerance_A, sequence))

    def verify(self, address: str, reading: Reading) -> None:
        """See that a sample shows the set-point that should be in force.

        Raises
        ------
        SetPointRefusedError
            With the sample, if it shows another one.
        """
        expected_A = self.check(reading.setpoint_in_force_A, reading.sequence)
        if expected_A is None:
            return
        status, alarms = (", ".join(sorted(names)) or "none" for names in (reading.status, reading.alarms))
        told = f"set-point {expected_A:g} A was written, {reading.setpoint_in_force_A:g} A is in force"
        tripped = f"the device has tripped ({alarms}): " if reading.alarms else ""
        raise SetPointRefusedError(f"{address}: {tripped}{told}; status: {status}", reading)

    def check(self, in_force_A: float, sequence: int) -> float | None:
        """Return None if the sample is as it should be, else the set-point that should be in force, in A."""
        written = self._written
        if not written:
            return None
        due = -1  # index of the newest set-point that must have been taken over
        for index in range(len(written) - 1, -1, -1):
            expected_A, tolerance_A, before = written[index]
            if abs(in_force_A - expected_A) <= tolerance_A:
                for _ in range(index):  # what is older can not come back
                    written.popleft()
                return None
            if due < 0 and (self._exact or (sequence - before) % COUNTER >= WHOLE_TICKS):
                due = index
                break
        return written[due][0] if due >= 0 else None
