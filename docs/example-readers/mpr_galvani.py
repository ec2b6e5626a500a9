"""Prints the samples of a BioLogic .mpr file as CSV, read by the package galvani (GPL-3.0-or-later).

    python mpr_galvani.py FILE.mpr

A program of its own: nothing of it, or of galvani, comes into the service. In `bench.toml`:

    [readers]
    ".mpr" = ["/path/of/an/environment/with/galvani/bin/python", "/path/of/mpr_galvani.py"]

Currents, where the file has none, are counted from its charge steps (`dq/mA.h`), as techniques of potential and of
current both note them.
"""

import csv
import sys

import numpy as np
from galvani import BioLogic

MA_S_PER_MA_H = 3600.0


def main() -> None:
    """Print every column, and one for the current where there is none."""
    data = BioLogic.MPRfile(sys.argv[1]).data
    columns = {name: np.asarray(data[name], dtype=float) for name in data.dtype.names}
    if not {"I/mA", "<I>/mA"} & set(columns) and "dq/mA.h" in columns:
        dt_s = np.diff(columns["time/s"], prepend=np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            columns["<I>/mA"] = np.where(dt_s > 0.0, columns["dq/mA.h"] * MA_S_PER_MA_H / dt_s, 0.0)
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(columns)
    out.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


if __name__ == "__main__":
    main()
