"""Questions and commands, with a link that answers by rote."""

import math
import time

import pytest

from drivers.can_codec import CanCodec
from drivers.can_dialogue import CanDialogue
from drivers.can_plan import CanPlan
from drivers.errors import CyclerConnectionError, CyclerTimeoutError, SetPointRefusedError
from drivers.register_map import load_can_map

MAP = load_can_map("generic_can")
CODEC = CanCodec(MAP.dbc)
CONSTANTS = {"i_nom": 30.0, "v_nom": 6.0}


class Link:
    """Answers each message that it knows; `refused` is the message by which it says no instead."""

    address = "link"

    def __init__(self, answers, refused=None):
        self.newest, self.asked = {}, []
        self._answers, self._refused = answers, refused

    async def exchange(self, name, data, replies, what, accept=lambda name, data: True, refusals=()):
        self.asked.append((name, data, tuple(replies)))
        if self._refused is not None and "Refused" in refusals:
            self.newest["Refused"] = time.monotonic(), CODEC.encode("Refused", {"Code": self._refused})
            return "Refused"
        for reply in replies:
            answer = self._answers(reply, data)
            if accept(reply, answer):
                self.newest[reply] = time.monotonic(), answer
        return None

    def check(self, what):
        pass


def dialogue(answers, refused=None):
    link = Link(answers, refused)
    made = CanDialogue(link, MAP, CODEC)  # pyright: ignore[reportArgumentType]
    made.plan = CanPlan(MAP, CODEC, CONSTANTS)
    return made, link


def setpoint(made, current_A=1.0):
    arguments = {"set_current": current_A, "heartbeat": 1.0, "lock_step": 0.0}
    (outgoing,) = made.connected_plan().outgoing("tick", arguments)
    return outgoing


def test_without_a_plan_there_is_no_connection():
    made = CanDialogue(Link(None), MAP, CODEC)  # pyright: ignore[reportArgumentType]
    with pytest.raises(CyclerConnectionError, match="link: not connected"):
        made.connected_plan()


async def test_a_command_that_is_repeated_is_taken():
    made, link = dialogue(lambda reply, data: data)
    await made.command(setpoint(made))
    assert [name for name, _, _ in link.asked] == ["Command"]


async def test_a_command_that_is_repeated_otherwise_is_refused():
    made, _ = dialogue(lambda reply, data: CODEC.encode("CommandEcho", {"SetCurrent": 2.0, "Heartbeat": 1}))
    with pytest.raises(SetPointRefusedError, match="SetCurrent was sent as 1, the device repeats 2"):
        await made.command(setpoint(made))


async def test_a_refusal_is_told_with_its_reason():
    made, _ = dialogue(lambda reply, data: data, refused=3)
    with pytest.raises(SetPointRefusedError, match=r"refused with code 3 \(value out of range\)"):
        await made.command(setpoint(made))


async def test_each_question_has_a_token_of_its_own_and_a_late_answer_is_known():
    made, link = dialogue(lambda reply, data: CODEC.encode(reply, {"Token": 1}))
    await made.ask(MAP.asks["info"])
    assert "Info" in link.newest
    link.newest.clear()
    await made.ask(MAP.asks["info"])  # answered with the token of the question before
    assert "Info" not in link.newest
    assert [data[1] for _, data, _ in link.asked] == [1, 2]


async def test_a_role_that_the_map_lacks_is_missing():
    made, _ = dialogue(lambda reply, data: CODEC.encode(reply, {"Token": data[1], "Serial": 77}))
    assert await made.read_role("serial") == 77.0
    assert math.isnan(await made.read_role("lock_step"))


async def test_a_sample_is_as_old_as_its_oldest_message():
    values = {"Electrical": {"Voltage": 3.7, "Current": -1.5}, "Condition": {"SetpointInForce": -1.5}, "State": {}}

    def answers(reply, data):
        return CODEC.encode(reply, values[reply] | {"Token": data[1]})

    made, link = dialogue(answers)
    reading = await made.sample(0)
    assert (reading.voltage_V, reading.current_A, reading.setpoint_in_force_A) == (3.7, -1.5, -1.5)
    assert reading.monotonic_s == min(arrived_s for arrived_s, _ in link.newest.values())
    assert len(link.asked) == 1, "three messages answer one question"


async def test_a_message_that_never_came_is_told():
    made, _ = dialogue(lambda reply, data: CODEC.encode(reply, {"Token": 99}))
    with pytest.raises(CyclerTimeoutError, match="has not come yet"):
        await made.sample(0)
