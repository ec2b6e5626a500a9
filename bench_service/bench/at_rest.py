"""What a bench without a run must look like; pure."""

from drivers.cycler import Reading


def unexpected_output(bench: str, reading: Reading) -> str:
    """Return what is said of an output that is on though nothing runs."""
    return (
        f"{bench}: the output was on at {reading.current_A:.4g} A without a run; switched off. "
        "Find out who switched it on, acknowledge"
    )
