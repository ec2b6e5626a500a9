"""What a control process says to the API on the command link, without the key ``op`` that names the kind."""

from typing import Any, NotRequired, TypedDict

STOP_ASKED = "stop_asked"  # an event's code: somebody has asked for a stop past the service; its text is the reason


class StateMessage(TypedDict):
    """A new state of the bench.

    ``capabilities`` are those of `drivers.cycler.Capabilities`, open ends None; ``latch`` is the code of what is
    latched.
    """

    state: str
    reason: str | None
    run_id: str | None
    capabilities: dict[str, Any] | None
    chamber: NotRequired[dict[str, Any] | None]
    latch: NotRequired[str | None]


class EventMessage(TypedDict):
    """Something that happened, for people."""

    severity: str
    code: str
    text: str
    run_id: str | None


class EndedMessage(TypedDict):
    """The end of a run; where the control process has died, nobody knows the counts."""

    run_id: str
    state: str
    reason: str | None
    n_samples: int | None
    missed_ticks: int | None
    sha256: str | None


class LiveMessage(TypedDict):
    """What is measured now; what is not known or not running is None."""

    run_id: str | None
    seq: int | None
    time_s: float | None
    voltage_V: float | None
    current_A: float | None
    temperature_degC: float | None
    ambient_degC: float | None
    setpoint_A: float | None
    soc: float | None
    soc_std: float | None
    progress: float | None
    missed_ticks: int
    lateness_p99_s: float | None
    # Of a bench with a temperature chamber alone.
    chamber_setpoint_degC: NotRequired[float | None]
    chamber_on: NotRequired[bool | None]
    # Of a protocol alone; a run of a profile has none of these keys.
    step_count: NotRequired[int]
    cycle_count: NotRequired[int]
    step_index: NotRequired[int | None]
    step_name: NotRequired[str | None]
    step_time_s: NotRequired[float]
    step_charge_Ah: NotRequired[float]
    step_energy_Wh: NotRequired[float]
