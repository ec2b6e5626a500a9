"""What an EA PSB does otherwise than the generic cycler (EA guide "ModBus & SCPI", 05-2023).

A command outside remote control is answered with error 7. A set value above an adjusted limit is not taken: over Modbus
the answer looks as always, over CAN an error 3 comes. There is no watchdog on these interfaces, so a client that
vanishes leaves the output on.
"""

from simulators.can_commands import CanRefusals
from simulators.modbus_refusals import ModbusRefusals

__all__ = ["EA_PSB", "EA_PSB_CAN"]

INVALID_ADDRESS, WRONG_VALUE, ACCESS_DENIED = 2, 3, 7

# EA PSB 9000 or 10000 over Modbus.
EA_PSB = ModbusRefusals(wrong_state=ACCESS_DENIED, tells_out_of_range=False)
# EA PSB 9000 or 10000 with the module IF-AB-CAN (sections 8.3.4 and 8.3.6 of the guide).
EA_PSB_CAN = CanRefusals(no_such_item=INVALID_ADDRESS, wrong_state=ACCESS_DENIED, out_of_range=WRONG_VALUE)
