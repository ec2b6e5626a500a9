"""Battery Data Format CSV, written with the labels of its ontology 1.3.0; see `bdf_0_1` for those of batterydf 0.1.0.

It has no state of charge; what else a run holds (set-point, flags) is not part of the format and stays out.
Reading is that of any CSV (`csv_own`), which knows these labels.
"""

from __future__ import annotations

import numpy as np

from bench_service.exchange.columns import BDF_NAMES, COUNT_NAMES, FIRST_SENSOR_0_1, SURFACE_1_3, UNIX_TIME_LABEL
from bench_service.exchange.delimited import encode_csv
from bench_service.exchange.format import Array, Format, RunTable


def labelled(run: RunTable) -> dict[str, Array]:
    """Columns of a run under the format's labels."""
    columns: dict[str, Array] = {label: run.columns[own] for own, (label, _) in BDF_NAMES.items() if own in run.columns}
    for own, label in COUNT_NAMES.items():
        if own in run.columns and np.any(run.columns[own]):  # 0 throughout: no protocol was played
            columns[label] = run.columns[own]
    if run.started_unix_s is not None:
        columns[UNIX_TIME_LABEL] = run.started_unix_s + np.asarray(run.columns["time_s"], dtype=np.float64)
    return columns


def labelled_0_1(run: RunTable) -> dict[str, Array]:
    """Columns of a run under the labels that the package batterydf 0.1.0 knows: it numbers the surface's sensors."""
    return {FIRST_SENSOR_0_1 if name == SURFACE_1_3 else name: values for name, values in labelled(run).items()}


def _encode(run: RunTable) -> bytes:
    return encode_csv(labelled(run))


FORMAT = Format(
    name="bdf",
    title="Battery Data Format 1.3.0, CSV",
    suffix=".bdf.csv",
    media_type="text/csv",
    encode=_encode,
)
