"""A module over REST: its runs imported, a model identified, compared and observed; as `fit --module` finds it."""

import json
from pathlib import Path
from typing import Any

import pytest
from cli_rig import answer, call
from rest_rig import Rest

from bench_service.client import ClientError
from tests.patience import LONG_S
from tests.unit.models.module import synthetic_module as truth

pytestmark = pytest.mark.timeout(2 * LONG_S)
LAYOUT = {"in_series": truth.SERIES, "parallel": truth.PARALLEL}


def imported(rest: Rest, path: Path) -> str:
    upload = rest.client.upload_file(path)
    return rest.client.store_import(upload["id"], truth.CAPACITY_AH, 0.6, timeout_s=LONG_S)["run"]


def errors(models: list[dict[str, Any]], part: str) -> dict[str, float]:
    return {each["kind"]: each[part]["rmse_mV"] for each in models}


def test_a_module_is_identified_compared_and_observed(rest: Rest, tmp_path: Path) -> None:
    paths = [truth.written(tmp_path / f"{name}.csv", seed) for name, seed in (("a", 1), ("b", 2))]
    train, judged = (imported(rest, path) for path in paths)
    made = rest.client.fit(
        "m", [train], truth.CAPACITY_AH, validate=[judged], structure="minimal", module=LAYOUT, timeout_s=LONG_S
    )
    module = made["metrics"]["module"]
    assert module["chosen"] == "S3" and module["weak_group"]["group"] == 2
    # The same samples, the same figures as from the files by command line.
    options = (
        "--module",
        "--layout",
        f"{truth.SERIES}x{truth.PARALLEL}",
        "--structure",
        "minimal",
        "--out",
        tmp_path / "m.json",
        "--json",
    )
    files = answer(call("fit", paths[0], "--validate", paths[1], "--capacity-Ah", truth.CAPACITY_AH, *options))
    for part in ("train", "validation"):
        said = errors(files["module"]["models"], part)
        assert errors(module["models"], part) == pytest.approx(said, rel=1e-3)
    found = rest.client.compare(made["id"], [judged])["result"]
    assert errors(found["module"]["models"], "overall")["S3"] == pytest.approx(found["overall"]["rmse_mV"], rel=1e-6)
    assert found["module"]["weak_group"]["group"] == 2
    observed = rest.client.observe(made["id"], [judged], initial_soc=0.4, timeout_s=LONG_S)
    assert observed["runs"][0]["soc_rmse"] < 0.03
    # What was taken down is a document that the command line reads, and another service stores.
    document = rest.client.model_document(made["id"])
    (tmp_path / "down.json").write_text(json.dumps(document), encoding="utf-8")
    again = answer(call("compare", tmp_path / "down.json", paths[1], "--json"))
    assert again["overall"]["rmse_mV"] == pytest.approx(found["overall"]["rmse_mV"], rel=1e-3)
    # A module's model is none of one cell.
    with pytest.raises(ClientError, match="module"):
        rest.client.fit(
            "n", [train], truth.CAPACITY_AH, module=LAYOUT | {"cell_model_id": made["id"]}, timeout_s=LONG_S
        )
    with pytest.raises(ClientError, match="the layout says 4 in series"):
        rest.client.fit("n", [train], truth.CAPACITY_AH, module={"in_series": 4}, timeout_s=LONG_S)
