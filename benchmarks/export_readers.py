"""Reads exported runs with the readers of others; needs numpy and whichever of those are installed.

``python export_readers.py FOLDER``, in an environment of its own. `FOLDER/request.json` names the file of each format.
Written are `FOLDER/ANSWER_K.npz`, a column under each name that the reader gives it, and `FOLDER/answer.json`: for each
reading its format, reader, version, arrays, units where the file states them, and what the reader complains of.
"""

import csv
import hashlib
import importlib
import io
import json
import os
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

Columns = dict[str, Any]
# What a reader found: columns, units, and what it complains of.
Found = tuple[Columns, dict[str, str], list[str]]
_BDF = ("bdf", "bdf-parquet", "bdf-0.1.0", "bdf-parquet-0.1.0")
_TEXT = ("csv", "bdf", "bdf-0.1.0")
_PARQUET = ("parquet", "bdf-parquet", "bdf-parquet-0.1.0")
# Checks that the vocabulary itself can be fetched.
_ONLINE = ("ro-crate-1.1_3.1", "ro-crate-1.1_3.2")
_VOCABULARY = "https://w3id.org/ro/crate/"


def main() -> int:
    folder = Path(sys.argv[1])
    request: dict[str, str] = json.loads((folder / "request.json").read_text())
    answers = []
    for package, (kinds, read) in READERS.items():
        try:
            told = version(package)
            module = importlib.import_module(MODULES.get(package, package))
        except (PackageNotFoundError, ImportError):
            continue
        told += " and later" if package == "batterydf" and hasattr(module, "scan") else ""
        for kind in kinds:
            if kind in request:
                answers.append({"format": kind, "reader": package, "version": told} | _read(read, Path(request[kind])))
                np.savez(folder / f"answer_{len(answers) - 1}.npz", **answers[-1].pop("columns"))
    (folder / "answer.json").write_text(json.dumps(answers))
    return 0


def _read(read: Callable[[Path], Found], path: Path) -> dict[str, Any]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        try:
            columns, units, complaints = read(path)
        except Exception as error:  # whatever a foreign reader makes of the file is the answer
            return {"columns": {}, "units": {}, "complaints": [f"{type(error).__name__}: {str(error)[:300]}"]}
    complaints += [str(each.message) for each in caught if issubclass(each.category, UserWarning)]
    arrays = {name: np.asarray(values, dtype=np.float64).ravel() for name, values in columns.items()}
    return {"columns": arrays, "units": units, "complaints": complaints}


def by_pandas(path: Path) -> Found:
    """Text and Parquet as most people read them."""
    import pandas  # pyright: ignore[reportMissingImports]

    text = path.suffix == ".csv"
    # Its default takes the last digit for granted.
    frame = pandas.read_csv(path, float_precision="round_trip") if text else pandas.read_parquet(path)
    return {str(name): frame[name].to_numpy() for name in frame}, {}, []


def by_polars(path: Path) -> Found:
    """Text and Parquet by a reader in Rust."""
    import polars  # pyright: ignore[reportMissingImports]

    text = path.suffix == ".csv"
    # A column that begins with whole numbers has others further down.
    frame = polars.read_csv(path, infer_schema_length=None) if text else polars.read_parquet(path)
    return {name: frame[name].cast(polars.Float64).fill_null(np.nan).to_numpy() for name in frame.columns}, {}, []


def by_fastparquet(path: Path) -> Found:
    """Parquet by a reader that is not Arrow."""
    import fastparquet  # pyright: ignore[reportMissingImports]

    frame = fastparquet.ParquetFile(str(path)).to_pandas()
    return {str(name): frame[name].to_numpy(dtype=float, na_value=np.nan) for name in frame}, {}, []


def by_batterydf(path: Path) -> Found:
    """The Battery Data Format by the package of those who made it: its reader, its check, its metadata file."""
    import bdf  # pyright: ignore[reportMissingImports]

    wanted_old = "0.1.0" in path.parent.name
    read = bdf.read(path)
    if not isinstance(read, tuple):  # 0.1.0: a frame of pandas
        from bdf.validate import validate_df  # pyright: ignore[reportMissingImports]

        report = validate_df(read)
        complaints = [] if report["ok"] else [f"missing: {report['missing']}"]
        if wanted_old and report["extras"]:
            complaints.append(f"does not know {report['extras']}")
        return {name: read[name].to_numpy(dtype=float) for name in read}, {}, complaints
    frame, metadata = read
    report = bdf.validate(path)
    raw = json.loads(metadata.model_dump_json())["raw"]
    complaints = [] if report["ok"] else [str(report)]
    complaints += [] if wanted_old or not report.get("extras") else [f"does not know {report['extras']}"]
    complaints += [] if raw and raw["current_sign"] == "positive charges" else ["its metadata file was not read"]
    return {name: frame[name].fill_null(np.nan).to_numpy() for name in frame.columns}, {}, complaints


def by_scipy(path: Path) -> Found:
    """MAT by the package that has written it too."""
    from scipy.io import loadmat

    return {name: values for name, values in loadmat(path).items() if not name.startswith("__")}, {}, []


def by_mat4py(path: Path) -> Found:
    """MAT by a reader in Python alone."""
    import mat4py  # pyright: ignore[reportMissingImports]

    return dict(mat4py.loadmat(str(path))), {}, []


