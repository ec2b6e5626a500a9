"""More charge or energy moved than the cell can hold: a wrong capacity, a wrong current, or another cell."""

from dataclasses import dataclass

from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.sample import Sample

# Share of what the cell holds; a fresh cell holds a few percent more than it says.
WARN_SHARE, TRIP_SHARE = 1.1, 1.25


@dataclass(frozen=True, slots=True)
class Throughput:
    """Charge and energy counted from the start, and how far they have been: lowest and highest."""

    charge_Ah: float = 0.0
    low_Ah: float = 0.0
    high_Ah: float = 0.0
    energy_Wh: float = 0.0
    low_Wh: float = 0.0
    high_Wh: float = 0.0


def follow(moved: Throughput, before: Sample, now: Sample) -> Throughput:
    """Return the counts after one sample more; its current flowed since the one before."""
    hours = (now.time_s - before.time_s) / 3600.0
    charge_Ah = moved.charge_Ah + now.current_A * hours
    energy_Wh = moved.energy_Wh + now.current_A * now.voltage_V * hours
    return Throughput(
        charge_Ah,
        min(moved.low_Ah, charge_Ah),
        max(moved.high_Ah, charge_Ah),
        energy_Wh,
        min(moved.low_Wh, energy_Wh),
        max(moved.high_Wh, energy_Wh),
    )


def judge(moved: Throughput, band: CellBand) -> Finding | None:
    """Return what is not plausible about charge and energy."""
    charge_Ah, energy_Wh = moved.high_Ah - moved.low_Ah, moved.high_Wh - moved.low_Wh
    most_Wh = band.capacity_Ah * band.top_V
    remedy = "check the capacity that is stated, and the current's calibration"
    share = charge_Ah / band.capacity_Ah
    if share > WARN_SHARE:
        text = f"{charge_Ah:.4g} Ah have moved one way, the cell holds {band.capacity_Ah:.4g} Ah"
        return Finding("trip" if share > TRIP_SHARE else "warn", "charge_moved", text, remedy)
    share = energy_Wh / most_Wh
    if share > WARN_SHARE:
        text = f"{energy_Wh:.4g} Wh have moved one way, the cell holds at most {most_Wh:.4g} Wh"
        return Finding("trip" if share > TRIP_SHARE else "warn", "energy_moved", text, remedy)
    return None
