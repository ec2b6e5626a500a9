"""Reads files of cyclers with the readers of others; needs numpy and whichever of batterydf and PyProBE is installed.

``python import_readers.py FOLDER FILE...``, in an environment of its own. Written are `FOLDER/K.npz` (time_s,
current_A, voltage_V as the reader has them) and `FOLDER/answer.json`: file, reader, version, what it complains of.
"""

import json
import sys
import tempfile
import warnings
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

OURS = ("time_s", "current_A", "voltage_V")
# PyProBE is told the cycler.
CYCLERS = {"arbin": "arbin", "maccor": "maccor", "basytec": "basytec", "novonix": "novonix", "biologic": "biologic"}


def main() -> int:
    folder, files = Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]
    answers = []
    for package, read in {"batterydf": by_batterydf, "PyProBE-Data": by_pyprobe}.items():
        try:
            told = version(package)
        except PackageNotFoundError:
            continue
        told += " and later" if package == "batterydf" and find_spec("bdf.plugins") else ""
        for file in files:
            answer, columns = _read(read, file)
            answers.append({"file": file.name, "reader": package, "version": told} | answer)
            np.savez(folder / f"{len(answers) - 1}.npz", **columns)
    (folder / "answer.json").write_text(json.dumps(answers))
    return 0


def _read(read: Callable[[Path], dict[str, Any]], file: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return {"complaint": ""}, {name: np.asarray(v, dtype=np.float64) for name, v in read(file).items()}
        except Exception as error:  # whatever a foreign reader makes of the file is the answer
            return {"complaint": f"{type(error).__name__}: {str(error).partition(chr(10))[0][:80]}"}, {}


def by_batterydf(file: Path) -> dict[str, Any]:
    import bdf  # pyright: ignore[reportMissingImports]

    read = bdf.read(file)
    frame = read[0] if isinstance(read, tuple) else read
    return {own: frame[label].to_numpy() for own, label in zip(OURS, _BDF, strict=True)}


def by_pyprobe(file: Path) -> dict[str, Any]:
    import polars  # pyright: ignore[reportMissingImports]
    from pyprobe.cell import process_cycler_data  # pyright: ignore[reportMissingImports]

    cycler = next((cycler for part, cycler in CYCLERS.items() if part in file.name), None)
    if cycler is None:
        raise ValueError("not one of its cyclers")
    with tempfile.TemporaryDirectory() as folder:
        written = process_cycler_data(cycler, str(file), str(Path(folder, "out.parquet")))
        frame = polars.read_parquet(written)
    return {own: frame[label].to_numpy() for own, label in zip(OURS, _PYPROBE, strict=True)}


_BDF = ("Test Time / s", "Current / A", "Voltage / V")
_PYPROBE = ("Time [s]", "Current [A]", "Voltage [V]")

if __name__ == "__main__":
    sys.exit(main())
