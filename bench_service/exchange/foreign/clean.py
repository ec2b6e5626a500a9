"""Faults of a record's time: a clock that falls back, rows that repeat, rests that nobody logged."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.spool import SLICE, Columns, Spool

# Loggers write two rows with one time at the edge of a step; more than this share is a clock that is too coarse.
_DUPLICATE_SHARE, _DUPLICATES_ALWAYS_ALLOWED = 0.02, 3
_GAP_S, _GAP_TIMES = 60.0, 20.0
_COUNTED = ("row", "rows")


@dataclass(slots=True)
class Faults:
    """What is wrong with the time of a record, counted while it goes by.

    Attributes
    ----------
    fell_back : rows whose clock alone falls back, each a twin of the row after it
    same, coarse : rows that repeat the row before, and rows that repeat its time with other values
    backwards : rows whose time lies before that of an earlier row
    first : kind -> (row, time before in s, its time in s)
    resets_with_step : how many of `backwards` begin a step
    gaps, longest_gap_s, pauses_s : stretches without rows; rests that the date knows of and the test time does not
    """

    first_row: int
    n: int = 0
    fell_back: int = 0
    same: int = 0
    coarse: int = 0
    backwards: int = 0
    resets_with_step: int = 0
    first: dict[str, tuple[int, float, float]] = field(default_factory=dict)
    gaps: int = 0
    longest_gap_s: float = 0.0
    pauses: int = 0
    pauses_s: float = 0.0
    usual_s: float = 0.0
    zero_start: bool = False

    def note(self, kind: str, at: int, before_s: float, time_s: float) -> None:
        """Remember the first place of a fault."""
        self.first.setdefault(kind, (self.first_row + at, before_s, time_s))


def keep_rows(spool: Spool, first_row: int, leave_out: bool) -> tuple[NDArray[np.bool_], Faults]:
    """Say which rows stay.

    Parameters
    ----------
    spool : needs time_s, current_A, voltage_V; step_count and clock where known
    first_row : line of the first row in the file
    leave_out : leave out every row whose time lies before that of an earlier one

    Returns
    -------
    tuple
        (n,) whether a row stays, and what was found.
    """
    faults = Faults(first_row)
    keep = np.ones(spool.n, dtype=np.bool_)
    last: Columns | None = None  # the last row that stayed
    for start in range(0, spool.n, SLICE):
        stop = min(start + SLICE, spool.n)
        block = spool.rows(start, min(stop + 1, spool.n))
        kept = _keep_block(block, stop - start, start, last, leave_out, faults)
        keep[start:stop] = kept
        if kept.any():
            k = int(np.flatnonzero(kept)[-1])
            last = {name: values[k : k + 1] for name, values in block.items()}
    faults.n = spool.n
    return keep, faults


def _keep_block(
    block: Columns, n: int, start: int, last: Columns | None, leave_out: bool, faults: Faults
) -> NDArray[np.bool_]:
    time = block["time_s"]
    bad = np.isnan(time[:n])
    if bad.any():
        raise RunFileError(f"line {faults.first_row + start + int(np.argmax(bad))}: the time is missing")
    before = last if last is not None else {name: values[:1] for name, values in block.items()}
    previous = np.concatenate([before["time_s"], time[: n - 1]])
    keep = np.ones(n, dtype=np.bool_)
    # One row alone whose clock has fallen back, with the values of the row after it.
    if len(time) > 1:
        m = len(time) - 1
        alone = (
            (time[:m] < previous[:m]) & (time[1:] >= previous[:m]) & _twins(block, np.arange(m), np.arange(1, m + 1))
        )
        alone = np.concatenate([alone, np.zeros(max(0, n - m), dtype=np.bool_)])[:n]
        for k in np.flatnonzero(alone)[:1]:
            faults.note("fell_back", start + int(k), float(previous[k]), float(time[k]))
        faults.fell_back += int(alone.sum())
        faults.zero_start |= bool(np.any(time[:n][alone] == 0.0))
        keep &= ~alone
    _judge_steps(block, np.flatnonzero(keep), start, before, last is not None, leave_out, keep, faults)
    return keep


def _judge_steps(
    block: Columns,
    rows: NDArray[np.intp],
    start: int,
    before: Columns,
    has_before: bool,
    leave_out: bool,
    keep: NDArray[np.bool_],
    faults: Faults,
) -> None:
    """Rows that repeat or fall back, against the highest time so far."""
    joined = {name: np.concatenate([before[name], values[rows]]) for name, values in block.items()}
    time = joined["time_s"]
    highest = np.maximum.accumulate(time)
    back, level = np.diff(time) < 0, np.diff(time) == 0
    if leave_out:
        back = (time[1:] <= highest[:-1]) & ~level
    if not has_before:
        level[:1] = back[:1] = False
    same = level & _twins(joined, np.arange(len(rows)), np.arange(1, len(rows) + 1))
    for kind, found in (("backwards", back), ("same", same), ("coarse", level & ~same)):
        for k in np.flatnonzero(found)[:1]:
            faults.note(kind, start + int(rows[k]), float(time[k]), float(time[k + 1]))
    faults.backwards += int(back.sum())
    faults.same += int(same.sum())
    faults.coarse += int((level & ~same).sum())
    if "step_count" in joined:
        faults.resets_with_step += int((back & (np.diff(joined["step_count"]) != 0)).sum())
    drop = level | (back if leave_out else np.zeros(len(back), dtype=np.bool_))
    keep[rows[drop]] = False
    _find_gaps(joined, faults)


def _find_gaps(joined: Columns, faults: Faults) -> None:
    step_s = np.diff(joined["time_s"])
    forward = step_s[step_s > 0]
    if len(forward) and faults.usual_s == 0.0:
        faults.usual_s = float(np.percentile(forward, 95.0))
    gaps = step_s[step_s > max(_GAP_S, _GAP_TIMES * faults.usual_s)]
    faults.gaps += len(gaps)
    faults.longest_gap_s = max(faults.longest_gap_s, float(gaps.max()) if len(gaps) else 0.0)
    if "clock" in joined:
        pauses = np.diff(joined["clock"]) - step_s
        pauses = pauses[(pauses > max(_GAP_S, faults.usual_s)) & (step_s >= 0)]
        faults.pauses += len(pauses)
        faults.pauses_s += float(pauses.sum())


def _twins(columns: Columns, one: NDArray[np.intp], other: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether two rows say the same but for their time."""
    equal = np.ones(len(one), dtype=np.bool_)
    for name in ("current_A", "voltage_V", "temperature_degC"):
        if name in columns:
            a, b = columns[name][one], columns[name][other]
            equal &= (a == b) | (np.isnan(a) & np.isnan(b))
    return equal


