"""What is read out of a model: resistance over SoC and temperature, open-circuit voltage and its mean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench_service.reports import words
from bench_service.reports.document import Part, Points, Section
from bench_service.reports.drawing import BLUE, GREY, RUST, WARMTH, Axis, Line, curves

if TYPE_CHECKING:
    from models.network.local_model_network import LocalModelNetwork
    from models.readouts.ocv import OcvTable
    from models.readouts.resistance import ResistanceTable

_BAND_95 = 1.96
_NO_DIFFERENCE_MV = 1e-3
_SOC = Axis("state of charge", "%")


def readout_section(network: LocalModelNetwork) -> Section:
    """Drawings of what a model says of its cell, and what a person should know before trusting them."""
    # Lazy: numba and scipy take 1.0 s.
    from models.readouts.tables import tables_of

    ocv, resistance = tables_of(network)
    notes = [words.sentence(words.told(note)) for note in (network.record.tables or {}).get("reservations", [])]
    parts: list[Part] = [Points(notes)] if notes else []
    return Section("What the model says of the cell", [*parts, *_ocv_parts(ocv), *_resistance_parts(resistance)])


def _ocv_parts(ocv: OcvTable) -> list[Part]:
    middle = len(ocv.temperature_degC) // 2
    soc, mean = 100.0 * ocv.soc, ocv.mean_V[middle]
    std = None if ocv.std_V is None else _BAND_95 * ocv.std_V
    levels, apart = [Line("mean", soc, mean, None, GREY)], []
    for index, label, colour in ((1, "after charge", RUST), (0, "after discharge", BLUE)):
        band = None if std is None else std[index, middle]
        levels.append(Line(label, soc, ocv.voltage_V[index, middle], band, colour))
        off = None if band is None else 1e3 * band
        apart.append(Line(label, soc, 1e3 * (ocv.voltage_V[index, middle] - mean), off, colour))
    degC = f"{ocv.temperature_degC[middle]:.0f} °C".replace("-", "−")
    banded = "" if std is None else ", with 95 % bands"
    parts: list[Part] = [curves(f"Open-circuit voltage at {degC}", levels, _SOC, Axis("voltage", "V"))]
    if max(float(np.nanmax(np.abs(line.y))) for line in apart) < _NO_DIFFERENCE_MV:
        return [*parts, "The model has one open-circuit voltage, the same after a charge and after a discharge."]
    return [
        *parts,
        curves(f"Each branch against the mean of both{banded}", apart, _SOC, Axis("difference", "mV")),
    ]


def _resistance_parts(table: ResistanceTable) -> list[Part]:
    parts: list[Part] = []
    for sign, name in ((-1.0, "discharge"), (1.0, "charge")):
        own = np.flatnonzero(np.sign(table.current_A) == sign)
        if len(own) == 0:
            continue
        at = int(own[len(own) // 2])
        colours = [WARMTH[round(k)] for k in np.linspace(0, 4, len(table.temperature_degC))]
        lines = [
            Line(
                f"{degC:.0f} °C".replace("-", "−"),
                100.0 * table.soc,
                1e3 * table.resistance_Ohm[at, m],
                None if table.std_Ohm is None else 1e3 * _BAND_95 * table.std_Ohm[at, m],
                colours[m],
            )
            for m, degC in enumerate(table.temperature_degC)
        ]
        banded = "" if table.std_Ohm is None else ", with 95 % bands"
        current = words.quantity(abs(float(table.current_A[at])), "A")
        caption = f"Settled resistance, {name} with {current}{banded}"
        parts.append(curves(caption, lines, _SOC, Axis("resistance", "mΩ")))
    return parts
