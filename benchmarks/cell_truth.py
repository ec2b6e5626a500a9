"""True open-circuit voltage and resistance of the simulated cells, at the points of a model's own tables."""

import math
from typing import Any

import numpy as np

from models.local_model_network import LocalModelNetwork
from models.ocv import DIRECTIONS, OcvTable
from models.readouts import tables_of
from models.resistance import ResistanceTable
from models.timeseries import FloatArray
from simulators.cell import REFERENCE_K, SOC_SCALE, ZERO_DEGC_K, CellParameters

# Where the curve rises by less than this it is a plateau.
PLATEAU_V = 0.12


def table_errors(network: LocalModelNetwork, parameters: CellParameters) -> dict[str, Any]:
    """Errors of a network's tables over the trained domain, which is where they are read out.

    Returns
    -------
    dict
        `ocv_rms_mV`, `ocv_max_mV` of both branches, `ocv_mean_max_mV` of their mean, `plateau_max_mV` of the mean on
        plateaus (None where there is none), `resistance_rms` and `resistance_max` relative, and the share of points of
        each table whose 95 % band holds the truth.
    """
    ocv, resistance = tables_of(network)
    true_V, true_Ohm = true_ocv_V(ocv, parameters), true_resistance_Ohm(resistance, parameters)
    off_V, off_mean_V = ocv.voltage_V - true_V, ocv.mean_V - true_V.mean(axis=0)
    relative = resistance.resistance_Ohm / true_Ohm - 1.0
    flat = np.array([parameters.open_circuit.slope_at_V(float(s)) < PLATEAU_V for s in ocv.soc])
    return {
        "ocv_rms_mV": 1e3 * float(np.sqrt(np.mean(off_V**2))),
        "ocv_max_mV": 1e3 * float(np.abs(off_V).max()),
        "ocv_mean_max_mV": 1e3 * float(np.abs(off_mean_V).max()),
        "plateau_max_mV": 1e3 * float(np.abs(off_mean_V[:, flat]).max()) if flat.any() else None,
        "plateau_rms_mV": 1e3 * float(np.sqrt(np.mean(off_mean_V[:, flat] ** 2))) if flat.any() else None,
        "resistance_rms": float(np.sqrt(np.mean(relative**2))),
        "resistance_max": float(np.abs(relative).max()),
        "ocv_band_holds": _held(off_V, ocv.std_V),
        "resistance_band_holds": _held(resistance.resistance_Ohm - true_Ohm, resistance.std_Ohm),
    }


def true_ocv_V(table: OcvTable, p: CellParameters) -> FloatArray:
    """(2, m, n) settled voltage without current, hysteresis fully on the side of the last direction."""
    curve = np.array([p.open_circuit.voltage_V(float(s)) for s in table.soc])
    warm = p.dU_dT_V_per_K * (table.temperature_degC + ZERO_DEGC_K - REFERENCE_K)
    side = p.hysteresis_amplitude_V * np.array(DIRECTIONS)
    return curve + warm[:, None] + side[:, None, None]


def true_resistance_Ohm(table: ResistanceTable, p: CellParameters) -> FloatArray:
    """(c, m, n) settled (V(I) - V(0)) / I at held state of charge and temperature."""
    factor = np.exp(p.activation_K * (1.0 / (table.temperature_degC + ZERO_DEGC_K) - 1.0 / REFERENCE_K))
    current = table.current_A[:, None, None]
    factor = factor[:, None] * np.where(current > 0.0, p.charge_resistance_ratio, 1.0)
    pairs = p.fast_1.resistance_Ohm + p.fast_2.resistance_Ohm + p.slow.resistance_Ohm
    ohmic = p.ohmic_Ohm + p.ohmic_at_empty_Ohm * np.exp(-table.soc / SOC_SCALE) + pairs
    transfer = p.charge_transfer_V * np.arcsinh(current * factor / (2.0 * p.exchange_current_A)) / current
    return ohmic * factor + transfer + p.series_resistance_Ohm


def _held(off: FloatArray, std: FloatArray | None) -> float | None:
    return None if std is None else float((np.abs(off) <= 1.96 * std).mean())


def pulse_resistance_Ohm(p: CellParameters, soc: float, degC: float, to_A: float, time_s: FloatArray) -> FloatArray:
    """(n,) resistance that a step from rest shows after a time, state of charge and temperature held."""
    factor = math.exp(p.activation_K * (1.0 / (degC + ZERO_DEGC_K) - 1.0 / REFERENCE_K))
    factor *= p.charge_resistance_ratio if to_A > 0.0 else 1.0
    ohmic = p.ohmic_Ohm + p.ohmic_at_empty_Ohm * math.exp(-soc / SOC_SCALE)
    out = np.full(len(time_s), ohmic * factor + p.series_resistance_Ohm)
    out += p.charge_transfer_V * math.asinh(to_A * factor / (2.0 * p.exchange_current_A)) / to_A
    for branch in (p.fast_1, p.fast_2, p.slow):
        out += factor * branch.resistance_Ohm * -np.expm1(-time_s / branch.time_constant_s)
    return out
