"""File formats in which runs can be taken away."""

from __future__ import annotations

from fastapi import APIRouter

from bench_service.exchange.write import export_formats

router = APIRouter(tags=["samples"])


@router.get("/formats")
def list_formats() -> dict[str, list[dict[str, str]]]:
    """List the formats that a run can be exported in: name, title, suffix and media type."""
    fields = ("name", "title", "suffix", "media_type")
    return {"formats": [{field: getattr(each, field) for field in fields} for each in export_formats().values()]}
