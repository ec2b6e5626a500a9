"""What a control process tells fits into a frame, whatever a device's map leaves open."""

import math
import re
from pathlib import Path
from typing import Any, cast

from bench_service.bench.links import FrameLink
from bench_service.bench.reporting import Reporter
from bench_service.framing import Decoder, encode
from drivers.modbus_plan import DevicePlan
from drivers.register_map import load_map

CONSTANTS = {"i_nom": 30.0, "v_nom": 6.0, "p_nom": 180.0}


class Wire:
    """Takes messages as a link does."""

    def __init__(self) -> None:
        self.told: list[dict[str, Any]] = []

    def send(self, header: dict[str, Any]) -> None:
        self.told += [head for head, _ in Decoder().feed(encode(header))]


def test_ranges_that_a_map_leaves_open_are_told_as_open(tmp_path: Path) -> None:
    text = load_map("generic").file.read_text()
    text = re.sub(r'^voltage = \["0".*\n', "", text, flags=re.M)
    text = text.replace('range = ["0.1", "60"]\n', "")
    (tmp_path / "open.toml").write_text(text)
    capabilities = DevicePlan(load_map(tmp_path / "open.toml"), CONSTANTS).capabilities(
        {"serial": "1"}, lock_step=False
    )
    assert capabilities.voltage_V == (-math.inf, math.inf) == capabilities.watchdog_s
    wire = Wire()
    Reporter(cast(FrameLink, wire)).state("idle", None, None, capabilities)
    told = wire.told[0]["capabilities"]
    assert (told["voltage_V"], told["watchdog_s"]) == ([None, None], [None, None])
    assert told["current_A"] == list(capabilities.current_A) and told["serial"] == "1"
