"""Files of known cyclers, written by hand in their dialect: columns, units, sign, time and counters."""

from pathlib import Path

import numpy as np
import pytest

from bench_service.exchange import RunFileError
from bench_service.exchange.foreign.cyclers import cycler_maps, recognise
from bench_service.exchange.foreign.importing import Imported, import_file
from bench_service.exchange.foreign.looking import Choices

# name of the map -> header block, names, a row of rest, of charge (+2 A, 3.76 V) and of discharge (-1.5 A, 3.65 V)
WRITTEN = {
    "arbin": (
        "",
        "Data Point,Date Time,Test Time (s),Step Time (s),Cycle Index,Step Index,Current (A),Voltage (V),"
        "Aux_Temperature_1 (C)",
        "{n},\t09/20/2024 08:32:{t:06.3f},{t},{t},1,{step},{I},{U},24.5",
    ),
    "maccor": (
        "Today's Date ,28-Nov-23\nDate of Test:,23-Nov-23 3:56:08 PM\n",
        "Rec,Cycle C,Step,Test Time (sec),Step Time (sec),Capacity,Energy,Current,Voltage,State,DPT Time,Temp 1",
        '{n},1,{step},"{t:,.4f}",0.0,0,0,{size},{U},{state},23-Nov-23 3:56:{t:02.0f} PM,24.5',
    ),
    "biologic": (
        "BT-Lab ASCII FILE\nNb header lines : 7\n\nSafety Limits :\n\tEcell min = 2.40 V\n\n",
        "mode\tNs\ttime/s\tcontrol/V/mA\tEcell/V\t<I>/mA\t(Q-Qo)/mA.h\tTemperature/\ufffdC\tcycle number\t",
        "1\t{step}\t{t:.15E}\t0\t{U:.7E}\t{mA:.7E}\t0\t24.5\t1",
    ),
    "basytec": (
        "~Resultfile from Basytec Battery Test System\n~Start of Test: 19.06.2023 17:56:53\n~\n",
        "~Time[s]\tDataSet\tt-Step[s]\tLine\tCommand\tU[V]\tI[A]\tP[W]\tT1[°C]\tCyc-Count",
        "{t}\t{n}\t{t}\t{step}\tPause\t{U}\t{I}\t0\t24.5\t1",
    ),
    "novonix": (
        '[Summary]\nNovonix UHPC data file\n[End Summary]\n[Protocol]\n{{"Version":"2.13.0","List":[1,2,3]}}\n[Data]\n',
        "Date and Time,Cycle Number,Step Type,Run Time (h),Step Time (h),Current (A),Potential (V),"
        "Temperature (°C),Circuit Temperature (°C),Step Number",
        "2025-07-19 15:26:{t:02.0f},1,7,{h:.10f},0,{I},{U},24.5,30.1,{step}",
    ),
    "landt": (
        "cell model:,,,\ntest: ,,,\n",
        "channel_index,cycle_index,step_index,date_time_iso_string,test_time_s,step_time_s,current_A,voltage_V,"
        "temperature_1_C,step_name",
        "{n},1,{step},04/30/2024 14:33:{t:02.0f},{t},{t},{I},{U},24.5,rest,",
    ),
    "neware": (
        "",
        "DataPoint;Cycle Index;Step Index;Step Type;Time;Total Time;Current(mA);Voltage(V);T1(℃);Date",
        "{n};1;{step};CC;00:00:00;0:00:{t:06.3f};{mA};{U};24.5;2024-01-02 03:04:{t:02.0f}",
    ),
    "digatron": (
        "Testplan: x\n",
        "Step,Status,Prog Time,Step Time,Cycle,Voltage,Current,Temperature",
        "{step},PAU,0:00:{t:06.3f},0:00:00,1,{U},{I},24.5",
    ),
    "bdf": (
        "",
        "Test Time / s,Current / A,Voltage / V,Surface Temperature T1 / degC,Cycle Count / 1,Step Count / 1",
        "{t},{I},{U},24.5,1,{step}",
    ),
}
CURRENT_A = np.repeat([0.0, 2.0, 0.0, -1.5, 0.0], 4)
VOLTAGE_V = 3.7 + 0.03 * CURRENT_A


