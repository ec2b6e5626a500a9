"""One record written in seventy ways, right and mutilated: each is read right, or asked about in one clear line."""

from pathlib import Path

import pytest

from benchmarks.import_samples import try_variant
from benchmarks.import_variants import TABLE_VARIANTS, record, record_variants, table_of

RECORD = record()
VARIANTS = {title: (table_of(RECORD), variant) for title, variant in TABLE_VARIANTS.items()} | record_variants(RECORD)


@pytest.mark.parametrize("title", VARIANTS)
def test_a_variant_is_read_right_or_asked_about(tmp_path: Path, title: str) -> None:
    table, variant = VARIANTS[title]
    assert try_variant(tmp_path / "run.csv", table, variant, RECORD) == ""
