"""What an operation answers with, and what may be asked of it: said beside its route.

``@router.get("", openapi_extra=listed("runs", "Run"))``, ``openapi_extra=record("Run") | asked({"bench": "sim"})``.

`response_schemas` turns it into the schema of the answer. An answer may hold more than is said here; what is said is
always there.
"""

from __future__ import annotations

import json
from typing import Any

# Where it stands in the operation until the schema is made of it.
ANSWER, ASKED, SHOWN = "x-answer", "x-asked", "x-shown"

Said = dict[str, Any]

_BENCH: dict[str, Any] = {
    "name": "sim",
    "url": "modbus-tcp://127.0.0.1:5020",
    "map": "generic",
    "state": "idle",
    "reason": None,
    "run_id": None,
    "capabilities": {"name": "Generic four-quadrant cycler", "current_A": [-30.0, 30.0], "voltage_V": [0.0, 6.0]},
    "capacity_Ah": 2.5,
    "live": {"time_s": None, "voltage_V": 3.7094, "current_A": 0.0, "temperature_degC": 25.0, "soc": None},
    "lock_step": True,
    "chamber": None,
    "cell": None,
    "seal": None,
    "commissioning": {"state": "simulated", "reason": None},
    "limits": {"voltage_V": [2.5, 4.2], "current_A": [-10.0, 5.0], "soc": [0.0, 1.0]},
    "cell_type": None,
}


def asked(body: dict[str, Any]) -> Said:
    """Show a body that may be sent; `response_schemas` puts it into the schema of the request."""
    # As text: the framework takes keys whose value is None out of what it is given.
    return {ASKED: json.dumps(body)}


def shown(answer: dict[str, Any]) -> Said:
    """Show an answer; needed where it is neither a record nor a list of them, which have examples of their own."""
    return {SHOWN: json.dumps(answer)}


def record(name: str) -> Said:
    """Answer with a record of the store, such as ``Run``; see `response_schemas`."""
    return {ANSWER: {"record": name}}


def job() -> Said:
    """Answer with a job."""
    return record("Job")


def listed(key: str, name: str | None = None) -> Said:
    """Answer with a list of records under a key; None: of objects that docs/rest.md describes."""
    return {ANSWER: {"list": key} if name is None else {"list": key, "record": name}}


def paged(key: str, name: str) -> Said:
    """Answer with a page of records under a key, newest first, and ``next_cursor``."""
    return {ANSWER: {"list": key, "record": name, "paged": True}}


def keyed(*keys: str) -> Said:
    """Answer with an object in which these keys are always there."""
    return {ANSWER: {"keys": list(keys)}}


def files(*media_types: str) -> Said:
    """Answer with a file of one of these types, and no JSON."""
    return {ANSWER: {"files": list(media_types)}}


def bench() -> Said:
    """Answer with a bench as it stands now."""
    return keyed(*_BENCH) | shown(_BENCH)


def benches() -> Said:
    """Answer with a list of benches."""
    return listed("benches") | shown({"benches": [_BENCH]})
