"""An address of another program that is told of each run that has ended."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import urlsplit

from pydantic import Field, field_validator

from bench_service.config.table import Positive, Table

Secret = Annotated[str, Field(min_length=16, max_length=200, pattern=r"^[\x21-\x7e]+$")]
Token = Annotated[str, Field(min_length=1, max_length=2000, pattern=r"^[\x21-\x7e]+$")]


class WebhookConfig(Table):
    """Where what is sent goes to, how it is signed, and how long it is tried."""

    url: str
    secret: Secret | None = Field(default=None, repr=False)
    token: Token | None = Field(default=None, repr=False)
    timeout_s: Positive = 10.0
    retry_h: Positive = 24.0

    @field_validator("url")
    @classmethod
    def _of_the_web(cls, url: str) -> str:
        try:
            parts = urlsplit(url)
            valid = (
                parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port is None or parts.port > 0)
            )
        except ValueError:
            valid = False
        if not valid:
            raise ValueError(f"{url!r} is no address; write http://host/path or https://host/path")
        return url
