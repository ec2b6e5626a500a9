"""Profiles from files."""

from pathlib import Path

import pytest

from bench_service.exchange import ProfileFileError, read_profile


def save(path: Path, *rows: str, header: str = "time_s,current_A") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_profile(tmp_path: Path) -> None:
    profile = read_profile(save(tmp_path / "pulse.csv", "0,0", "10,1.5", "20,0"))
    assert profile.name == "pulse"
    assert profile.time_s.tolist() == [0.0, 10.0, 20.0]
    assert profile.current_A.tolist() == [0.0, 1.5, 0.0]


def test_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    profile = read_profile(save(tmp_path / "p.csv", "a,0,0", "b,1.5,10", header="note,current_A,time_s"))
    assert profile.current_A.tolist() == [0.0, 1.5]


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        (["0,0", "10,nan", "20,0"], "row 3: current_A is missing (empty or NaN)"),
        (["0,0", "10,", "20,0"], "row 3: current_A is missing (empty or NaN)"),
        (["0,0", "10,inf", "20,0"], "row 3: current_A is infinite"),
        (["0,0", ",1", "20,0"], "row 3: time_s is missing"),
        (["0,0", "10,true", "20,0"], "row 3, column 'current_A': 'true' is not a number"),
        (["0,0", "10,1", "10,0"], "row 4: time_s is 10 s after 10 s; time must increase"),
        (["0,0", "10,1", "5,0"], "row 4: time_s is 5 s after 10 s; time must increase"),
        (["5,0", "10,1"], "row 2: time_s is 5 s; a profile starts at 0 s"),
        (["0,0"], "1 row(s); a profile needs at least 2"),
        ([], "0 row(s)"),
    ],
)
def test_refused(tmp_path: Path, rows: list[str], reason: str) -> None:
    with pytest.raises(ProfileFileError) as caught:
        read_profile(save(tmp_path / "p.csv", *rows))
    assert reason in str(caught.value)
    assert str(tmp_path / "p.csv") in str(caught.value)


def test_wrong_columns(tmp_path: Path) -> None:
    path = save(tmp_path / "p.csv", "0,0", header="t,i")
    with pytest.raises(ProfileFileError, match=r"needs time_s, current_A; the file has 't', 'i'"):
        read_profile(path)


def test_a_first_line_with_a_line_end_of_another_age(tmp_path: Path) -> None:
    path = tmp_path / "profile.csv"
    path.write_bytes(b"G*N\rQ,x\n1,2\n")
    with pytest.raises(ProfileFileError, match="first line cannot be read"):
        read_profile(path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ProfileFileError, match="no such file"):
        read_profile(tmp_path / "nowhere.csv")