def write(path: Path, name: str) -> Path:
    above, names, row = WRITTEN[name]
    lines = [
        row.format(
            n=k + 1,
            t=2.0 * k,
            h=2.0 * k / 3600,
            step=k // 4 + 1,
            I=current,
            mA=1e3 * current,
            U=round(voltage, 4),
            size=abs(current),
            state="D" if current < 0 else "C" if current > 0 else "R",
        )  # fmt: skip
        for k, (current, voltage) in enumerate(zip(CURRENT_A, VOLTAGE_V, strict=True))
    ]
    path.write_text(above.replace("{{", "{").replace("}}", "}") + "\n".join([names, *lines]) + "\n", encoding="utf-8")
    return path


def read(path: Path, choices: Choices | None = None) -> Imported:
    run = import_file(path, choices)
    run.close()
    return run


@pytest.mark.parametrize("name", WRITTEN)
def test_a_cycler_is_recognised_and_read(tmp_path: Path, name: str) -> None:
    run = import_file(write(tmp_path / "a.txt", name))
    columns = run.columns()
    run.close()
    assert run.mapping.name == name
    np.testing.assert_allclose(columns["time_s"], 2.0 * np.arange(20), atol=1e-6)
    np.testing.assert_allclose(columns["current_A"], CURRENT_A, rtol=1e-12)
    np.testing.assert_allclose(columns["voltage_V"], VOLTAGE_V, atol=1e-9)
    np.testing.assert_array_equal(columns["temperature_degC"], 24.5)
    np.testing.assert_array_equal(columns["cycle_count"], 1)
    np.testing.assert_array_equal(columns["step_count"], np.arange(20) // 4 + 1)


def test_every_map_has_a_file_here_and_says_where_it_is_from() -> None:
    assert set(cycler_maps()) == {*WRITTEN, "generic"}
    for each in cycler_maps().values():
        assert each.source and each.title and "voltage_V" in each.columns
        assert recognise(["a", "b"]).name == "generic"


def test_a_map_can_be_named_and_an_unknown_one_says_which_there_are(tmp_path: Path) -> None:
    path = write(tmp_path / "a.txt", "arbin")
    assert read(path, Choices(format="generic")).mapping.name == "generic"
    with pytest.raises(RunFileError, match="'arbn' is not known; choose from arbin, basytec"):
        read(path, Choices(format="arbn"))


@pytest.mark.parametrize(
    ("name", "zone", "utc_s"),
    [("arbin", "UTC", 1726821120.0), ("arbin", "Europe/Oslo", 1726813920.0), ("novonix", "UTC", 1752938760.0)],
)
def test_the_start_is_kept_where_the_time_zone_is_known(tmp_path: Path, name: str, zone: str, utc_s: float) -> None:
    path = write(tmp_path / "a.txt", name)
    assert read(path, Choices(time_zone=zone)).started_unix_s == utc_s
    without = read(path)
    assert without.started_unix_s is None
    assert any("name it with --time-zone" in remark for remark in without.remarks)


def test_a_row_counter_that_is_called_channel_is_no_cell(tmp_path: Path) -> None:
    assert read(write(tmp_path / "a.txt", "landt"), Choices(format="generic")).n == 20


def test_a_sensor_that_reads_zero_throughout_is_not_connected(tmp_path: Path) -> None:
    path = write(tmp_path / "a.txt", "landt")
    path.write_text(path.read_text().replace(",24.5,", ",0,"))
    run = import_file(path)
    assert np.isnan(run.columns()["temperature_degC"]).all()
    assert any("0 degC in every row" in remark for remark in run.remarks)
    run.close()


def test_a_maker_is_believed_where_the_voltage_does_not_tell(tmp_path: Path) -> None:
    path = write(tmp_path / "a.txt", "arbin")
    path.write_text("\n".join(",".join(_flat(line)) for line in path.read_text().splitlines()) + "\n")
    assert any("is what Arbin writes" in remark for remark in read(path).remarks)
    with pytest.raises(RunFileError, match="say it with --current-sign"):
        read(path, Choices(format="generic"))


def _flat(line: str) -> list[str]:
    cells = line.split(",")
    return [*cells[:7], "3.7" if cells[7][0].isdigit() else cells[7], *cells[8:]]
