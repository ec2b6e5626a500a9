"""Coming to rest over a link that may be broken, without any link at all."""

import math
from dataclasses import dataclass, field

import pytest

import drivers.rest
from drivers.cycler import Reading
from drivers.errors import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError
from drivers.rest import check_cleared, come_to_rest, wait_for_output


@dataclass
class Link:
    """Breaks at the steps named in `breaks`, once each."""

    breaks: list[str] = field(default_factory=list)
    is_open: bool = True
    address: str = "link"
    done: list[str] = field(default_factory=list)
    reopened: int = 0

    def step(self, name, error=None):
        async def take():
            if name in self.breaks:
                self.breaks.remove(name)
                self.is_open = False
                raise CyclerTimeoutError(f"{name}: no answer")
            if error is not None:
                raise error
            self.done.append(name)

        return take

    async def reopen(self):
        self.reopened += 1
        self.is_open = True


async def test_every_step_is_taken_in_order():
    link = Link()
    await come_to_rest(link, [link.step("zero"), link.step("off")], link.reopen)
    assert link.done == ["zero", "off"] and link.reopened == 0


async def test_a_step_at_which_the_link_broke_is_taken_again_on_a_fresh_one():
    link = Link(["zero", "off"])
    await come_to_rest(link, [link.step("zero"), link.step("off"), link.step("seen")], link.reopen)
    assert link.done == ["zero", "off", "seen"] and link.reopened == 2


async def test_what_the_device_refuses_is_told_and_the_other_steps_are_taken():
    link = Link()
    refused = link.step("zero", CyclerProtocolError("zero: refused"))
    with pytest.raises(CyclerProtocolError, match="not verified to be at rest: zero: refused"):
        await come_to_rest(link, [refused, link.step("off")], link.reopen)
    assert link.done == ["off"] and link.reopened == 0


async def test_a_link_that_stays_broken_is_opened_twice_and_no_more():
    link = Link(is_open=False)

    async def in_vain():
        link.reopened += 1
        raise CyclerConnectionError("link: nobody there")

    with pytest.raises(CyclerConnectionError, match="at rest: link: nobody there; link: not connected"):
        await come_to_rest(link, [link.step("zero"), link.step("off"), link.step("seen")], in_vain)
    assert link.done == [] and link.reopened == 2


def reading(*, on=False, alarms=()):
    return Reading(0.0, 1, 3.7, 0.0, 25.0, math.nan, 0.0, on, frozenset(), frozenset(alarms))


async def test_an_output_may_take_its_time_but_not_for_ever(monkeypatch):
    monkeypatch.setattr(drivers.rest, "OUTPUT_SETTLE_S", 0.03)
    seen = [reading(on=True), reading(on=True), reading()]

    async def sample():
        return seen.pop(0)

    await wait_for_output("link", sample, on=False)
    assert not seen

    async def stuck():
        return reading(on=True, alarms=["internal"])

    with pytest.raises(CyclerProtocolError, match=r"switched off, but the status says otherwise.*alarms: internal"):
        await wait_for_output("link", stuck, on=False)


def test_alarms_that_stay_are_named():
    check_cleared("link", reading())
    with pytest.raises(CyclerProtocolError, match="alarms stay after clearing: a, b; remove"):
        check_cleared("link", reading(alarms=["b", "a"]))
