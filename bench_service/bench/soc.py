"""Coulomb counting: the only state of charge that limits are checked against."""


def count_charge(soc: float, current_A: float, interval_s: float, capacity_Ah: float) -> float:
    """Return the state of charge after `current_A` (positive charges) has flowed for `interval_s`."""
    return soc + current_A * interval_s / (3600.0 * capacity_Ah)
