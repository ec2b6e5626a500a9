"""Battery Data Format CSV, written with its labels.

It has no state of charge; what else a run holds (set-point, flags) is not part of the format and stays out.
Reading is that of any CSV (`csv_own`), which knows these labels.
"""

from __future__ import annotations

import numpy as np

from bench_service.exchange.columns import BDF_NAMES, COUNT_NAMES, UNIX_TIME_LABEL
from bench_service.exchange.delimited import encode_csv
from bench_service.exchange.format import Array, Format, RunTable


def _encode(run: RunTable) -> bytes:
    columns: dict[str, Array] = {label: run.columns[own] for own, (label, _) in BDF_NAMES.items() if own in run.columns}
    for own, label in COUNT_NAMES.items():
        if own in run.columns and np.any(run.columns[own]):  # 0 throughout: no protocol was played
            columns[label] = run.columns[own]
    if run.started_unix_s is not None:
        columns[UNIX_TIME_LABEL] = run.started_unix_s + np.asarray(run.columns["time_s"], dtype=np.float64)
    return encode_csv(columns)


FORMAT = Format(
    name="bdf",
    title="Battery Data Format, CSV",
    suffix=".bdf.csv",
    media_type="text/csv",
    encode=_encode,
)
