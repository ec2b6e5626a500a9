"""What an EA PSB does otherwise than the generic cycler (EA guide "ModBus & SCPI", 05-2023).

A command outside remote control is answered with exception 7; a set value above an adjusted limit is not taken, though
the answer looks as always; and there is no watchdog on this interface, so a client that vanishes leaves the output on.
"""

from simulators.device import MapDevice

__all__ = ["EaPsb"]

NOT_REMOTE = 7


class EaPsb(MapDevice):
    """EA PSB 9000 or 10000."""

    state_refused = NOT_REMOTE
    tells_refusals = False
