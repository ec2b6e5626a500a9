"""Serves the page, its modules and the vendored chart library, with the headers that keep it at home."""

from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from fastapi.staticfiles import StaticFiles
from fastapi.templating import Jinja2Templates

from bench_service.web.reference import reference

_HERE = Path(__file__).parent

# The page shows and commands hardware: nothing may be loaded from, or sent to, another host, no inline script
# or style is allowed, and nobody may frame it (a STOP button under somebody else's picture).
SECURITY_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; font-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    # Revalidated by ETag on each load, so that a page never runs modules of two versions.
    "Cache-Control": "no-cache",
}

router = APIRouter(include_in_schema=False)
_templates = Jinja2Templates(directory=_HERE / "templates")
_static = StaticFiles(directory=_HERE / "static")


@router.get("/", response_class=HTMLResponse)
async def page(request: Request) -> Response:
    """Return the page; everything that changes reaches it through the API."""
    return _page(request, "bench.html")


@router.get("/runs/{run_id}", response_class=HTMLResponse)
async def run_page(request: Request, run_id: str) -> Response:
    """Return the page of a run; it says by itself where there is none of that name."""
    return _page(request, "run.html")


@router.get("/import", response_class=HTMLResponse)
async def import_page(request: Request) -> Response:
    """Return the page where files of other programs come in."""
    return _page(request, "import.html")


@router.get("/improve", response_class=HTMLResponse)
async def improve_page(request: Request) -> Response:
    """Return the page where a model is held against measurements and improved; the place in it is its address."""
    return _page(request, "improve.html")


@router.get("/cells", response_class=HTMLResponse)
async def cells_page(request: Request) -> Response:
    """Return the page of all cells."""
    return _page(request, "cells.html")


@router.get("/cells/{cell_id}", response_class=HTMLResponse)
async def cell_page(request: Request, cell_id: str) -> Response:
    """Return the page of a cell; it says by itself where there is none of that name."""
    return _page(request, "cell.html")


@router.get("/life", response_class=HTMLResponse)
async def life_page(request: Request) -> Response:
    """Return the page of a cell's life: its runs against a model of the cell as it was."""
    return _page(request, "life.html")


@router.get("/reference", response_class=HTMLResponse)
async def reference_page(request: Request) -> Response:
    """Return the page of the REST interface, made from its own description; nothing comes from elsewhere."""
    return _page(request, "reference.html", sections=reference(request.app.openapi()))


def _page(request: Request, template: str, **parts: Any) -> Response:
    context = {"version": request.app.version, "openapi_url": request.app.openapi_url, **parts}
    return _templates.TemplateResponse(request, template, context, headers=_page_headers(request))


def _page_headers(request: Request) -> dict[str, str]:
    """Let the page reach the benches' stop ports too, and nothing else beside this service."""
    benches = getattr(request.app.state.services, "benches", ())
    ports = [bench.supervisor.stop_endpoint for bench in benches]
    own = " ".join(["'self'", *(port.ticket.url for port in ports if port is not None)])
    policy = SECURITY_HEADERS["Content-Security-Policy"].replace("connect-src 'self'", f"connect-src {own}")
    return SECURITY_HEADERS | {"Content-Security-Policy": policy}


@router.get("/static/{path:path}", response_class=Response)
async def static_file(request: Request, path: str) -> Response:
    """Return one static file.

    Parameters
    ----------
    request
        The request, for its conditional headers.
    path
        The file below ``static/``.

    Raises
    ------
    starlette.exceptions.HTTPException
        404 where there is no such file below ``static/``.
    """
    # A route, not a mount: a router that is included in an application does not carry mounts along.
    response = await _static.get_response(path, request.scope)
    response.headers.update(SECURITY_HEADERS)
    return response
