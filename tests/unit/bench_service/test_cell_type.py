"""A cell-type file: checked by itself, and a bench's limits held against it."""

from pathlib import Path

import pytest

from bench_service.bench.limits import Limits
from bench_service.bench.plausibility import band_of
from bench_service.bench.settings import BenchSettings
from bench_service.config import BenchConfig, ConfigError, load_config

CELL = """\
maker = "Maker"
model = "M50"
chemistry = "NMC"
capacity_Ah = 5.0
voltage_V = [2.5, 4.2]
charge_A = 5.0
discharge_A = 7.5
temperature_degC = [0, 45]
resistance_Ohm = [0.015, 0.12]
source = "data sheet rev. 3, page 2"
"""
BENCH = '[bench.left]\nurl = "modbus-tcp://h:1"\ncell_type = "cells/m50.toml"\n'


def load(folder: Path, bench: str = BENCH, cell: str = CELL) -> BenchConfig:
    (folder / "cells").mkdir(exist_ok=True)
    (folder / "cells" / "m50.toml").write_text(cell)
    (folder / "bench.toml").write_text(bench)
    return load_config(folder / "bench.toml", {}).bench["left"]


def test_what_a_bench_does_not_state_is_the_cells(tmp_path: Path) -> None:
    found = load(tmp_path)
    assert (found.capacity_Ah, found.limits.voltage_V, found.limits.current_A) == (5.0, (2.5, 4.2), (-7.5, 5.0))
    assert found.limits.temperature_degC == (0.0, 45.0)
    assert found.cell_type is not None and found.cell_type.resistance_Ohm == (0.015, 0.12)


def test_a_bench_may_be_narrower_than_its_cell(tmp_path: Path) -> None:
    found = load(tmp_path, BENCH + "capacity_Ah = 4.6\n[bench.left.limits]\nvoltage_V = [3.0, 4.1]\n")
    assert (found.capacity_Ah, found.limits.voltage_V, found.limits.current_A) == (4.6, (3.0, 4.1), (-7.5, 5.0))


def test_a_simulated_bench_may_have_one_too(tmp_path: Path) -> None:
    found = load(tmp_path, '[bench.left]\nsimulate = { cell = "nmc" }\ncell_type = "cells/m50.toml"\n')
    assert (found.capacity_Ah, found.limits.current_A) == (5.0, (-7.5, 5.0))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            "[bench.left.limits]\nvoltage_V = [2.5, 4.25]",
            "2.5 to 4.25 V leave what the cell type Maker M50",
        ),
        ("[bench.left.limits]\ncurrent_A = [-8, 5]", "limits.current_A -8 to 5 A leave .* -7.5 to 5 A .*page 2"),
        ("[bench.left.limits]\ntemperature_degC = [-10, 45]", "-10 to 45 degC leave .* 0 to 45 degC"),
        ("capacity_Ah = 6.0", "capacity_Ah 6 Ah is not that of the cell type Maker M50, 5 Ah nominal"),
    ],
)
def test_limits_outside_of_the_cells_are_refused(tmp_path: Path, more: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as refused:
        load(tmp_path, BENCH + more)
    assert refused.value.key == "bench.left"


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("charge_A = 5.0\n", "charge_A = -5.0\n", r"m50.toml: charge_A: Input should be greater than 0"),
        ("voltage_V = [2.5, 4.2]", "voltage_V = [4.2, 2.5]", r"m50.toml: voltage_V: low 4.2 must be below high 2.5"),
        ("voltage_V = [2.5, 4.2]", "voltage_V = [-1, 4.2]", r"m50.toml: voltage_V begins at -1 V"),
        ("[0.015, 0.12]", "[0, 0.12]", r"m50.toml: resistance_Ohm begins at 0 Ohm"),
        ('source = "data sheet rev. 3, page 2"', "", r"m50.toml: source: Field required"),
        ('chemistry = "NMC"', 'chemistri = "NMC"', r"m50.toml: "),
        ('chemistry = "NMC"', 'chemistry = ""', r"m50.toml: chemistry: "),
        ("capacity_Ah = 5.0", 'capacity_Ah = "5"', r"m50.toml: capacity_Ah: must be a number"),
        ("maker", "= maker", r"m50.toml: not valid TOML"),
    ],
)
def test_a_bad_file_is_named_with_its_key(tmp_path: Path, before: str, after: str, message: str) -> None:
    assert CELL.count(before) == 1
    with pytest.raises(ConfigError, match=message):
        load(tmp_path, cell=CELL.replace(before, after))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none.toml: no such file"):
        load(tmp_path, BENCH.replace("m50", "none"))
    with pytest.raises(ConfigError, match="cell_type"):
        load(tmp_path, BENCH.replace('"cells/m50.toml"', "5"))


def test_the_rules_take_their_band_from_the_cell() -> None:
    own = band_of(5.0, (2.5, 4.2))
    assert own.usual_Ohm == pytest.approx((0.0024, 0.4)) and own.possible_Ohm == pytest.approx((0.0008, 1.6))
    cell = band_of(5.0, (2.5, 4.2), (0.015, 0.12))
    assert cell.usual_Ohm == (0.015, 0.12) and cell.possible_Ohm == pytest.approx((0.005, 0.48))
    limits = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
    settings = BenchSettings("b", "u", "m", limits, resistance_Ohm=(0.015, 0.12), identity={"serial": "1"})
    assert BenchSettings.from_json(settings.to_json()) == settings
