"""The sealed effect of a simulated bench: drawn once, kept in a file that nobody needs to look into."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.cli.errors import UsageError
from simulators.catalogue import cell_type

if TYPE_CHECKING:
    from simulators.hidden_effect import HiddenEffect


def sealed_effect(name: str, cell: str, seed: int, path: Path | None) -> HiddenEffect:
    """Draw an effect, or take the one that the file has sealed for the same wish.

    Parameters
    ----------
    name : str
        Of an effect, or "random".
    cell : str
        Chemistry of the simulated cell.
    seed : int
        The same seed draws the same effect.
    path : Path or None
        Where the seal is kept, so that it holds from one start to the next.

    Raises
    ------
    UsageError
        The effect cannot be hidden, or the file holds no seal.
    """
    # Lazy: numpy takes 80 ms.
    from bench_service.exchange.atomic import write_atomically
    from simulators.hidden_effect import HiddenEffect, draw

    wish = {"name": name, "cell": cell, "seed": seed}
    if path is not None and path.exists():
        try:
            kept = json.loads(path.read_bytes())
            if kept["wish"] == wish:
                return HiddenEffect(**kept["effect"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{path}: holds no sealed effect ({error!r}); remove it to draw anew") from error
    try:
        hidden = draw(name, cell_type(cell).parameters, seed)
    except ValueError as error:
        raise UsageError(f"--hidden-effect: {error}") from None
    if path is not None:
        told = {"contents": hidden.contents, "sha256": hidden.seal, "unit": hidden.unit}
        document = {"wish": wish, "effect": asdict(hidden), **told, "opened_utc": None}
        write_atomically(path, (json.dumps(document) + "\n").encode())
    return hidden
