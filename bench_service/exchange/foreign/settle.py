"""Units and sign of a record that has been read: what cannot be is asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.mapping import Mapping
from bench_service.exchange.foreign.spool import Spool
from bench_service.exchange.foreign.votes import judge_spool

# A cell in mV starts at about 1000 (Ni-MH), a module in V ends below; a current in mA is above for all but tiny cells.
_LARGEST_VOLTAGE_V = 1000.0
_LARGEST_CURRENT_A = 1000.0
_TEMPERATURES_DEGC = (-100.0, 200.0)
_SAMPLED = 200_000
# Of the largest current: a mean below that is the offset of a sensor.
_NOTHING_SHARE = 1e-3


def settle_values(where: str, spool: Spool, mapping: Mapping, remarks: list[str]) -> None:
    """Check what the columns hold.

    Raises
    ------
    QuestionError
        A unit that cannot be.
    RunFileError
        A needed column has no value at all.
    """
    for own in ("current_A", "voltage_V"):
        missing = spool.missing[own]
        if missing == spool.n:
            raise RunFileError(f"{where}: {own} has no value at all")
        if missing:
            remarks.append(f"{own} is missing in {missing} of {spool.n} rows")
    voltage_V = float(np.nanmedian(np.abs(_sampled(spool, "voltage_V"))))
    if voltage_V > _LARGEST_VOLTAGE_V:
        _ask_unit(where, mapping, "voltage_V", f"a median of {voltage_V:.5g} V", "mV")
    current_A = float(np.nanpercentile(np.abs(_sampled(spool, "current_A")), 99.0))
    if current_A > _LARGEST_CURRENT_A:
        _ask_unit(where, mapping, "current_A", f"{current_A:.5g} A", "mA")
    for own in ("temperature_degC", "ambient_degC"):
        if own in spool.names:
            _settle_temperature(where, spool, mapping, own, remarks)
    if "temperature_degC" not in spool.names and "ambient_degC" not in spool.names:
        remarks.append("no temperature is known")


def _settle_temperature(where: str, spool: Spool, mapping: Mapping, own: str, remarks: list[str]) -> None:
    low, high = spool.lowest[own], spool.highest[own]
    name = mapping.columns[own].name
    if spool.missing[own] == spool.n:
        spool.drop(own)
    elif low == high == 0.0:
        spool.drop(own)
        remarks.append(f"column {name!r} is 0 degC in every row: taken as a sensor that is not connected")
    elif low < _TEMPERATURES_DEGC[0] or high > _TEMPERATURES_DEGC[1]:
        unit = "K" if 200.0 < low and high < 450.0 else "degF"
        _ask_unit(where, mapping, own, f"{low:.5g} to {high:.5g} degC", unit)


def _ask_unit(where: str, mapping: Mapping, role: str, what: str, unit: str) -> None:
    name = mapping.columns[role].name if role in mapping.columns else "NAME"
    raise QuestionError(
        f"{where}: column {name!r} would be {what}: its unit must be another, probably {unit}; say so with "
        f"--column {role}='{name}:{unit}'",
        role,
    )


def settle_sign(where: str, spool: Spool, keep: NDArray[np.bool_], mapping: Mapping, remarks: list[str]) -> None:
    """Make positive current charge.

    Raises
    ------
    QuestionError
        The voltage contradicts the file's sign, or does not tell and nobody else does.
    """
    if _by_state(where, spool, mapping):
        remarks.append(f"the sign of the current is that of column {mapping.columns['state'].name!r}")
    if mapping.current_sign is not None:
        if mapping.current_sign == "discharge-positive":
            spool.negate("current_A")
        return
    if not spool.lowest["current_A"] < spool.highest["current_A"] and spool.highest["current_A"] == 0.0:
        remarks.append("no current flows: its sign cannot be checked, and does not matter")
        return
    evidence, counted = judge_spool(spool, keep)
    one_sign = spool.lowest["current_A"] >= 0.0 or spool.highest["current_A"] <= 0.0
    if one_sign and (counted.surely_both or (evidence.verdict == "unclear" and counted.both)):
        raise QuestionError(
            f"{where}: the current has one sign only, while the voltage shows both charge and discharge: name the "
            "column that tells which with --column state=NAME, or the two columns with --column charge_current_A=NAME "
            "and --column discharge_current_A=NAME",
            "state",
        )
    expected = mapping.sign_convention or "charge-positive"
    if evidence.verdict == "unclear":
        _believe(where, spool, mapping, evidence.text, remarks)
    elif evidence.verdict == expected:
        if expected == "discharge-positive":
            spool.negate("current_A")
            remarks.append("positive current discharges in this file: turned round")
    else:
        raise QuestionError(
            f"{where}: the current has the wrong sign ({expected} expected): {evidence.text}; settle it with "
            f"--current-sign {evidence.verdict} (or {expected} to keep the file's sign)"
            + ("; where a column tells charge from discharge, name it with --column state=NAME" if one_sign else ""),
            "current_sign",
        )


def _believe(where: str, spool: Spool, mapping: Mapping, text: str, remarks: list[str]) -> None:
    if mapping.sign_convention is None:
        raise QuestionError(
            f"{where}: the voltage does not tell whether positive current charges ({text}): say it with --current-sign "
            "charge-positive or discharge-positive",
            "current_sign",
        )
    if mapping.sign_convention == "discharge-positive":
        spool.negate("current_A")
    remarks.append(
        f"the voltage does not tell the sign of the current ({text}); {mapping.sign_convention} is what "
        f"{mapping.title.split(',')[0]} writes"
    )


def _by_state(where: str, spool: Spool, mapping: Mapping) -> bool:
    """Give a current without sign that of the state column; returns whether that was needed.

    Raises
    ------
    QuestionError
        Both states flow one way, and not as a size without a sign does.
    """
    if "state" not in spool.names:
        return False
    charge_A, discharge_A = _mean_A(spool, 1.0), _mean_A(spool, -1.0)
    nothing_A = _NOTHING_SHARE * max(abs(spool.lowest["current_A"]), abs(spool.highest["current_A"]))
    # A sensor that reads a little below 0 at rest gives no sign: the rows that discharge tell.
    unsigned = discharge_A > nothing_A and charge_A >= -nothing_A
    if unsigned:
        for start, block in spool.slices():
            spool.overwrite("current_A", start, np.where(block["state"] < 0.0, -1.0, 1.0) * block["current_A"])
    elif discharge_A < -nothing_A and charge_A < -nothing_A:
        name = mapping.columns["state"].name
        raise QuestionError(
            f"{where}: the current is negative where column {name!r} says charge ({charge_A:.4g} A in the mean) and "
            f"where it says discharge ({discharge_A:.4g} A): name another column with --column state=NAME, or "
            "--column state= where none tells which",
            "state",
        )
    spool.drop("state")
    return unsigned


def _mean_A(spool: Spool, state: float) -> float:
    """Mean current of the rows in a state; 0 where there are none."""
    total_A, n = 0.0, 0
    for _, block in spool.slices():
        current_A = block["current_A"][(block["state"] == state) & ~np.isnan(block["current_A"])]
        total_A, n = total_A + float(current_A.sum()), n + len(current_A)
    return total_A / max(n, 1)


def _sampled(spool: Spool, name: str) -> np.ndarray:
    """(m,) values from the beginning, the middle and the end."""
    if spool.n <= 3 * _SAMPLED:
        return spool.column(name)
    middle = spool.n // 2
    spans = ((0, _SAMPLED), (middle, middle + _SAMPLED), (spool.n - _SAMPLED, spool.n))
    return np.concatenate([spool.column(name, *span) for span in spans])