def by_asammdf(path: Path) -> Found:
    """MDF by the package that has written it too; the time is each channel's own."""
    from asammdf import MDF

    columns: Columns = {}
    units: dict[str, str] = {}
    with MDF(path) as file:
        for signal in file.iter_channels():
            columns[signal.name], units[signal.name] = signal.samples, signal.unit
            columns["time_s"] = signal.timestamps
        columns["started_unix_s"] = [file.start_time.timestamp()]
    return columns, units, []


def by_mdfreader(path: Path) -> Found:
    """MDF by a reader that shares nothing with the writer."""
    import mdfreader  # pyright: ignore[reportMissingImports]

    file = mdfreader.Mdf(str(path))
    names = [name for name in file if name != "time"]
    columns = {name: file.get_channel_data(name) for name in names}
    masters = {file.get_channel_master(name) for name in names}
    complaints = [] if masters == {"time"} else [f"channels are over {masters}"]
    units = {name: file.get_channel_unit(name) or "" for name in names}
    columns["started_unix_s"] = [mdfreader.MdfInfo(str(path))["HD"]["hd_start_time_ns"] * 1e-9]
    return columns | {"time_s": file.get_channel_data("time")}, units, complaints


def by_rocrate(path: Path) -> Found:
    """A bundle: each file that it names is there with its size and hash, and no other; its samples are read as text."""
    from rocrate.rocrate import ROCrate  # pyright: ignore[reportMissingImports]

    crate, complaints, columns = ROCrate(str(path)), [], {}
    with zipfile.ZipFile(path) as bundle:
        held = {name: bundle.read(name) for name in bundle.namelist()}
    named = {entity.id: entity for entity in crate.data_entities}
    if odd := set(held) - {"ro-crate-metadata.json"} ^ set(named):
        complaints.append(f"named and not there, or the other way round: {sorted(odd)}")
    for name, entity in named.items():
        content = held.get(name, b"")
        truth = (hashlib.sha256(content).hexdigest(), str(len(content)))
        if (entity.get("sha256"), entity.get("contentSize")) != truth:
            complaints.append(f"{name}: another hash or size than it says")
    known = {entity.id for entity in crate.get_entities()}
    for action in (entity for entity in crate.get_entities() if entity.type == "CreateAction"):
        ends = [value for key in ("object", "result", "instrument") for value in _listed(action.get(key))]
        complaints += [f"{action.id} points to {end}" for end in ends if getattr(end, "id", end) not in known]
    for name in named:
        if name.endswith(".csv") and name.startswith("data/"):
            rows = list(csv.reader(io.StringIO(held[name].decode())))
            table = np.array([[float(cell or "nan") for cell in row] for row in rows[1:]])
            columns |= {title: table[:, k] for k, title in enumerate(rows[0])}
    return columns, {}, complaints


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def by_validator(path: Path) -> Found:
    """A bundle by the RO-Crate validator, all that the specification requires and recommends."""
    from rocrate_validator import models, services  # pyright: ignore[reportMissingImports]

    offline = not _reachable()
    settings = models.ValidationSettings(
        rocrate_uri=str(path),
        profile_identifier="ro-crate-1.1",
        requirement_severity=models.Severity.RECOMMENDED,
        skip_checks=list(_ONLINE) if offline else [],
    )
    os.environ.setdefault("NO_COLOR", "1")
    with _own_vocabulary() if offline else _nothing():
        issues = services.validate(settings).get_issues()
    return {}, {}, [f"{issue.severity.name.lower()}: {issue.message}" for issue in issues]


def _reachable() -> bool:
    import urllib.request

    try:
        urllib.request.urlopen(f"{_VOCABULARY}1.1/context", timeout=5).close()
    except OSError:
        return False
    return True


@contextmanager
def _nothing() -> Iterator[None]:
    yield


@contextmanager
def _own_vocabulary() -> Iterator[None]:
    """Without a network the terms are those of the copy that the package rocrate brings."""
    import rocrate  # pyright: ignore[reportMissingImports]
    from rdflib.plugins.shared.jsonld.context import Context  # pyright: ignore[reportMissingImports]

    document = json.loads(Path(rocrate.__file__ or "", "..", "data", "ro-crate.jsonld").resolve().read_text())
    own = Context._fetch_context  # noqa: SLF001  # the package has no other place where it can be told

    def fetch(self: Any, source: str, *more: Any) -> Any:
        return document["@context"] if str(source).startswith(_VOCABULARY) else own(self, source, *more)

    Context._fetch_context = fetch  # noqa: SLF001
    try:
        yield
    finally:
        Context._fetch_context = own  # noqa: SLF001


READERS: dict[str, tuple[tuple[str, ...], Callable[[Path], Found]]] = {
    "batterydf": (_BDF, by_batterydf),
    "pandas": ((*_TEXT, *_PARQUET), by_pandas),
    "polars": ((*_TEXT, *_PARQUET), by_polars),
    "fastparquet": (_PARQUET, by_fastparquet),
    "scipy": (("mat",), by_scipy),
    "mat4py": (("mat",), by_mat4py),
    "asammdf": (("mdf4",), by_asammdf),
    "mdfreader": (("mdf4",), by_mdfreader),
    "rocrate": (("ro-crate",), by_rocrate),
    "roc-validator": (("ro-crate",), by_validator),
}
MODULES = {"batterydf": "bdf", "roc-validator": "rocrate_validator"}

if __name__ == "__main__":
    sys.exit(main())
