"""The states of a run and the ways between them.

`created` is queued and claimed: its bench holds it for the run, and its profile and intent are stored. `fault` is a run
that a safety rule, the device or a lost link has ended. A stop by a person is `stopped`; `interrupted` is what has lost
its service or its control process. Each way is written down, as the run's state and as an event.
"""

from collections.abc import Mapping
from types import MappingProxyType

from bench_service.store.records import RunState

_ENDS: tuple[RunState, ...] = ("completed", "stopped", "fault", "interrupted")
WAYS: Mapping[RunState, tuple[RunState, ...]] = MappingProxyType(
    {
        "created": ("running", *_ENDS),
        "running": ("paused", *_ENDS),
        "paused": ("running", *_ENDS),
        **{end: () for end in _ENDS},
    }
)


def before(state: RunState) -> tuple[RunState, ...]:
    """Return the states from which a run can come into one."""
    return tuple(found for found, ways in WAYS.items() if state in ways)
