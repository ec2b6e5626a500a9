"""A commissioning record holds for one device, one wiring and one map, and only unchanged."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench_service.campaign.hardware import Hardware
from bench_service.config import BenchConfig, SimulateConfig
from bench_service.store.metadata import MetadataStore
from bench_service.store.verify import verify
from drivers.register_map import MAPS
from models.data.seal import SEAL, content_sha256

IDENTITY = {"maker": "", "model": "", "serial": "17", "firmware": "2"}
CAPABILITIES = {"lock_step": False}
REPORT = {"state": "passed", "reason": None, "identity": IDENTITY, "checks": []}
LIMITS: dict[str, Any] = {"voltage_V": (2.5, 4.2), "current_A": (-5.0, 2.5), "temperature_degC": (0.0, 45.0)}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    with closing(MetadataStore.open(tmp_path)) as opened:
        yield opened


def config(map_name: str = "generic", **changes: Any) -> BenchConfig:
    given: dict[str, Any] = {"url": "modbus-tcp://h:1", "capacity_Ah": 2.5, "limits": LIMITS, "map": map_name}
    return BenchConfig.model_validate(given | changes)


def commissioned(store: MetadataStore, of: BenchConfig, state: str = "passed") -> None:
    hardware = Hardware.read(store, "left", of)
    report = REPORT | {"state": state, "reason": None if state == "passed" else "no watchdog"}
    store.commissionings.add("left", state, lambda key, utc: hardware.document(report, key, utc, "1"))


def standing(store: MetadataStore, of: BenchConfig, **identity: str) -> tuple[str, str]:
    found = Hardware.read(store, "left", of).standing(CAPABILITIES, IDENTITY | identity)
    assert found.warns == (found.state not in ("commissioned", "simulated"))
    return found.state, found.reason or ""


def test_it_is_missing_then_there_then_failed(store: MetadataStore) -> None:
    assert standing(store, config()) == ("missing", "it never was")
    commissioned(store, config())
    assert standing(store, config()) == ("commissioned", "")
    record = store.commissionings.last("left")
    assert record is not None and store.commissionings.get(record.id) == record
    assert record.document[SEAL] == record.sha256 == content_sha256(record.document)
    commissioned(store, config(), "failed")
    assert standing(store, config())[0] == "failed" and "no watchdog" in standing(store, config())[1]
    assert store.commissionings.last("right") is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"url": "modbus-tcp://h:2"}, "url is 'modbus-tcp://h:2'"),
        ({"watchdog_s": 1.5}, "watchdog_s is 1.5 where it was 1.0"),
        ({"external_interlock": True}, "external_interlock is True"),
        ({"map": "ea_psb"}, "the device map 'ea_psb' has changed"),
    ],
)
def test_another_wiring_or_map_voids_it(store: MetadataStore, changes: dict[str, Any], words: str) -> None:
    commissioned(store, config())
    state, reason = standing(store, config(**changes))
    assert state == "void" and words in reason


def test_what_is_no_wiring_may_change(store: MetadataStore) -> None:
    commissioned(store, config())
    narrow = config(limits=LIMITS | {"current_A": (-1.0, 1.0)}, timeout_s=0.2, capacity_Ah=2.4)
    assert standing(store, narrow)[0] == "commissioned"


@pytest.mark.parametrize(("key", "name"), [("serial", "serial number"), ("firmware", "firmware")])
def test_another_device_voids_it(store: MetadataStore, key: str, name: str) -> None:
    commissioned(store, config())
    state, reason = standing(store, config(), **{key: "9"})
    assert state == "void" and f"the {name} is '9'" in reason


def test_a_map_counts_by_its_content(store: MetadataStore, tmp_path: Path) -> None:
    copied = tmp_path / "mine.toml"
    copied.write_text((MAPS / "generic.toml").read_text())
    commissioned(store, config(str(copied)))
    assert standing(store, config("generic"))[0] == "commissioned"
    copied.write_text(copied.read_text().replace('scale = "0.01"', 'scale = "0.1"'))
    assert standing(store, config(str(copied)))[0] == "void"
    copied.unlink()
    assert standing(store, config(str(copied)))[0] == "void"


def test_the_dbc_file_is_part_of_a_can_map(store: MetadataStore, tmp_path: Path) -> None:
    for suffix in ("toml", "dbc"):
        (tmp_path / f"generic_can.{suffix}").write_text((MAPS / f"generic_can.{suffix}").read_text())
    mine = config(str(tmp_path / "generic_can.toml"), url="can://virtual/0")
    commissioned(store, mine)
    dbc = tmp_path / "generic_can.dbc"
    dbc.write_text(dbc.read_text().replace("(0.0001,0)", "(0.001,0)"))
    assert standing(store, mine)[0] == "void"


def test_a_record_that_was_changed_is_none(store: MetadataStore, tmp_path: Path) -> None:
    commissioned(store, config())
    hardware = Hardware.read(store, "left", config())
    assert hardware.record is not None
    forged = replace(hardware.record, document=hardware.record.document | {"limits": {}})
    found = replace(hardware, record=forged).standing(CAPABILITIES, IDENTITY)
    assert found.state == "void" and "damaged or changed" in (found.reason or "")
    assert verify(tmp_path).findings == []


def test_simulated_benches_and_absent_devices_do_not_warn(store: MetadataStore) -> None:
    simulated = Hardware.read(store, "left", BenchConfig(simulate=SimulateConfig()))
    assert simulated.standing(None, None).state == "simulated"
    assert not simulated.standing(None, None).warns
    assert Hardware.read(store, "left", config()).standing({"lock_step": True}, IDENTITY).state == "simulated"
    commissioned(store, config())
    assert Hardware.read(store, "left", config()).standing(None, None).state == "unknown"


def test_another_chamber_is_another_wiring_and_who_it_is_goes_with_each_run(store: MetadataStore) -> None:
    commissioned(store, config())
    with_chamber = config(chamber={"url": "modbus-tcp://h:3"})
    state, reason = standing(store, with_chamber)
    assert state == "void" and "chamber is" in reason and "h:3" in reason
    commissioned(store, with_chamber)
    assert standing(store, with_chamber)[0] == "commissioned"
    told = {"name": "box", "maker": "m", "model": "", "serial": "7", "online": True, "reason": None}
    found = Hardware.read(store, "left", with_chamber).standing(CAPABILITIES, IDENTITY, told)
    assert found.to_json()["chamber"] == {"name": "box", "maker": "m", "serial": "7"}
