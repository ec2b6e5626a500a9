"""One scoreboard for models of real cells: every structure on every split of every record, judged on unseen runs.

``python benchmarks/real_cells.py --data FOLDER [--splits FILE] [--records NAME ...] [--only SPLIT ...]``
``                                [--structures auto full minimal bounded ...] [--peers [--peers-python PYTHON]]``
``                                [--resume FILE.jsonl] [--json]``

`real_cells.toml` names records, sources, files and splits (`real_cells_table.py` says how); `--splits` takes another
such file. For each split and structure one row: RMSE of the free run on the held-out runs (in the judged range of SoC,
and over all), on the training runs, and as the fit expected it; how many read-outs no cell can have; errors and 95 %
bands inside the trained ranges of SoC, current and temperature and outside them; seconds. A structure can also be
"full without temperature": the structure that `full` chose, without one of its signals, with size and poles chosen
again. `--peers` adds equivalent circuits, and with `--peers-python` the programs that `peers.py` says how to install.

What cannot be fitted is a row with the reason. Each row goes to the `--resume` file at once; a second call with the
same file goes on where the first was stopped, tries again what failed, and takes no row of a split that has changed.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from real_cells_judged import CIRCUITS, WITHOUT, row
from real_cells_peers import PEERS, peer_row
from real_cells_summary import line, show, summary
from real_cells_table import Split, TableError, read_table, splits_of
from row_file import Row, add_row, read_rows
from threadpoolctl import threadpool_limits

Judge = Callable[[Split], Row]

TABLE = Path(__file__).with_name("real_cells.toml")
STRUCTURES = ("auto", "full", "minimal", "bounded", "searched")


def main() -> int:
    arguments = _arguments()
    try:
        splits = _splits(arguments)
    except TableError as error:
        raise SystemExit(str(error)) from error
    with threadpool_limits(1, user_api="blas"):
        rows = list(_rows(splits, _judges(arguments), arguments.resume))
    found = summary(rows, [name for name in arguments.structures if WITHOUT not in name])
    if arguments.json:
        print(json.dumps({"rows": rows, "summary": found}))
    else:
        show(rows, found)
    return 0


def _splits(arguments: argparse.Namespace) -> list[Split]:
    table = read_table(arguments.splits)
    if unknown := set(arguments.records or ()) - set(table):
        raise TableError(f"{arguments.splits}: no record {', '.join(sorted(unknown))}; there are {', '.join(table)}")
    names = arguments.records or list(table)
    found = [split for name in names for split in splits_of(name, table[name], arguments.data)]
    kept = [split for split in found if any(fnmatchcase(split.name, only) for only in arguments.only)]
    if not kept:
        raise TableError(f"no split is called like {', '.join(arguments.only)}: {', '.join(s.name for s in found)}")
    return kept


def _judges(arguments: argparse.Namespace) -> dict[str, Judge]:
    """What is fitted and judged, by name."""
    names = [*arguments.structures, *(CIRCUITS if arguments.peers else ())]
    judges: dict[str, Judge] = {name: partial(row, structure=name) for name in names}
    if arguments.peers and arguments.peers_python:
        given = {"python": arguments.peers_python, "limit_s": arguments.peer_limit_s}
        judges |= {peer: partial(peer_row, peer=peer, **given) for peer in PEERS}
    return judges


def _rows(splits: list[Split], judges: dict[str, Judge], resume: Path | None) -> Iterator[Row]:
    done = _done(resume)
    for split in splits:
        for name, judge in judges.items():
            at = {"record": split.record, "split": split.name, "structure": name, "key": split.key}
            found = done.get(tuple(at.values()))
            if found is None:
                found = at | _tried(judge, split)
                add_row(resume, found)
                print(line(found), file=sys.stderr, flush=True)
            yield found


def _tried(judge: Judge, split: Split) -> Row:
    """A row, or the reason why there is none: hours of other rows are not lost to one that fails."""
    try:
        return {"error": None} | judge(split)
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}


def _done(resume: Path | None) -> dict[tuple[str, ...], Row]:
    """Rows without error of an earlier call."""
    names = ("record", "split", "structure", "key")
    return {tuple(each[name] for name in names): each for each in read_rows(resume) if not each["error"]}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder with the folders of the records")
    parser.add_argument("--splits", type=Path, default=TABLE, metavar="FILE", help="default: real_cells.toml")
    parser.add_argument("--records", nargs="+", metavar="NAME", help="default: all of the file")
    parser.add_argument("--only", nargs="+", metavar="SPLIT", default=["*"], help="splits by name or pattern")
    parser.add_argument("--structures", nargs="+", metavar="NAME", default=list(STRUCTURES))
    parser.add_argument("--peers", action="store_true", help="also equivalent circuits, and the programs of others")
    parser.add_argument("--peers-python", metavar="PYTHON", help="interpreter that has those programs")
    parser.add_argument("--peer-limit-s", type=float, default=300.0, help="after this a peer tries no further setting")
    parser.add_argument("--resume", type=Path, metavar="FILE.jsonl", help="one line for each row; go on where it ends")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