def judge_faults(where: str, faults: Faults, leave_out: bool) -> list[str]:
    """Return remarks on what was mended; refuse what only a person can settle.

    Raises
    ------
    QuestionError
        Time goes backwards, or too many rows share a time.
    """
    remarks = []
    if faults.fell_back:
        row, before_s, time_s = faults.first["fell_back"]
        zero = "to 0 s " if faults.zero_start else ""
        remarks.append(
            f"a fault of the time stamps: in {_rows(faults.fell_back)} the clock falls back {zero}for that one row and "
            f"goes on in the next, which holds the same values (first at line {row}: {before_s:.10g} s, then "
            f"{time_s:.10g} s); these rows are left out"
        )
    if faults.backwards and not leave_out:
        _ask_backwards(where, faults)
    if 2 * faults.backwards > faults.n:
        raise RunFileError(
            f"{where}: {faults.backwards} of {faults.n} rows lie before the time of an earlier one: a single wrong "
            "time, or no time at all; name another column with --column time_s=NAME"
        )
    if faults.backwards:
        remarks.append(f"{_rows(faults.backwards)} whose time lies before that of an earlier row: left out")
    if faults.same:
        row, _, time_s = faults.first["same"]
        remarks.append(f"{_rows(faults.same)} repeated word for word, first at line {row} ({time_s:.10g} s): left out")
    if faults.coarse:
        row, _, time_s = faults.first["coarse"]
        what = (
            f"{_rows(faults.coarse)} with the time of the row before and other values, first at line {row} "
            f"({time_s:.10g} s)"
        )
        if faults.coarse > max(_DUPLICATES_ALWAYS_ALLOWED, _DUPLICATE_SHARE * faults.n) and not leave_out:
            raise QuestionError(
                f"{where}: {what}: the time is too coarse, or several records are mixed; name a finer time with "
                "--column time_s=NAME, the cell with --column cell=NAME, or keep the first of each with "
                "--bad-times leave-out",
                "bad_times",
            )
        remarks.append(f"{what}: the first of each is kept")
    if faults.gaps:
        remarks.append(
            f"{faults.gaps} stretch(es) without rows, the longest {faults.longest_gap_s:.6g} s: probably a rest that "
            "was not logged; nothing is filled in"
        )
    if faults.pauses:
        remarks.append(
            f"the date moves on {faults.pauses} time(s) while the test time stands still, {faults.pauses_s:.6g} s in "
            "all: pauses that the test time does not count; name the date as time with --column time_s= to keep them"
        )
    return remarks


def _ask_backwards(where: str, faults: Faults) -> None:
    row, before_s, time_s = faults.first["backwards"]
    what = (
        f"{where}: time goes backwards {faults.backwards} time(s), first at line {row} ({before_s:.10g} s, then "
        f"{time_s:.10g} s)"
    )
    if faults.backwards > 1 and faults.resets_with_step >= 0.8 * faults.backwards:
        raise QuestionError(
            f"{what}, and does so where a step begins: that is the time in the step; name the test time with "
            "--column time_s=NAME",
            "time_s",
        )
    raise QuestionError(
        f"{what}: rows are repeated, out of order, or of several cells; name the cell's column with --column "
        "cell=NAME, or leave out every row before an earlier one's time with --bad-times leave-out",
        "bad_times",
    )


def _rows(n: int) -> str:
    return f"{n} {_COUNTED[n != 1]}"
