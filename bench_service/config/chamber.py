"""The temperature chamber of a bench: where it is, how far it may go, and what becomes of it in the end."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, model_validator

from bench_service.config.table import Number, Positive, Table, Window
from drivers.address import CanAddress, parse_address
from drivers.errors import CyclerConnectionError

_LOOKS = 3  # that may be missed before a chamber counts as lost


def _end(value: Any) -> Any:
    if isinstance(value, bool) or (isinstance(value, str) and value not in ("off", "keep")):
        raise ValueError('must be "off", "keep" or a temperature in degC')
    return value


class SimulatedChamberConfig(Table):
    """How a simulated chamber behaves; ``faults`` is a script of what goes wrong when (docs/cyclers.md)."""

    ramp_K_per_min: Positive = 3.0
    faults: str = ""


class ChamberConfig(Table):
    """A temperature chamber around the cell.

    Without ``url`` it is simulated, as the bench then is. ``temperature_degC`` is the window of its set points; None:
    the bench's own limits of temperature. ``overshoot_K`` is how far its air may be beyond that window, ``lost_s`` how
    long a run goes on without an answer of it. ``at_end`` is what becomes of it after a run that has set it, and after
    every run that did not come to its own end: off, kept as it is, or a set point.
    """

    url: str | None = None
    simulate: SimulatedChamberConfig | None = None
    map: str = "generic_chamber"
    temperature_degC: Window | None = None
    tolerance_K: Positive = 1.0
    overshoot_K: Positive = 5.0
    timeout_s: Positive = 1.0
    lost_s: Positive = 30.0
    at_end: Annotated[Literal["off", "keep"] | Number, BeforeValidator(_end)] = "off"

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if self.lost_s < (least_s := _LOOKS * (1.0 + self.timeout_s)):
            raise ValueError(
                f"lost_s is {self.lost_s:g} s; with a look each second and timeout_s {self.timeout_s:g} s it must be "
                f"at least {least_s:g} s"
            )
        if self.url is None:
            return self
        if self.simulate is not None:
            raise ValueError("give either 'url' (a chamber) or 'simulate' (a simulated one)")
        try:
            address = parse_address(self.url)
        except CyclerConnectionError as error:
            raise ValueError(str(error)) from error
        if isinstance(address, CanAddress):
            raise ValueError(f"{self.url}: a chamber is reached over modbus-tcp or modbus-rtu")
        return self

    def refuses(self, limits_degC: tuple[float, float], *, simulated: bool, lock_step: bool) -> str | None:
        """Say what does not fit to its bench; None where all is well."""
        if self.url is None and not simulated:
            return "chamber: a real cell needs a real chamber; give its 'url'"
        if self.url is not None and lock_step:
            return "chamber: a chamber of its own has no lock-step; set simulate.lock_step = false, or leave 'url' out"
        low, high = window = self.temperature_degC or limits_degC
        if low < limits_degC[0] or high > limits_degC[1]:
            return (
                f"chamber.temperature_degC {low:g} to {high:g} degC leaves limits.temperature_degC {limits_degC[0]:g} "
                f"to {limits_degC[1]:g} degC; narrow it"
            )
        if not isinstance(self.at_end, str) and not window[0] <= self.at_end <= window[1]:
            return f"chamber.at_end {self.at_end:g} degC is outside {low:g} to {high:g} degC; choose one inside"
        return None
