"""What a command says: tables and progress bars for a person, one JSON object for a program."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

_WIDTH_IN_A_FILE = 120

Report = Callable[[float, str], None]


class Output:
    """Standard output and standard error of one command.

    Parameters
    ----------
    as_json : bool
        One JSON object on standard output and nothing else there.
    """

    def __init__(self, as_json: bool) -> None:
        self.as_json = as_json
        self._warnings: list[str] = []

    def warn(self, *texts: str) -> None:
        """Keep remarks until there is a result: a command that is refused prints one line only."""
        self._warnings.extend(text for text in texts if text not in self._warnings)

    def result(self, data: Mapping[str, Any], show: Callable[[Console], None]) -> None:
        """Print the answer: `data` for a program, what `show` prints for a person."""
        for text in self._warnings:
            sys.stderr.write(f"warning: {text}\n")
        if self.as_json:
            sys.stdout.write(json.dumps(_plain(data), allow_nan=False) + "\n")
        else:
            # Lazy: rich takes 20 ms.
            from rich.console import Console

            width = None if sys.stdout.isatty() else _WIDTH_IN_A_FILE
            show(Console(highlight=False, soft_wrap=True, width=width))
        sys.stdout.flush()

    @contextmanager
    def progress(self, title: str) -> Iterator[Report]:
        """Show a bar on standard error while a person watches; yields ``report(share done 0..1, what is done)``."""
        if self.as_json or not sys.stderr.isatty():
            yield _silent
            return
        # Lazy: rich takes 30 ms.
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
        note = TextColumn("[dim]{task.fields[note]}")
        with Progress(*columns, note, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=1.0, note="")
            yield lambda share, text="": bar.update(task, completed=share, note=text)


def _silent(_share: float, _text: str = "") -> None:
    """Report to nobody."""


def _plain(value: Any) -> Any:
    """Turn numpy scalars, tuples and not-a-number into what JSON knows; NaN and infinity become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if hasattr(value, "tolist") and not isinstance(value, str):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
