"""The current at which a cell has a given voltage: what a device's own controller finds."""

from simulators.cell import TruthCell

__all__ = ["held_current_A"]

_NEAR_V = 1e-5
_ROUNDS = 12


def held_current_A(cell: TruthCell, hold_V: float, set_A: float) -> float:
    """Return the current between none and `set_A` with which the voltage is not beyond `hold_V`.

    Beyond is above while charging and below while discharging; the cell is only looked at, for 0 s.
    """
    sign = 1.0 if set_A > 0.0 else -1.0

    def beyond_V(current_A: float) -> float:
        return (cell.step(current_A, 0.0).voltage_V - hold_V) * sign

    low_A, low_V = set_A, beyond_V(set_A)
    if low_V <= 0.0:
        return set_A
    high_A, high_V = 0.0, beyond_V(0.0)
    if high_V >= 0.0:
        return 0.0
    # False position: the voltage is nearly a straight line of the current.
    current_A = 0.0
    for _ in range(_ROUNDS):
        current_A = high_A - high_V * (low_A - high_A) / (low_V - high_V)
        off_V = beyond_V(current_A)
        if abs(off_V) < _NEAR_V:
            break
        if off_V > 0.0:
            low_A, low_V = current_A, off_V
        else:
            high_A, high_V = current_A, off_V
    return current_A
