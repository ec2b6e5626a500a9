from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_cells_table import TableError, draw, read_runs, read_table, splits_of

ROOT = Path(__file__).parents[3]
RECORD = """
[cell]
title = "a cell"
source = "a person, a DOI"
folder = "cell"
capacity_Ah = 2.0
"""
CYCLE, EXACT = '[[cell.splits]]\nname = "a"\n', 1e-9


def write_run(folder: Path, name: str, soc_ref: list[float | None] | None = None) -> None:
    """Ten samples, 360 s apart, at -1 A: 0.1 Ah each."""
    folder.mkdir(exist_ok=True)
    lines = ["time_s,current_A,voltage_V,temperature_degC" + (",soc_ref" if soc_ref else "")]
    for k in range(10):
        reference = "" if not soc_ref else f",{'' if soc_ref[k] is None else soc_ref[k]}"
        lines.append(f"{360.0 * k},{-1.0 if k else 0.0},{4.0 - 0.05 * k},25{reference}")
    (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def splits(tmp_path: Path, text: str):
    (tmp_path / "table.toml").write_text(RECORD + text, encoding="utf-8")
    return splits_of("cell", read_table(tmp_path / "table.toml")["cell"], tmp_path)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for name in ("one", "two", "three"):
        write_run(tmp_path / "cell", name)
    write_run(tmp_path / "cell", "own", [None, None, *(1.0 - 0.05 * k for k in range(8))])
    return tmp_path


def test_patterns_mean_runs_and_a_split_may_state_what_the_record_states(data: Path) -> None:
    (split,) = splits(
        data, CYCLE + 'train = ["t*"]\njudge = ["one"]\ncapacity_Ah = 3\ndt_s = 5.0\njudge_soc = [0, 0.9]'
    )
    assert list(split.train) == ["three", "two"] and list(split.judge) == ["one"]
    assert (split.capacity_Ah, split.dt_s, split.judge_soc) == (3.0, 5.0, (0.0, 0.9))


def test_random_splits_are_drawn_by_seed_and_leave_nothing_out(data: Path) -> None:
    found = splits(data, CYCLE + 'files = ["*"]\nrandom = { n = 3, train = 3, seed = 5 }')
    assert [split.name for split in found] == ["a_5", "a_6", "a_7"]
    names = ["one", "own", "three", "two"]
    for seed, split in zip((5, 6, 7), found, strict=True):
        assert (list(split.train), list(split.judge)) == draw(names[::-1], 3, seed)
        assert sorted([*split.train, *split.judge]) == names
    assert len({tuple(draw([f"r{k}" for k in range(29)], 20, seed)[0]) for seed in range(10)}) == 10


def test_a_run_starts_as_stated_by_the_first_pattern_that_fits(data: Path) -> None:
    text = '[cell.start]\none = 0.4\n"*" = 0.9\n' + CYCLE + 'train = ["one", "two"]\njudge = ["own"]'
    (split,) = splits(data, text)
    runs = read_runs(split, split.train)
    assert runs.soc == runs.initial_soc == [0.4, 0.9]
    reference = runs.with_reference(split.capacity_Ah)[0].soc_ref
    assert reference is not None and reference[0] == 0.4
    assert reference[-1] == pytest.approx(0.4 - 0.9 / 2.0, abs=EXACT)


def test_a_run_with_a_reference_of_its_own_begins_where_it_does(data: Path) -> None:
    (split,) = splits(data, CYCLE + 'train = ["one"]\njudge = ["own"]')
    runs = read_runs(split, split.judge)
    assert (runs.soc, runs.initial_soc, len(runs.series[0])) == ([1.0], None, 8)
    with pytest.raises(TableError, match="one: has no reference SoC; state its first in `start`"):
        read_runs(split, split.train)


def test_a_piece_of_a_file_begins_with_what_was_counted_before(data: Path) -> None:
    cuts = '[[cell.cuts]]\nname = "begin"\nfile = "one"\nto_s = 1000.0\n'
    cuts += '[[cell.cuts]]\nname = "end"\nfile = "one"\nfrom_s = 1000.0\n'
    (split,) = splits(data, cuts + "[cell.start]\none = 0.8\n" + CYCLE + 'train = ["begin"]\njudge = ["end"]')
    train, judge = read_runs(split, split.train), read_runs(split, split.judge)
    assert [len(runs.series[0]) for runs in (train, judge)] == [3, 7]
    assert judge.series[0].name == "end" and judge.series[0].time_s[0] == 1080.0
    assert train.soc == [0.8] and judge.soc == pytest.approx([0.8 - 0.3 / 2.0], abs=EXACT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('train = ["one"]\njudge = ["o*"]', "one is judged, but trained on in one"),
        ('train = ["four"]\njudge = ["one"]', "no run is called like four; there are one, own, three, two"),
        ('train = ["one"]', "split a: judge is missing"),
        ('train = ["one"]\njudge = ["two"]\ncolour = 1', "split a: unknown colour"),
        ('files = ["*"]\nrandom = { n = 1, train = 4, seed = 0 }', "draws 4 of 4 runs to train; leave some to judge"),
    ],
)
def test_a_table_that_contradicts_itself_is_refused(data: Path, text: str, message: str) -> None:
    with pytest.raises(TableError, match=message):
        splits(data, CYCLE + text)


def test_a_key_changes_with_what_is_judged(data: Path) -> None:
    texts = ('train = ["one"]\njudge = ["two"]', 'train = ["one"]\njudge = ["three"]')
    keys = [splits(data, CYCLE + text + more)[0].key for text in texts for more in ("", "\ndt_s = 2.0")]
    assert len(set(keys)) == 4


def test_the_own_table_reads_and_every_record_says_where_it_is_from() -> None:
    table = read_table(ROOT / "benchmarks" / "real_cells.toml")
    assert {"panasonic_18650pf", "a123_esc", "pybatteryid_nmc"} <= set(table)
    assert all(record["source"] and record["splits"] for record in table.values())
    drawn = next(split["random"] for split in table["panasonic_18650pf"]["splits"] if "random" in split)
    assert drawn == {"n": 10, "train": 20, "seed": 0}
    assert np.isclose(table["a123_esc"]["judge_soc"], [0.08, 0.97]).all()
