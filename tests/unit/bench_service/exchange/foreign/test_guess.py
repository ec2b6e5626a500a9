"""Headers as they were met, and what their columns are taken for."""

from pathlib import Path

import pytest

from bench_service.exchange.foreign.looking import look

HEADERS = {
    "Maccor text": (
        "Today's Date\t11/28/2023\tProcedure:\tx.000\n\n"
        "Rec#\tCyc#\tStep\tTest (Min)\tStep (Min)\tAmp-hr\tAmps\tVolts\tState\tDPt Time\t",
        "1\t0\t1\t0.166667\t0\t0\t0.0\t3.7\tR\t11/23/2023 03:00:10 PM",
        ("maccor", {"time_s": ("Test (Min)", "min"), "current_A": ("Amps", "A"), "state": ("State", None)}),
    ),
    "Gamry": (
        "EXPLAIN\nTAG\tPWR\nCURVE\tTABLE\t120\n\tPt\tT\tVf\tIm\tVu\tPwr\n\t#\ts\tV vs. Ref.\tA\tV\tW",
        "\t1\t10\t3.7\t1.0E-03\t0\t0",
        ("generic", {"time_s": ("T", "s"), "voltage_V": ("Vf", "V"), "current_A": ("Im", "A")}),
    ),
    "EC-Lab with a comma": (
        "EC-Lab ASCII FILE\nNb header lines : 4\n\nmode\tNs\ttime/s\tcontrol/V/mA\tEwe/V\t<I>/mA\tcycle number",
        "1\t0\t1,000000E+001\t0\t3,7E+000\t1,0E+000\t0,0E+000",
        ("biologic", {"voltage_V": ("Ewe/V", "V"), "current_A": ("<I>/mA", "mA"), "step_count": ("Ns", None)}),
    ),
    "Neware, older": (
        "Record ID,Cycle,Step,Step Type,Time(h:min:s.ms),Total Time(h:min:s.ms),Voltage(V),Current(mA),Absolute Time",
        "1,1,1,CC,0:00:00.000,0:00:10.000,3.7,1000.0,2024-01-02 03:00:10",
        ("neware", {"time_s": ("Total Time(h:min:s.ms)", "duration"), "current_A": ("Current(mA)", "mA")}),
    ),
    "Excel in German": (
        "sep=;\nZeit;Spannung [V];Strom [A];Temperatur",
        "0:00:10;3,7;1,5;24,5",
        ("generic", {"time_s": ("Zeit", "duration"), "temperature_degC": ("Temperatur", "degC")}),
    ),
    "a battery's own log": (
        "timestamp,pack_voltage,pack_current,temp_1",
        "2024-03-01T12:00:00+01:00,370.1,1.5,22",
        ("generic", {"clock": ("timestamp", "clock"), "voltage_V": ("pack_voltage", "V")}),
    ),
}


@pytest.mark.parametrize("title", HEADERS)
def test_a_header_as_it_was_met(tmp_path: Path, title: str) -> None:
    head, row, (name, columns) = HEADERS[title]
    (tmp_path / "a.txt").write_text(head + "\n" + (row + "\n") * 6)
    mapping = look(tmp_path / "a.txt").mapping
    assert mapping.name == name
    assert {role: (mapping.columns[role].name, mapping.columns[role].unit) for role in columns} == columns
