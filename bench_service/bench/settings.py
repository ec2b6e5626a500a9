"""What a control process knows about its bench; handed to it as one JSON argument."""

import json
from dataclasses import asdict, dataclass
from typing import Any, Self

from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.latch import Latch
from bench_service.bench.limits import Limits

LONGEST_WATCHDOG_S = 2.0


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """One bench.

    Parameters
    ----------
    name : str
    url : str
        E.g. ``modbus-tcp://127.0.0.1:5020``.
    map : str
        Device map: a name or the path of a file.
    limits : Limits
        No run may leave them.
    timeout_s : float
        Longest wait for one answer of the device.
    watchdog_s : float
        Communication watchdog to set in the device.
    external_interlock : bool
        Declares hardware of its own that cuts the cell off; without it a device watchdog of at most
        `LONGEST_WATCHDOG_S` is needed.
    lock_step : bool or None
        None: where the device can.
    current_tolerance_A : float or None
        Allowed difference between measured and commanded current; None: 0.5 % of the device's range. One percent
        of the commanded current is always added.
    lease_s : float
        Longest silence of the service in which a run goes on.
    capacity_Ah : float
        Of the cell that is usually on the bench, for what is plausible at rest.
    latched : Latch or None
        A fault that an earlier process of this bench left unacknowledged.
    resistance_Ohm : tuple of float or None
        Band of the type of that cell, where one is named.
    identity : dict of str to str, or None
        What the device has said of itself to an earlier process.
    chamber : ChamberSettings or None
    """

    name: str
    url: str
    map: str
    limits: Limits
    timeout_s: float = 0.5
    watchdog_s: float = 1.0
    external_interlock: bool = False
    lock_step: bool | None = None
    current_tolerance_A: float | None = None
    lease_s: float = 10.0
    capacity_Ah: float = 2.5
    latched: Latch | None = None
    resistance_Ohm: tuple[float, float] | None = None
    identity: dict[str, str] | None = None
    chamber: ChamberSettings | None = None

    def to_json(self) -> str:
        """Return the text that `from_json` reads."""
        data = {name: getattr(self, name) for name in self.__slots__}
        for name in ("chamber", "latched"):
            data[name] = None if data[name] is None else asdict(data[name])
        return json.dumps(data | {"limits": self.limits.to_json()}, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote.

        Raises
        ------
        ValueError
            Not JSON, a field missing or unknown.
        """
        data: dict[str, Any] = json.loads(text)
        try:
            if (band := data.get("resistance_Ohm")) is not None:
                data["resistance_Ohm"] = (float(band[0]), float(band[1]))
            chamber = ChamberSettings.from_json(data.get("chamber"))
            latched = Latch.from_json(data.get("latched"))
            more = {"limits": Limits.from_json(data["limits"]), "chamber": chamber, "latched": latched}
            return cls(**{**data, **more})
        except (KeyError, TypeError) as error:
            raise ValueError(f"bench settings: {error}") from error
