"""The metadata file beside a file of the Battery Data Format, ``x.bdf.metadata.json``.

The package batterydf reads it strictly: of the keys at its top it knows ``bdf`` and ``raw``, and takes whatever object
stands under ``raw``. All that is ours stands there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from bench_service.exchange.columns import BDF_NAMES, COUNT_NAMES, FIRST_SENSOR_0_1, SURFACE_1_3, UNIX_TIME_LABEL

SUFFIX = ".bdf.metadata.json"
_SCHEMA = 1
_MEANING = {
    BDF_NAMES["time_s"][0]: "time from the start of the run",
    BDF_NAMES["current_A"][0]: "current of the interval that ends with the sample; positive current charges",
    BDF_NAMES["voltage_V"][0]: "voltage at the cell",
    SURFACE_1_3: "temperature at the surface of the cell",
    BDF_NAMES["ambient_degC"][0]: "temperature around the cell",
    UNIX_TIME_LABEL: "UTC of the sample",
    **{label: f"{own.split('_')[0]}s that have begun" for own, label in COUNT_NAMES.items()},
}


def bdf_metadata(told: Mapping[str, Any], writer: str) -> dict[str, Any]:
    """Return the document of a run's metadata file.

    Parameters
    ----------
    told : what is known of the run: institution, cell, run, hashes
    writer : program and version
    """
    columns = [
        {"label": label, "quantity": label.rsplit(" / ", 1)[0], "unit": label.rsplit(" / ", 1)[1], "meaning": meaning}
        for label, meaning in _MEANING.items()
    ]
    also = {"ontology_version": "1.3.0", "batterydf_0.1.0": {SURFACE_1_3: FIRST_SENSOR_0_1}}
    return {
        "bdf": {"source": writer},
        "raw": {"schema": _SCHEMA, "labels": also, "current_sign": "positive charges", "columns": columns, **told},
    }


def encode_metadata(document: Mapping[str, Any]) -> bytes:
    """Return it as the bytes of a file."""
    return json.dumps(document, indent=1, allow_nan=False).encode()
