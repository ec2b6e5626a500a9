"""What is printed of a fit beside its errors."""

import io

from rich.console import Console

from bench_service.cli.tables import metrics_table, readout_lines, rivals_line, terms_line

METRICS = {"rmse_mV": 1.25, "mae_mV": 1.0, "p95_mV": 2.0, "max_mV": 3.0, "bias_mV": -0.1, "nrmse": 0.01, "n_samples": 7}


def test_a_row_may_know_its_rmse_only() -> None:
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(metrics_table("Runs", [("all", METRICS), ("expected", {"rmse_mV": 1.5})]))
    rows = [line.split() for line in console.export_text().splitlines()]
    assert ["all", "1.2", "1.0", "2.0", "3.0", "-0.1", "7"] in rows
    assert ["expected", "1.5"] in rows


def test_rivals_are_named_with_their_errors() -> None:
    compared = [{"structure": "bounded", "held_out_rmse_mV": 5.04}, {"structure": "full", "held_out_rmse_mV": 4.0}]
    (line,) = rivals_line({"structure": "full", "compared": compared})
    assert line == "took the full structure; expected on runs it did not see: bounded 5.0 mV, full 4.0 mV"
    assert rivals_line({"structure": "bounded", "compared": []}) == []


def test_terms_are_told_in_words_each_effect_once() -> None:
    terms = [
        {"signal": "current", "effects": [], "largest_V": 0.04},
        {"signal": "low_pass:20/0", "effects": [], "largest_V": 0.01},
        {"signal": "low_pass:200/3500", "effects": ["temperature_dependence", "relaxation"], "largest_V": 0.002},
    ]
    (line,) = terms_line(terms)
    assert line == (
        "made of: open-circuit voltage, resistance (up to 40 mV), relaxation with temperature dependence (up to 2 mV)"
    )
    assert terms_line([]) == []


def test_lines_for_a_person_leave_out_what_is_not_known() -> None:
    lines = readout_lines(
        {
            "resistance": [
                {"soc": 0.5, "temperature_degC": 25.0, "current_A": -2.5, "resistance_Ohm": 0.03, "std_Ohm": 0.001},
                {"soc": 0.5, "temperature_degC": 25.0, "current_A": 2.5, "resistance_Ohm": None, "std_Ohm": None},
            ],
            "ocv_V": [3.0, 4.1],
            "hysteresis_V": 0.004,
            "ocv_std_V": None,
            "thermal": {"heat_capacity_J_per_K": 45.0, "heat_transfer_W_per_K": 0.1, "std": {}},
            "reservations": ["resistance is not positive"],
        }
    )
    assert len(lines) == 4
    assert "30.00 ± 2 mΩ" in lines[0] and "4.0 mV" in lines[1]
    assert "45.0 J/K" in lines[2] and lines[3] == "note: resistance is not positive"
