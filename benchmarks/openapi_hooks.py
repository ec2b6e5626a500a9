"""Hooks of schemathesis (its own environment) that put real ids in the place of most generated ones.

`openapi_cases.py` names this module in SCHEMATHESIS_HOOKS and gives the ids as JSON in BENCH_IDS: parameter -> ids.
"""

import json
import os
import random
from typing import Any

import schemathesis  # pyright: ignore[reportMissingImports]

IDS: dict[str, list[str]] = json.loads(os.environ["BENCH_IDS"])
SHARE = 0.8
BODY = {"bench": "name", "train": "run_id", "validate": "run_id", "run_ids": "run_id", "train_run_ids": "run_id"}
BODY |= {"validate_run_ids": "run_id", "like": "cell_id"}
_DRAW = random.Random(int(os.environ.get("BENCH_SEED", "1")))


def _real(name: str, generated: Any) -> Any:
    ids = IDS.get(BODY.get(name, name), [])
    if not ids or _DRAW.random() > SHARE:
        return generated
    return [_DRAW.choice(ids)] if isinstance(generated, list) else _DRAW.choice(ids)


@schemathesis.hook
def map_path_parameters(context: Any, path_parameters: Any) -> Any:
    """Put real ids into the address."""
    return {name: _real(name, value) for name, value in (path_parameters or {}).items()}


@schemathesis.hook
def map_body(context: Any, body: Any) -> Any:
    """Put real ids into the body."""
    return {name: _real(name, value) for name, value in body.items()} if isinstance(body, dict) else body
