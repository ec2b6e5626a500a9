"""Decimals and groups of thousands: read right, or refused where a comma may be either."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench_service.exchange import RunFileError
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices

CURRENT_A = np.repeat([0.0, 1.5, 0.0, -1.25], 5)
VOLTAGE_V = 3.7 + 0.03 * CURRENT_A
TIME_S = 1000.0 + np.arange(20.0)


def dotted(value: float, digits: int = 0) -> str:
    """In groups, as in German."""
    return f"{value:,.{digits}f}".translate(str.maketrans(",.", ".,"))


WRITTEN = {
    "millions of ms": (
        'Time(ms),Current(A),Voltage(V)\n"{ms:,.0f}",{A:.4f},{V:.4f}',
        'Time(ms),Current(mA),Voltage(V)\n"{ms:,.1f}","{mA:,.2f}",{V:.4f}',
    ),
    "thousands of mA and mV, with a decimal point elsewhere": (
        'Time(s),Current(mA),Voltage(mV),Flow\n{s:.0f},"{mA:,.0f}","{mV:,.0f}",0.5',
        'Time(s),Current(A),Voltage(V)\n"{s:,.0f}",{A:.2f},{V:.4f}',
        "Time(s);Current(mA);Voltage(mV);Flow\n{s:.0f};{mA:.1f};{mV:.1f};0.5",
    ),
    "groups with dots": (
        "Zeit(ms);Strom(A);Spannung(V)\n{ms_};{A_};{V_}",
        "Zeit(s);Strom(uA);Spannung(V)\n{s_};{uA_};{V_}",
        "Zeit(s);Strom(uA);Spannung(uV)\n{s_};{uA_};{uV_}",
    ),
}


@pytest.mark.parametrize("form", [form for forms in WRITTEN.values() for form in forms])
def test_groups_of_thousands(tmp_path: Path, form: str) -> None:
    path = write(tmp_path / "a.csv", form)
    with closing(import_file(path, Choices(current_sign="charge-positive"))) as run:
        columns = run.columns()
    np.testing.assert_allclose(columns["time_s"], TIME_S, rtol=1e-12)
    np.testing.assert_allclose(columns["current_A"], CURRENT_A, rtol=1e-12)
    np.testing.assert_allclose(columns["voltage_V"], VOLTAGE_V, atol=0.0006)


@pytest.mark.parametrize(
    ("form", "says"),
    [
        (
            "Time(s);Current(A);Voltage(V)\n{s:.1f};{A3_};{V:.4f}",
            "line 2, column 'Current.A.': '0,000' is not a number",
        ),
        ("Time(s);Current(A);Voltage(V)\n{s:.1f};{A:.3f};{V_}", "with a decimal comma|with a decimal point"),
        ("Time(s)\tCurrent(A)\tVoltage(V)\n{s:.0f}\t0\t{V3_}", r"is 3,700 in column 'Voltage\(V\)' 3.700 or 3700\?"),
        ('Time(s),Current(mA),Voltage(mV)\n{s:.0f},"{mA:,.0f}","{mV:,.0f}"', "or 3700"),
    ],
)
def test_a_comma_that_may_be_either_is_refused(tmp_path: Path, form: str, says: str) -> None:
    path = write(tmp_path / "a.csv", form)
    with pytest.raises(RunFileError, match=says):
        import_file(path, Choices(current_sign="charge-positive"))


def test_between_semicolons_a_comma_stands_before_decimals(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "Time(s);Current(A);Voltage(V)\n{s:.0f};0;{V3_}")
    with closing(import_file(path, Choices(current_sign="charge-positive"))) as run:
        np.testing.assert_allclose(run.columns()["voltage_V"], VOLTAGE_V, atol=0.0006)


def write(path: Path, form: str) -> Path:
    head, row = form.split("\n")
    rows = [
        row.format(
            s=s,
            ms=1e3 * s,
            A=A,
            mA=1e3 * A,
            V=V,
            mV=1e3 * V,
            s_=dotted(s, 1),
            ms_=dotted(1e3 * s),
            A_=dotted(A, 4),
            A3_=dotted(A, 3),
            uA_=dotted(1e6 * A),
            V_=dotted(V, 4),
            V3_=dotted(V, 3),
            uV_=dotted(1e6 * V),
        )
        for s, A, V in zip(TIME_S, CURRENT_A, VOLTAGE_V, strict=True)
    ]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path
