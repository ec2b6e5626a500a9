"""All that is put right in a log's time stamps, with what is said of it."""

from __future__ import annotations

from models.data.stamps.cut_rests import with_cut_rests
from models.data.stamps.on_change import held_until_next
from models.data.timeseries import TimeSeries


def with_stamps_put_right(run: TimeSeries) -> tuple[TimeSeries, list[str]]:
    """Put right how long values hold and which rests are missing.

    Returns
    -------
    run, remarks
        The run as it is, and nothing, where its time stamps are in order.
    """
    remarks = []
    # A log without its rests looks like one that is written on change, but for its voltage.
    cut = with_cut_rests(run)
    if not cut.kept_s:
        held = held_until_next(run)
        cut = cut if held is run else with_cut_rests(held)
        if held is not run:
            remarks.append(
                f"{run.name}: written on change: each current is taken to hold until the next row "
                f"({len(held) - len(run)} changes after long intervals)"
            )
    if cut.kept_s:
        remarks.append(
            f"{run.name}: {len(cut.kept_s)} rest(s) are missing from the log, the longest of {max(cut.kept_s):.0f} s: "
            "the voltage comes back over the gap, so nothing is taken to have flowed there"
        )
    if cut.guessed_s:
        remarks.append(
            f"{run.name}: the voltage jumps {len(cut.guessed_s)} time(s) at an even current, as after a rest that "
            f"was cut out of the time as well: rests of an estimated {min(cut.guessed_s):.0f} to "
            f"{max(cut.guessed_s):.0f} s are put in there; keep the rests in the log"
        )
    return cut.run, remarks
