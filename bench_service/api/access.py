"""Who may use a service that listens beyond its own machine: whoever has its token.

A program sends it as a header, ``Authorization: Bearer TOKEN``, also to open the WebSocket. A person opens the login
link that the service prints at its start; the page then has a cookie that no script can read and no other site can
make the browser send. Roles would be told apart in `Access.refusal`.
"""

from __future__ import annotations

import hashlib
import secrets
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import RedirectResponse, Response
from starlette.types import Scope

from bench_service.api.errors import error_response

LOGIN = "/login"
COOKIE = "bench_session"
_COOKIE_DAYS = 30
_REFUSAL = (
    "this service wants its token: a page is opened with the login link that it printed at its start, "
    "a program sends 'Authorization: Bearer TOKEN'"
)


class Access:
    """Checks the token of requests.

    Parameters
    ----------
    token : str
    """

    def __init__(self, token: str) -> None:
        self._token = token.encode()
        # Not the token itself: a cookie that is stolen from a disk opens the page, and no more than that.
        self._session = hashlib.sha256(b"page:" + self._token).hexdigest().encode()

    def refusal(self, scope: Scope) -> str | None:
        """Say why a request is turned away; None where it may pass."""
        headers = Headers(scope=scope)
        scheme, _, given = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and secrets.compare_digest(given.strip().encode(), self._token):
            return None
        if secrets.compare_digest(_cookie(headers.get("cookie", "")), self._session):
            return None
        return _REFUSAL

    def login(self, scope: Scope) -> Response:
        """Answer the login link: the page and its cookie where the token is right."""
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if not secrets.compare_digest(given.encode(), self._token):
            return error_response(401, "unauthorized", "this login link is not of this service's present token")
        answer = RedirectResponse("/", 303, headers={"Cache-Control": "no-store", "Referrer-Policy": "no-referrer"})
        answer.set_cookie(
            COOKIE, self._session.decode(), max_age=86400 * _COOKIE_DAYS, httponly=True, samesite="strict", path="/"
        )
        return answer


def _cookie(text: str) -> bytes:
    try:
        found = SimpleCookie(text).get(COOKIE)
    except CookieError:
        return b""
    return b"" if found is None else found.value.encode()
