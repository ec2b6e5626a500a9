"""What an operation answers with, and what may be asked of it: said beside its route.

``@router.get("", openapi_extra=listed("runs", "Run"))``, ``openapi_extra=record("Run") | asked({"bench": "sim"})``.

`response_schemas` turns it into the schema of the answer. An answer may hold more than is said here; what is said is
always there.
"""

from __future__ import annotations

from typing import Any

# Where it stands in the operation until the schema is made of it.
ANSWER, ASKED = "x-answer", "x-asked"

Said = dict[str, Any]


def asked(body: dict[str, Any]) -> Said:
    """Show a body that may be sent; `response_schemas` puts it into the schema of the request."""
    return {ASKED: body}


def record(name: str) -> Said:
    """Answer with a record of the store, such as ``Run``; see `response_schemas`."""
    return {ANSWER: {"record": name}}


def job() -> Said:
    """Answer with a job."""
    return record("Job")


def listed(key: str, name: str | None = None) -> Said:
    """Answer with a list of records under a key; None: of objects that docs/rest.md describes."""
    return {ANSWER: {"list": key} if name is None else {"list": key, "record": name}}


def keyed(*keys: str) -> Said:
    """Answer with an object in which these keys are always there."""
    return {ANSWER: {"keys": list(keys)}}


def files(*media_types: str) -> Said:
    """Answer with a file of one of these types, and no JSON."""
    return {ANSWER: {"files": list(media_types)}}


def bench() -> Said:
    """Answer with a bench as it stands now."""
    return keyed(
        "name", "url", "map", "state", "reason", "run_id", "capabilities", "capacity_Ah", "live", "lock_step",
        "chamber", "cell", "seal", "commissioning", "limits", "cell_type",
    )  # fmt: skip
