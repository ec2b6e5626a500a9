"""Which records there are, how they are split, and their runs as a fit takes them; used by `real_cells.py`.

The file names for each record: `title`, `source` (author and DOI), `folder` (below the data), `capacity_Ah`, where
needed `dt_s` (grid of the model), `start` (SoC at the start of each run that has no reference of its own, by pattern),
`judge_soc` (range of SoC that the judgement is about), `cuts` (pieces of a file under names of their own) and `splits`.
A split has a `name`, `train` and `judge` (patterns of run names); or `files` and `random`, which draws `n` splits with
`train` runs to train and all others to judge, the i-th by seed `seed` + i. It may state its own `capacity_Ah`, `dt_s`,
`start` and `judge_soc`.
"""

import hashlib
import json
import tomllib
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.exchange.read import read_run, run_name
from models.data.timeseries import FloatArray, TimeSeries

_COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
_OWN = ("capacity_Ah", "dt_s", "start", "judge_soc")
_RECORD = {"title", "source", "folder", "cuts", "splits", *_OWN}
_SPLIT = {"name", "train", "judge", "files", "random", *_OWN}
_CUT = {"name", "file", "from_s", "to_s"}
_RANDOM = {"n", "train", "seed"}


class TableError(ValueError):
    """A table of records that contradicts itself or the files; the message says where and what to do."""


@dataclass(frozen=True)
class Piece:
    """A run: a file, or what lies between two times of it in s."""

    file: Path
    from_s: float = -np.inf
    to_s: float = np.inf

    def overlaps(self, other: "Piece") -> bool:
        """Whether both hold samples of the same moments."""
        return self.file == other.file and self.from_s < other.to_s and other.from_s < self.to_s


