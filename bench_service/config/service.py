"""Everything the service is told from outside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator

from bench_service.config.bench import BenchConfig
from bench_service.config.simulate import SimulateConfig
from bench_service.config.table import NotNegative, Table
from bench_service.config.webhook import WebhookConfig

_FILE_END = r"^\.[a-z0-9]{1,12}$"
_BENCH_NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"


class ServiceConfig(Table):
    """Everything the service is told from outside."""

    data_dir: Path = Path("bench-data")
    # Whose service it is: the first part of the names of files that go out.
    institution: str = Field(default="laboratory", min_length=1, max_length=60)
    workers: int = Field(default=1, ge=1, le=64, strict=True)
    # Below it no run is taken: a bench that fills the disk takes the record of its own end with it.
    free_floor_MB: NotNegative = 200.0
    worker_nice: int = Field(default=19, ge=0, le=19, strict=True)
    webhook: WebhookConfig | None = None
    # End of a file's name -> command of the user's own that prints such a file as a table (docs/files.md).
    readers: dict[
        Annotated[str, Field(pattern=_FILE_END)],
        Annotated[list[Annotated[str, Field(min_length=1, max_length=4096)]], Field(min_length=1, max_length=64)],
    ] = {}
    bench: dict[Annotated[str, Field(pattern=_BENCH_NAME)], BenchConfig] = {
        "sim": BenchConfig(simulate=SimulateConfig())
    }

    @field_validator("bench")
    @classmethod
    def _at_least_one(cls, bench: dict[str, BenchConfig]) -> dict[str, BenchConfig]:
        if not bench:
            raise ValueError("needs at least one bench, a table [bench.NAME]")
        return bench
