"""A cycler behind CAN messages, from the same map and DBC file as the driver, with a codec of its own."""

from collections.abc import Mapping

from drivers.register_map import CanMap
from simulators.can_commands import CanCommands, CanRefusals
from simulators.can_dbc import Layout, read_dbc
from simulators.can_replies import CanReplies
from simulators.can_requests import Asked, CanRequests
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler

__all__ = ["Answer", "CanDevice"]

Answer = list[tuple[str, bytes]]  # messages by name, in order


class CanDevice:
    """The messages of a cycler.

    Parameters
    ----------
    can_map : CanMap
    cycler : Cycler
    clock : SimulatedClock
    refusals : CanRefusals

    Attributes
    ----------
    node : int
        Its number on the bus.
    layouts : mapping of str to Layout
        Of its messages and their views.
    requests : CanRequests
        What the bench may send.
    commands : CanCommands
        What it was told.
    """

    def __init__(self, can_map: CanMap, cycler: Cycler, clock: SimulatedClock, refusals: CanRefusals) -> None:
        self.map, self.cycler, self.clock = can_map, cycler, clock
        self.node = 0
        self._refusals = refusals
        layouts = read_dbc(can_map.dbc)
        self.layouts: Mapping[str, Layout] = layouts | {n: layouts[view.message] for n, view in can_map.views.items()}
        constants = cycler.settings.constants
        self.requests = CanRequests(can_map, self.layouts, constants)
        self.commands = CanCommands(can_map, cycler, clock, refusals)
        self._replies = CanReplies(can_map, self.layouts, cycler, clock, self.commands, constants)

    def poll(self) -> None:
        """Let simulated time catch up with the clock."""
        self.clock.poll(self.cycler)

    def heard(self) -> None:
        """Catch up, then note that a client has sent a message."""
        self.poll()
        self.clock.heard()

    def rest(self) -> None:
        """Switch the output off, as a device does that is being shut down."""
        self.cycler.set_output(False)

    def answer(self, message: str, raws: Mapping[str, float], length: int) -> Answer:
        """Execute a message of the bench and return what the device answers."""
        request = self.requests.read(message, raws, length)
        if request is None:
            return self.refused(self._refusals.no_such_item)
        if isinstance(request, Asked):
            token = request.arguments.get("token", 0.0)
            return [(reply, self.message(reply, token)) for reply in request.ask.replies]
        command = request.command
        code = self.commands.execute(command.name, request.arguments)
        if code is not None:
            return self.refused(code)
        told_at_once = command.echo and command.ask is None
        return [(command.echo, self._replies.repeated(command.echo, raws))] if command.echo and told_at_once else []

    def refused(self, code: int) -> Answer:
        """Return how the device says no; nothing where it cannot."""
        refusal = self._replies.refusal(code)
        return [] if refusal is None else [refusal]

    def message(self, name: str, token: float = 0.0) -> bytes:
        """Return the data of a message of the device as it stands now."""
        return self._replies.message(name, self.node, token)
