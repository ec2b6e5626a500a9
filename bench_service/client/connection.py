"""How the Python client talks to a service: requests and refusals."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

import httpx

API = "/api/v1"

Record = dict[str, Any]


class ClientError(Exception):
    """The service refused a request, or did not answer; the message is the service's own.

    Parameters
    ----------
    message : str
        One line for a person.
    status : int or None
        HTTP status; None where there was no answer.
    code : str
        The service's name for the kind of error.
    where : list
        Path to the offending part of the request.
    """

    def __init__(self, message: str, status: int | None = None, code: str = "no_answer", where: Any = None) -> None:
        super().__init__(message)
        self.status = status
        self.code = code
        self.where = where or []


# The first calculation in a service's life is compiled before: half a minute of processor time, of which a busy machine
# gives a tenth.
AT_WORK_S = 600.0


class Connection:
    """Sends requests to one service; to be closed.

    Parameters
    ----------
    url : str
        Address of the service.
    timeout_s : float
        Longest wait for one answer.
    token : str or None
        Of a service that wants one.
    """

    def __init__(self, url: str, timeout_s: float, token: str | None = None) -> None:
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        # trust_env=False: a proxy from the environment must not stand between a client and its bench.
        self._http = httpx.Client(base_url=url, timeout=timeout_s, trust_env=False, headers=headers)

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def get(self, address: str, **params: Any) -> Any:
        """Ask for JSON; parameters that are None are left out."""
        given = {name: value for name, value in params.items() if value is not None}
        return self.send("GET", address, params=given).json()

    def post(self, address: str, body: Record | None = None, *, at_work: bool = False) -> Any:
        """Send JSON, give the JSON that comes back; `at_work`: the service calculates before it answers."""
        patience = {"timeout": AT_WORK_S} if at_work else {}
        return self.send("POST", address, json=body, **patience).json()

    def send(self, method: str, address: str, **content: Any) -> httpx.Response:
        """Send a request, give its answer; raises `ClientError` where it was refused or none came."""
        try:
            answer = self._http.request(method, address, **content)
        except httpx.HTTPError as error:
            raise ClientError(f"no answer from {self._http.base_url}: {error}") from error
        except ValueError as error:  # a number that JSON has no form for
            raise ClientError(f"the request cannot be written as JSON: {error}", code="bad_request") from error
        if answer.is_success:
            return answer
        raise _refusal(answer)


def _refusal(answer: httpx.Response) -> ClientError:
    try:
        error = answer.json()["error"]
        return ClientError(error["message"], answer.status_code, error["code"], error["where"])
    except (ValueError, KeyError, TypeError):
        shown = f"{answer.status_code} {answer.reason_phrase}"
        return ClientError(f"{answer.url} answered {shown}; is it a bench-service?", answer.status_code, "error")


def part(name: str) -> str:
    """Write a name as one part of an address."""
    return quote(name, safe="")
