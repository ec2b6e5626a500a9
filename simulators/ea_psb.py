"""What an EA PSB does otherwise than the generic cycler (EA guide "ModBus & SCPI", 05-2023).

A command outside remote control is answered with error 7. A set value above an adjusted limit is not taken: over Modbus
the answer looks as always, over CAN an error 3 comes. There is no watchdog on these interfaces, so a client that
vanishes leaves the output on.
"""

from simulators.can_node import CanDevice
from simulators.device import MapDevice

__all__ = ["EaPsb", "EaPsbCan"]

INVALID_ADDRESS, WRONG_VALUE, ACCESS_DENIED = 2, 3, 7


class EaPsb(MapDevice):
    """EA PSB 9000 or 10000 over Modbus."""

    state_refused = ACCESS_DENIED
    tells_refusals = False


class EaPsbCan(CanDevice):
    """EA PSB 9000 or 10000 with the module IF-AB-CAN (sections 8.3.4 and 8.3.6 of the guide)."""

    no_such_item, wrong_state, out_of_range = INVALID_ADDRESS, ACCESS_DENIED, WRONG_VALUE
