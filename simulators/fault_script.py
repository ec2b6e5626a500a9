"""Scripts of failures: what fails, when it begins, and for how long.

A fault is written ``KIND[.QUANTITY][=VALUE]@WHEN[xMESSAGES][+SECONDS]``, where WHEN is ``t:SECONDS`` of simulated time
or ``EVENT:COUNT`` with an event of `EVENTS`; several are separated by semicolons::

    late=0.4@sample:30                 the 30th question for a sample is answered 0.4 s late
    nan.voltage@t:12.5+3               from 12.5 s on there is no voltage for 3 s
    exception=6@set_point:10x2         two set-points, from the tenth on, are answered with exception 6
"""

import re
from dataclasses import dataclass
from typing import Literal

__all__ = ["DEVICE_KINDS", "EVENTS", "KINDS", "LINK_KINDS", "VALUE_KINDS", "Fault", "parse_faults"]

# What goes wrong with one message, and the size that it has where the script gives none.
LINK_KINDS = {
    "silence": 0.0,  # neither executed nor answered
    "lost_reply": 0.0,  # executed, not answered
    "drop": 0.0,  # the connection is closed (a line or a bus: silence)
    "delay": 0.02,  # answered later by so many seconds, but in time
    "late": 0.4,  # answered after the client's time-out
    "slow": 0.05,  # every message is answered late by so many seconds, for as long as the fault lasts
    "wrong_id": 1.0,  # answered under another unit or identifier
    "corrupt": 0.0,  # check sum or header broken (CAN: cut short)
    "exception": 4.0,  # refused with this code
    "bus_off": 0.0,  # the client's CAN controller leaves the bus (Modbus: the connection is closed)
    "echo": 0.0,  # the client hears its own message instead of an answer
}
# What goes wrong with a measured quantity.
VALUE_KINDS = {
    "stuck": 0.0,
    "nan": 0.0,
    "sentinel": 9.91e37,  # what many instruments send for "not a number" (SCPI-99, 7.2.1.5)
    "jump": 10.0,  # so much is added, in the quantity's unit
    "reversed": 0.0,
    "frozen": 0.0,  # the device stops measuring: values and their counter stay
}
# What goes wrong inside device or cell.
DEVICE_KINDS = {
    "restart": 0.0,  # switched off and on: set-point, limits and remote mode are lost
    "watchdog": 0.0,  # its communication watchdog fires
    "refused": 0.0,  # set-points are acknowledged, but the old one stays in force
    "over_temperature": 5.0,  # the cell warms by so many kelvin a second
    "short": 0.1,  # an internal short of so many ohm
}
KINDS = {**LINK_KINDS, **VALUE_KINDS, **DEVICE_KINDS}
EVENTS = ("message", "sample", "set_point", "output_on")
QUANTITIES = ("voltage", "current", "temperature")
_SYNTAX = re.compile(
    r"(?P<kind>\w+)(?:\.(?P<what>\w+))?(?:=(?P<value>[-+.\deE]+))?@(?P<when>\w+):(?P<at>[.\deE+-]+?)"
    r"(?:x(?P<messages>\d+))?(?:\+(?P<seconds>[.\d]+))?"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One line of a script.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    when : str
        "t", or one of `EVENTS`.
    at : float
        Simulated time in s, or how often the event has happened, counting the one that the fault begins with.
    value : float
        Size of the fault.
    what : str
        Quantity of a value fault.
    messages : int or None
        How many messages it lasts; None: one for a message fault, else without end.
    seconds : float or None
        How long it lasts in simulated time.
    """

    kind: str
    when: str
    at: float
    value: float
    what: Literal["voltage", "current", "temperature"] = "voltage"
    messages: int | None = None
    seconds: float | None = None


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Understand a script.

    Raises
    ------
    ValueError
        Naming the part that is wrong, and what would be right.
    """
    return tuple(_parsed(part.strip()) for part in re.split(r"[;\n]", text) if part.strip())


def _parsed(part: str) -> Fault:
    found = _SYNTAX.fullmatch(part)
    if found is None:
        raise ValueError(f"fault {part!r}: write KIND[.QUANTITY][=VALUE]@WHEN:NUMBER[xMESSAGES][+SECONDS]")
    kind, what, when = found["kind"], found["what"] or "voltage", found["when"]
    if kind not in KINDS:
        raise ValueError(f"fault {part!r}: unknown kind {kind!r}; choose one of {', '.join(KINDS)}")
    if what not in QUANTITIES:
        raise ValueError(f"fault {part!r}: unknown quantity {what!r}; choose one of {', '.join(QUANTITIES)}")
    if when != "t" and when not in EVENTS:
        raise ValueError(f"fault {part!r}: unknown event {when!r}; choose t or one of {', '.join(EVENTS)}")
    try:
        value = KINDS[kind] if found["value"] is None else float(found["value"])
        at, seconds = float(found["at"]), None if found["seconds"] is None else float(found["seconds"])
    except ValueError:
        raise ValueError(f"fault {part!r}: a number cannot be read") from None
    messages = None if found["messages"] is None else int(found["messages"])
    if messages is None and seconds is None and kind in LINK_KINDS and kind != "slow":
        messages = 1
    return Fault(kind, when, at, value, what, messages, seconds)  # pyright: ignore[reportArgumentType]
