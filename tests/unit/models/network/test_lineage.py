import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.lineage import Version, chain, data_of, network_sha256, run_sha256, version_of, with_version
from models.network.local_model_network import LocalModelNetwork
from tests.unit.models import synthetic
from tests.unit.models.hand_network import everything


def three_versions() -> list[LocalModelNetwork]:
    """A model, its child and its grandchild, oldest first."""
    out = [with_version(everything(1), "fit", [synthetic.run(100, seed=1, name="a")], code_version="1.2")]
    for seed in (2, 3):
        moved = replace(out[-1], theta=out[-1].theta * 1.01)
        out.append(with_version(moved, "refit", [synthetic.run(100, seed=seed, name=f"run {seed}")], parent=out[-1]))
    return out


def test_the_chain_is_walked_from_the_newest_to_the_first() -> None:
    versions = three_versions()
    read = [LocalModelNetwork.from_json(json.loads(json.dumps(v.to_json()))) for v in versions]
    found = chain(read[-1], read)
    assert [network_sha256(n) for n in found] == [network_sha256(v) for v in versions[::-1]]
    numbers = [v.number for n in found if (v := version_of(n))]
    assert numbers == [3, 2, 1]
    assert [run.name for run in data_of(found)] == ["run 3", "run 2", "a"]
    first = version_of(found[-1])
    assert first is not None and first.code_version == "1.2" and first.parent is None


def test_an_ancestor_that_was_changed_or_lost_breaks_the_chain() -> None:
    first, second, third = three_versions()
    with pytest.raises(ModelError, match="not among the 2 known"):
        chain(third, [second, third])
    changed = replace(first, theta=first.theta + 1e-12)
    with pytest.raises(ModelError, match="changed since"):
        chain(third, [changed, second])


def test_the_hash_of_a_run_is_that_of_its_samples() -> None:
    run = synthetic.run(200, seed=1)
    assert run_sha256(run) == run_sha256(replace(run, name="other"))
    for key in ("time_s", "current_A", "voltage_V", "temperature_degC", "soc_ref"):
        moved = getattr(run, key).copy()
        moved[-1] += 1e-9
        assert run_sha256(replace(run, **{key: moved})) != run_sha256(run)
    assert run_sha256(replace(run, soc_ref=None)) != run_sha256(run)
    signalling = run.voltage_V.copy()
    signalling[3] = np.uint64(0x7FF8DEAD00000000).view(np.float64)
    plain = np.where(np.isnan(signalling), np.nan, run.voltage_V)
    assert run_sha256(replace(run, voltage_V=signalling)) == run_sha256(replace(run, voltage_V=plain))


def test_a_reference_hash() -> None:
    """Format: name, colon, length, semicolon, little-endian doubles; computed with hashlib on bytes written by hand."""
    import hashlib
    import struct

    run = replace(synthetic.run(100, seed=1), soc_ref=None)
    cut = {key: getattr(run, key)[:2] for key in ("time_s", "current_A", "voltage_V", "temperature_degC")}
    short = replace(run, **cut)
    expected = b"".join(f"{key}:2;".encode() + struct.pack("<2d", *values) for key, values in cut.items())
    assert run_sha256(short) == hashlib.sha256(expected).hexdigest()


@pytest.mark.parametrize(
    "damage",
    [
        {"schema_version": 2},
        {"made_by": "magic"},
        {"number": 0},
        {"parent": None},
        {"runs": [{"name": "a"}]},
        {"more": 1},
        {"runs": 5},
    ],
)
def test_damaged_versions_are_refused(damage: dict) -> None:
    version = version_of(three_versions()[1])
    assert version is not None
    assert Version.from_json(json.loads(json.dumps(version.to_json()))) == version
    with pytest.raises(ModelError):
        Version.from_json(version.to_json() | damage)
