"""What becomes of each frame that comes in, without any bus."""

import can
import pytest

from drivers.address import parse_address
from drivers.can_identifiers import CanIdentifiers, identifiers_of
from drivers.can_inbox import SENT_REMEMBERED, CanInbox
from drivers.errors import CyclerConnectionError, CyclerProtocolError

OWN = CanIdentifiers({"Ask": 0x100, "Tell": 0x101, "Both": 0x110}, {0x105: "Answer", 0x106: "No", 0x110: "Both"}, False)


def frame(identifier, data=b"\x01", **more):
    return can.Message(arbitration_id=identifier, data=data, **{"is_extended_id": False, **more})


def inbox(*, returns_own=False, view_of=lambda name, data: name):
    return CanInbox(OWN, view_of, returns_own=returns_own, log=None)


def anything(name, data):
    return True


def test_the_newest_frame_of_each_message_is_kept():
    box = inbox()
    for data in (b"\x01", b"\x02"):
        box.received(frame(0x105, data))
    assert box.newest["Answer"][1] == b"\x02" and set(box.newest) == {"Answer"}


@pytest.mark.parametrize(
    "foreign",
    [
        frame(0x7FF),
        frame(0x105, is_extended_id=True),
        can.Message(arbitration_id=0x105, is_remote_frame=True, dlc=1, is_extended_id=False),
    ],
)
def test_what_others_send_is_passed_over(foreign):
    box = inbox()
    box.received(foreign)
    assert not box.newest and box.foreign is None and box.failure is None


def test_own_identifiers_from_another_sender_are_told():
    box = inbox(returns_own=True)
    box.sent(0x100, b"\x01")
    box.received(frame(0x100, b"\x01"))
    assert box.foreign is None
    box.received(frame(0x100, b"\x01"))  # once sent, seen twice
    assert "another sender uses identifier 0x100" in (box.foreign or "")


@pytest.mark.parametrize("returns_own", [False, True])
def test_a_shared_identifier_is_an_answer_unless_the_bus_returns_what_was_sent(returns_own):
    box = inbox(returns_own=returns_own)
    box.sent(0x110, b"\x01")
    box.received(frame(0x110, b"\x01"))
    assert ("Both" in box.newest) != returns_own
    box.received(frame(0x110, b"\x01"))
    assert "Both" in box.newest and box.foreign is None


def test_only_so_many_own_frames_are_remembered():
    box = inbox(returns_own=True)
    for number in range(SENT_REMEMBERED + 1):
        box.sent(0x100, number.to_bytes(2, "little"))
    box.received(frame(0x100, b"\x01\x00"))
    assert box.foreign is None
    box.received(frame(0x100, b"\x00\x00"))
    assert box.foreign is not None


async def test_a_wait_ends_with_the_last_answer():
    box = inbox()
    box.received(frame(0x105))  # what came before the question is no answer to it
    waiting = box.wait_for(("Answer", "Both"), anything, ())
    box.received(frame(0x105))
    assert waiting.missing == {"Both"} and not waiting.future.done()
    box.received(frame(0x110))
    assert not waiting.missing and waiting.future.done()
    box.received(frame(0x110))  # one more does no harm


async def test_the_answer_to_an_earlier_question_is_not_even_kept():
    box = inbox()
    waiting = box.wait_for(("Answer",), lambda name, data: data == b"\x02", ())
    box.received(frame(0x105, b"\x01"))
    assert waiting.missing == {"Answer"} and not box.newest
    box.received(frame(0x105, b"\x02"))
    assert waiting.future.done() and box.newest["Answer"][1] == b"\x02"


async def test_a_refusal_ends_the_wait_and_stands_in_what_is_missing():
    box = inbox()
    waiting = box.wait_for(("Answer",), anything, ("No",))
    box.received(frame(0x106, b"\x03"))
    assert waiting.future.done() and waiting.missing == {"No"} and box.newest["No"][1] == b"\x03"


async def test_nobody_waits_after_the_wait():
    box = inbox()
    waiting = box.wait_for(("Answer",), anything, ())
    box.wait_for_nothing()
    box.received(frame(0x105))
    assert not waiting.future.done() and "Answer" in box.newest


async def test_bus_off_ends_the_wait_and_the_first_reason_stays():
    box = inbox()
    waiting = box.wait_for(("Answer",), anything, ())
    box.received(frame(0x08, is_error_frame=True))
    assert box.error_frames == 1 and box.failure is None and not waiting.future.done()
    box.received(frame(0x40, is_error_frame=True))
    box.failed("the bus is lost")
    assert waiting.future.done() and waiting.missing == {"Answer"}
    assert box.error_frames == 2 and "bus-off" in (box.failure or "")


def test_a_frame_too_short_for_any_view_is_passed_over():
    def view_of(name, data):
        raise CyclerProtocolError("too short")

    box = inbox(view_of=view_of)
    box.received(frame(0x105))
    assert not box.newest


def test_identifiers_are_those_of_the_node():
    address = parse_address("can://virtual/x?node=3")
    found = identifiers_of(address, {"Ask": 0x100}, {"Answer": 0x105}, 16)
    assert (found.sends, found.receives, found.extended) == ({"Ask": 0x130}, {0x135: "Answer"}, False)
    assert identifiers_of(address, {"Ask": 0x800}, {}, 16).extended
    with pytest.raises(CyclerConnectionError, match="node 3 needs identifier 0xD00; too large"):
        identifiers_of(address, {"Ask": 0x100}, {}, 1024)
    with pytest.raises(CyclerConnectionError, match="too large"):
        identifiers_of(address, {"Ask": 0x1FFFFFFF}, {}, 1)
