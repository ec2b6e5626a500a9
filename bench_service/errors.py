"""Errors of the service: what is wrong, where, and what to do about it.

The application maps each class to an HTTP status; nothing here knows HTTP.
"""

from collections.abc import Sequence

Where = tuple[str | int, ...]


class ServiceError(Exception):
    """Anything the service tells a client about.

    Parameters
    ----------
    message : str
        One line for a person: what, where, the value with its unit, the limit, what to do.
    where : sequence of str or int, optional
        Path to the offending part of the request, e.g. ``("current_A", 17)``.

    Attributes
    ----------
    code : str
        Stable machine-readable name of the kind of error.
    """

    code = "error"

    def __init__(self, message: str, where: Sequence[str | int] = ()) -> None:
        super().__init__(message)
        self.message = message
        self.where: Where = tuple(where)


class NotFoundError(ServiceError):
    """The named thing does not exist."""

    code = "not_found"

    @classmethod
    def of(cls, kind: str, name: str) -> "NotFoundError":
        """Return the error for an unknown `kind` (``"run"``) of the given `name` or id."""
        return cls(f"unknown {kind} {name!r}", (kind,))


class BadRequestError(ServiceError):
    """The request cannot be carried out as it is written.

    Parameters
    ----------
    what : str
        What is wrong, e.g. ``"current above the limit"``.
    where : sequence of str or int, optional
        Path to the offending part of the request.
    value : object, optional
        The offending value, shown with `unit`.
    unit : str, optional
        Unit of `value` and `limit`, e.g. ``"A"``.
    limit : object, optional
        What is allowed: a bound or a ``(low, high)`` pair.
    remedy : str, optional
        What to do about it.
    """

    code = "bad_request"

    def __init__(
        self,
        what: str,
        where: Sequence[str | int] = (),
        *,
        value: object = None,
        unit: str = "",
        limit: object = None,
        remedy: str = "",
    ) -> None:
        super().__init__(_sentence(what, where, value, unit, limit, remedy), where)


class ConflictError(ServiceError):
    """The request contradicts the present state."""

    code = "conflict"


class BenchBusyError(ConflictError):
    """The bench plays another run."""

    code = "bench_busy"


class BenchOfflineError(ServiceError):
    """The bench, or the recorder that it needs, is not there."""

    code = "bench_offline"


class StoreError(ServiceError):
    """The store cannot be opened, read or written."""

    code = "store"


class GivenUpError(StoreError):
    """Samples were deleted by the rule of retention."""

    code = "given_up"


class NoRoomError(StoreError):
    """The disk has too little room for what is asked."""

    code = "no_room"


class DamagedError(StoreError):
    """Samples that were stored are not there any more, or not as they were."""

    code = "damaged"


def _sentence(what: str, where: Sequence[str | int], value: object, unit: str, limit: object, remedy: str) -> str:
    suffix = f" {unit}" if unit else ""
    text = what
    if where:
        text += f" at {'.'.join(str(part) for part in where)}"
    if value is not None:
        text += f": {_shown(value)}{suffix}"
    if limit is not None:
        text += f", limit {_shown(limit)}{suffix}"
    return f"{text}; {remedy}" if remedy else text


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, (tuple, list)) and len(value) == 2:
        return f"{_shown(value[0])} to {_shown(value[1])}"
    return str(value)
