"""The report of a comparison: one sign of the error, figures with units, nothing of the program's own names."""

import re

import numpy as np

from bench_service.reports.comparison import comparison_report, error_row
from bench_service.reports.document import Figure, Heading, Section, render
from bench_service.reports.free_run import curve_section
from models.comparison.figures import compare
from models.comparison.simulated_runs import simulate_runs
from tests.unit.bench_service.reports.hand_result import NETWORK, RUN, SOC

HEADING = Heading("Comparison", "m against r", "C1", "sim", "Bo", "2026-01-02", "m (1)", [("Run", "r")], "Made today.")


def test_a_report_names_who_and_what_and_draws_both_voltages() -> None:
    result = dict(compare(NETWORK, [RUN], [SOC]))
    text = render(comparison_report(HEADING, NETWORK, [RUN], [SOC], result, {"run one": "the first"})).decode()
    for said in (
        "Comparison report",
        "C1",
        "sim",
        "Bo",
        "m (1)",
        "Run the first",
        "RMS error of the voltage",
        "Made today.",
    ):
        assert said in text, said
    assert "run one" not in text
    plain = re.sub(r"<style>.*?</style>|<svg.*?</svg>", "", text, flags=re.DOTALL)
    assert not re.search(r"[a-z]_[a-zA-Z]|\de[-+]\d|nan|None", plain)
    assert "http" not in text and "<script" not in text


def test_the_error_is_measured_minus_model_everywhere() -> None:
    (compared,) = simulate_runs(NETWORK, [RUN], [SOC])
    section = curve_section(compared, None, "r")
    error = section.parts[1]
    assert isinstance(section, Section) and isinstance(error, Figure) and "measured − model" in error.caption
    metrics = {
        "rmse_mV": 2.0,
        "mae_mV": 2.0,
        "p95_mV": 2.0,
        "max_mV": 2.0,
        "bias_mV": 1.5,
        "nrmse": 0.1,
        "n_samples": 9,
    }
    # Measured minus model, as everywhere: the model lies below.
    assert error_row("r", metrics)[5] == "1.50 mV"
    # Drawn the same way up: where the model lies below the measurement the curve is above zero.
    y = [float(pair.split(",")[1]) for pair in re.findall(r'<polyline[^>]*points="([^"]*)"', error.svg)[0].split()]
    expected = compared.residual_V[np.isfinite(compared.residual_V)]
    assert np.corrcoef(-np.array(y), expected)[0, 1] > 0.999
