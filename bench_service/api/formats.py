"""File formats in which runs can be taken away."""

from __future__ import annotations

from fastapi import APIRouter

from bench_service.api.answers import listed, shown
from bench_service.campaign.crating import CRATE, TITLE
from bench_service.exchange.ro_crate import MEDIA_TYPE, SUFFIX
from bench_service.exchange.write import export_formats

router = APIRouter(tags=["samples"])


def known_formats() -> list[dict[str, str]]:
    """Return name, title, suffix and media type of all that a run can be exported in."""
    fields = ("name", "title", "suffix", "media_type")
    found = [{field: getattr(each, field) for field in fields} for each in export_formats().values()]
    return [*found, {"name": CRATE, "title": TITLE, "suffix": SUFFIX, "media_type": MEDIA_TYPE}]


@router.get(
    "/formats",
    openapi_extra=listed("formats")
    | shown(
        {
            "formats": [
                {
                    "name": "bdf",
                    "title": "Battery Data Format 1.3.0, CSV",
                    "suffix": ".bdf.csv",
                    "media_type": "text/csv",
                }
            ]
        }
    ),
)
def list_formats() -> dict[str, list[dict[str, str]]]:
    """List the formats that a run can be exported in: name, title, suffix and media type."""
    return {"formats": known_formats()}
