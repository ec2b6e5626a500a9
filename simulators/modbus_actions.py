"""What can be done with a Modbus request instead of answering it: the seam by which faults come in."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

__all__ = ["DROP", "SILENCE", "Action", "Frame", "OnRequest", "delay"]


class Frame(NamedTuple):
    """One request."""

    transaction_id: int
    unit_id: int
    pdu: bytes

    @property
    def function(self) -> int:
        """The function code."""
        return self.pdu[0]


@dataclass(frozen=True, slots=True)
class Action:
    """What a fault hook wants done with one request.

    Attributes
    ----------
    execute : bool
        Whether the request takes effect.
    reply : bool
        Whether it is answered.
    delay_s : float
        How long the answer is held back; answers to later requests are not.
    exception : int or None
        Answer with this code; the request then has no effect.
    close : bool
        Close the connection instead of answering.
    change : Callable or None
        Makes the answer that is sent from the request and the right answer, both without header or check sum.
    corrupt : bool
        Break the answer's check sum; where there is none (TCP), the header.
    unit_id : int or None
        Answer as if from this unit.
    echo : bool
        The request comes back instead of an answer, and has no effect.
    """

    execute: bool = True
    reply: bool = True
    delay_s: float = 0.0
    exception: int | None = None
    close: bool = False
    change: Callable[[bytes, bytes], bytes] | None = None
    corrupt: bool = False
    unit_id: int | None = None
    echo: bool = False

    def answered(self, frame: Frame, execute: Callable[[], bytes]) -> bytes:
        """Return the answer's PDU before `change`, empty if there is none; the request takes effect if it shall."""
        if self.exception is not None:
            return bytes((frame.function | 0x80, self.exception))
        if self.echo:
            return frame.pdu
        return execute() if self.execute else b""

    def changed(self, request: bytes, answer: bytes) -> bytes:
        """Return the answer that is sent in place of the right one."""
        return answer if self.change is None else self.change(request, answer)


SILENCE = Action(execute=False, reply=False)
DROP = Action(execute=False, reply=False, close=True)
OnRequest = Callable[[Frame], Action | None]


def delay(time_s: float) -> Action:
    """Return an action that executes a request at once and answers late."""
    return Action(delay_s=time_s)
