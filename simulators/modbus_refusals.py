"""How a simulated device says no over Modbus: the exception codes, and which of them it uses."""

from dataclasses import dataclass

__all__ = [
    "DEVICE_FAILURE",
    "ILLEGAL_ADDRESS",
    "ILLEGAL_FUNCTION",
    "ILLEGAL_VALUE",
    "NO_SUCH_UNIT",
    "ModbusRefusals",
    "RefusedError",
]

ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3
DEVICE_FAILURE = 4
NO_SUCH_UNIT = 0x0B  # "gateway target device failed to respond"


class RefusedError(Exception):
    """A request that the device answers with a Modbus exception code."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusRefusals:
    """What differs between devices in saying no.

    Attributes
    ----------
    wrong_state : int
        The exception of a command that the device's state does not allow.
    tells_out_of_range : bool
        Whether a set-point out of range is refused; some devices answer as if they had taken it.
    """

    wrong_state: int = DEVICE_FAILURE
    tells_out_of_range: bool = True
