import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.real_cells_summary import auto_against_best, expected_off, pooled, summary

ROOT = Path(__file__).parents[3]
TABLE = """
[lgm50]
title = "LG M50"
source = "W. D. Widanage and others"
folder = "lgm50_rate"
capacity_Ah = 5.0
judge_soc = [0.1, 0.9]
start = { "rate_*" = 1.0 }

[[lgm50.splits]]
name = "cooler"
train = ["rate_25degC_0p5C"]
judge = ["rate_10degC_0p5C"]
"""


@pytest.fixture
def board(tmp_path: Path):
    (tmp_path / "splits.toml").write_text(TABLE, encoding="utf-8")
    own = ["--data", str(ROOT / "tests" / "data"), "--splits", str(tmp_path / "splits.toml")]
    command = [sys.executable, str(ROOT / "benchmarks" / "real_cells.py"), *own]

    def call(*options: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*command, *options], capture_output=True, text=True, check=False, cwd=ROOT)

    return call


@pytest.mark.proof
def test_the_board_judges_what_can_be_fitted_and_goes_on_where_it_was(board, tmp_path: Path) -> None:
    resume = tmp_path / "rows.jsonl"
    options = ("--structures", "minimal", "no such structure", "--peers", "--resume", str(resume))
    first = board(*options, "--json")
    assert first.returncode == 0, first.stderr
    answer = json.loads(first.stdout)
    rows = {row["structure"]: row for row in answer["rows"]}
    assert "no such structure" in rows["no such structure"]["error"]
    row = rows["minimal"]
    assert row["error"] is None and (row["record"], row["split"]) == ("lgm50", "cooler")
    assert 0.0 < row["train_rmse_mV"] < 60.0
    assert row["runs"] == {"rate_10degC_0p5C": pytest.approx(row["held_out_rmse_mV"])}
    assert row["inside"]["n"] + row["outside"]["n"] > 100
    assert row["impossible"]["resistance_points"] > 0 and row["impossible"]["falling"] >= 0
    assert rows["2RC circuit"]["held_out_all_rmse_mV"] > 0.0 and rows["2RC circuit"]["impossible"] is None
    assert answer["summary"]["structures"]["no such structure"]["failed"] == 1

    # Stopped in the middle of a line; what is whole is kept, what is not is judged again.
    lines = resume.read_text(encoding="utf-8").splitlines()
    resume.write_text(lines[0] + "\n" + lines[2][:40], encoding="utf-8")
    again = board(*options[:2], "--resume", str(resume))
    assert again.returncode == 0 and again.stderr == "", again.stderr
    assert "lgm50" in again.stdout and "minimal" in again.stdout
    third = board("--structures", "no such structure", "--resume", str(resume), "--json")
    assert json.loads(resume.read_text(encoding="utf-8").splitlines()[-1])["structure"] == "no such structure"
    assert third.returncode == 0


def test_what_the_table_does_not_have_is_said_in_one_line(board) -> None:
    unknown = board("--records", "acme")
    assert unknown.returncode != 0
    assert unknown.stderr.strip().endswith("no record acme; there are lgm50")


def row(record: str, structure: str, held_out_mV: float | None, **more: object) -> dict:
    found = {"record": record, "split": "s", "structure": structure, "error": None, "seconds": 1.0}
    return found | {"held_out_rmse_mV": held_out_mV, "held_out_all_rmse_mV": held_out_mV} | more


def part(n: int, coverage: float, half_width_mV: float, rmse_mV: float) -> dict:
    return {"n": n, "coverage": coverage, "half_width_mV": half_width_mV, "rmse_mV": rmse_mV, "max_mV": rmse_mV}


def test_bands_are_pooled_by_samples() -> None:
    rows = [row("a", "full", 1.0, inside=part(100, 1.0, 30.0, 10.0), outside={"n": 0})]
    rows += [row("b", "full", 1.0, inside=part(300, 0.6, 10.0, 20.0), outside=part(10, 0.9, 50.0, 5.0))]
    found = pooled(rows)
    assert found["inside"]["coverage"] == pytest.approx(0.7)
    assert found["inside"]["width_over_rmse"] == pytest.approx(15.0 / (0.25 * 100.0 + 0.75 * 400.0) ** 0.5)
    assert found["outside"]["n"] == 10
    records = summary(rows, ["full"])["structures"]["full"]["records"]
    assert records["held"] == 1 and records["coverage"]["b"] == pytest.approx((180.0 + 9.0) / 310.0)


def test_auto_counts_where_it_is_close_to_the_best_network_that_was_fitted() -> None:
    rows = [row("a", "auto", 10.4), row("a", "full", 10.0), row("a", "minimal", 30.0), row("a", "2RC circuit", 1.0)]
    rows += [row("b", "auto", 11.0), row("b", "full", 10.0), row("b", "minimal", None, error="failed")]
    rows += [row("c", "auto", None, error="failed"), row("c", "full", 10.0), row("d", "auto", 1.0)]
    found = auto_against_best(rows, {"full", "minimal"})
    assert (found["pairs"], found["close"]) == (3, 1)
    assert [(far["record"], far["best"], far["auto_mV"]) for far in found["far"]] == [
        ("b", "full", 11.0),
        ("c", "full", None),
    ]


def test_the_expected_error_is_compared_where_one_was_stated() -> None:
    rows = [row("a", "auto", 10.0, expected_rmse_mV=12.0), row("b", "auto", 10.0, expected_rmse_mV=6.0)]
    assert expected_off([*rows, row("c", "auto", 1.0, expected_rmse_mV=None)]) == pytest.approx(0.3)
    assert expected_off([row("c", "auto", 1.0)]) is None
    here = row("d", "auto", 10.0, expected_here_rmse_mV=9.0)
    assert summary([here], ["auto"])["structures"]["auto"]["expected_here_off"] == pytest.approx(0.1)
