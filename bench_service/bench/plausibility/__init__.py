"""Is what is measured possible for a cell? Pure rules over successive samples, each with a warning before its trip."""

from bench_service.bench.plausibility.band import CellBand, band_of
from bench_service.bench.plausibility.expected import ExpectedVoltage
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.sample import Sample
from bench_service.bench.plausibility.watch import Watch, observe

__all__ = ["CellBand", "ExpectedVoltage", "Finding", "Sample", "Watch", "band_of", "observe"]