@dataclass(frozen=True)
class Split:
    """What one judgement needs.

    Attributes
    ----------
    record, name : of which record, and what it is called
    capacity_Ah : of the cell
    dt_s : grid of the model in s; None: the typical interval of the training runs
    start : SoC at the start of a run by pattern, where the file has no reference of its own
    judge_soc : range of SoC that the judgement is about; None: all
    train, judge : pieces by their names
    """

    record: str
    name: str
    capacity_Ah: float
    dt_s: float | None
    start: dict[str, float]
    judge_soc: tuple[float, float] | None
    train: dict[str, Piece]
    judge: dict[str, Piece]

    @property
    def key(self) -> str:
        """What the split says, in 12 letters: a row with another key is of another split."""
        said = asdict(self) | {"train": sorted(self.train), "judge": sorted(self.judge)}
        spans = [(p.from_s, p.to_s) for part in (self.train, self.judge) for p in part.values()]
        return hashlib.sha256(json.dumps([said, spans], sort_keys=True).encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Runs:
    """Runs of one part of a split, and the SoC at which each begins."""

    series: list[TimeSeries]
    soc: list[float]
    stated: bool

    @property
    def initial_soc(self) -> list[float] | None:
        """What a fit is told: None where every file carries its own reference."""
        return self.soc if self.stated else None

    def with_reference(self, capacity_Ah: float) -> list[TimeSeries]:
        """The runs, each with a counted reference: for programs that take no initial SoC."""
        return [
            run if run.soc_ref is not None else replace(run, soc_ref=soc + _counted_Ah(run) / capacity_Ah)
            for run, soc in zip(self.series, self.soc, strict=True)
        ]


def read_table(path: Path) -> dict[str, dict[str, Any]]:
    """Records by name, their keys checked.

    Raises
    ------
    TableError
        No such file, no TOML, a key that is missing or unknown.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise TableError(f"{path}: {error}") from error
    for name, record in table.items():
        _check(f"{path}: {name}", record, _RECORD, {"title", "source", "folder", "capacity_Ah", "splits"})
        for cut in record.get("cuts", []):
            _check(f"{path}: {name}: cut {cut.get('name')}", cut, _CUT, {"name", "file"})
        for split in record["splits"]:
            where = f"{path}: {name}: split {split.get('name')}"
            drawn = "random" in split
            _check(where, split, _SPLIT, {"name", "files", "random"} if drawn else {"name", "train", "judge"})
            if drawn:
                _check(f"{where}: random", split["random"], _RANDOM, _RANDOM)
    return table


def splits_of(name: str, record: dict[str, Any], data: Path) -> list[Split]:
    """Every split of a record, with the files that it means.

    Raises
    ------
    TableError
        The folder is not there, a pattern means no file, or a piece is both trained on and judged.
    """
    pieces = _pieces(name, record, data)
    found = []
    for split in record["splits"]:
        where = f"{name}: split {split['name']}"
        if "random" not in split:
            train, judge = (_matching(where, pieces, split[role]) for role in ("train", "judge"))
            found.append(_split(name, record, split, pieces, (train, judge)))
            continue
        files, random = _matching(where, pieces, split["files"]), split["random"]
        if not 0 < random["train"] < len(files):
            raise TableError(f"{where}: draws {random['train']} of {len(files)} runs to train; leave some to judge")
        for seed in range(random["seed"], random["seed"] + random["n"]):
            own = split | {"name": f"{split['name']}_{seed}"}
            found.append(_split(name, record, own, pieces, draw(files, random["train"], seed)))
    return found


def draw(files: list[str], n_train: int, seed: int) -> tuple[list[str], list[str]]:
    """Names to train and names to judge, by a seed and the names alone."""
    names = sorted(files)
    order = np.random.default_rng(seed).permutation(len(names))
    return sorted(names[k] for k in order[:n_train]), sorted(names[k] for k in order[n_train:])


def read_runs(split: Split, part: dict[str, Piece]) -> Runs:
    """Read the runs of a part, cut to where their SoC is known.

    Raises
    ------
    TableError
        A run whose SoC nobody states.
    """
    series, soc, stated = [], [], False
    for name, piece in part.items():
        whole = replace(read_cached(piece.file), name=name)
        whole, start, own = _started(split, whole, piece.file)
        inside = (whole.time_s >= piece.from_s) & (whole.time_s < piece.to_s)
        if inside.sum() < 2:
            raise TableError(f"{split.record}: {name}: {piece.from_s:g} to {piece.to_s:g} s of {piece.file} is empty")
        series.append(_cut(whole, inside))
        soc.append(start + float(_counted_Ah(whole)[int(np.argmax(inside))]) / split.capacity_Ah)
        stated |= not own
    return Runs(series, soc, stated)


@cache
def read_cached(path: Path) -> TimeSeries:
    """A file's run; random splits read the same files again and again."""
    return read_run(path)


def _started(split: Split, run: TimeSeries, file: Path) -> tuple[TimeSeries, float, bool]:
    """The run from where its SoC is known, that SoC, and whether the file itself says so."""
    for pattern, start in split.start.items():
        if fnmatchcase(run.name, pattern) or fnmatchcase(run_name(file), pattern):
            return replace(run, soc_ref=None), start, False
    if run.soc_ref is None:
        raise TableError(f"{split.record}: {run.name}: has no reference SoC; state its first in `start`")
    known = ~np.isnan(run.soc_ref)
    first = int(np.argmax(known))
    return _cut(run, np.arange(len(run)) >= first), float(run.soc_ref[first]), True


def _cut(run: TimeSeries, keep: np.ndarray) -> TimeSeries:
    if keep.all():
        return run
    columns = {key: None if getattr(run, key) is None else getattr(run, key)[keep] for key in _COLUMNS}
    return replace(run, **columns)


def _counted_Ah(run: TimeSeries) -> FloatArray:
    """(n,) charge since the first sample; each current holds backward."""
    flowed = np.nan_to_num(run.current_A[1:]) * np.diff(run.time_s)
    return np.concatenate([[0.0], np.cumsum(flowed)]) / 3600.0


def _pieces(name: str, record: dict[str, Any], data: Path) -> dict[str, Piece]:
    folder = data / record["folder"]
    if not folder.is_dir():
        raise TableError(f"{name}: no folder {folder}; name the one that holds the records with --data")
    pieces = {run_name(path): Piece(path) for path in sorted(folder.iterdir()) if path.is_file()}
    for cut in record.get("cuts", []):
        if cut["file"] not in pieces:
            raise TableError(f"{name}: cut {cut['name']}: no run {cut['file']} in {folder}")
        whole = pieces[cut["file"]]
        pieces[cut["name"]] = replace(whole, from_s=cut.get("from_s", -np.inf), to_s=cut.get("to_s", np.inf))
    return pieces


def _matching(where: str, pieces: dict[str, Piece], patterns: list[str]) -> list[str]:
    found = {pattern: [name for name in pieces if fnmatchcase(name, pattern)] for pattern in patterns}
    for pattern, names in found.items():
        if not names:
            raise TableError(f"{where}: no run is called like {pattern}; there are {', '.join(sorted(pieces)[:8])} ...")
    return sorted({name for names in found.values() for name in names})


def _split(
    name: str,
    record: dict[str, Any],
    split: dict[str, Any],
    pieces: dict[str, Piece],
    parts: tuple[list[str], list[str]],
) -> Split:
    own: dict[str, Any] = {key: split.get(key, record.get(key)) for key in _OWN}
    train, judge = ({each: pieces[each] for each in part} for part in parts)
    for a, piece in train.items():
        for b, other in judge.items():
            if piece.overlaps(other):
                raise TableError(f"{name}: split {split['name']}: {b} is judged, but trained on in {a}")
    return Split(
        record=name,
        name=split["name"],
        capacity_Ah=float(own["capacity_Ah"]),
        dt_s=own["dt_s"],
        start=own["start"] or {},
        judge_soc=None if own["judge_soc"] is None else (float(own["judge_soc"][0]), float(own["judge_soc"][1])),
        train=train,
        judge=judge,
    )


def _check(where: str, given: dict[str, Any], known: set[str], needed: set[str]) -> None:
    if unknown := set(given) - known:
        raise TableError(f"{where}: unknown {', '.join(sorted(unknown))}; known are {', '.join(sorted(known))}")
    if missing := needed - set(given):
        raise TableError(f"{where}: {', '.join(sorted(missing))} is missing")
