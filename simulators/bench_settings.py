"""What to simulate and where to serve it, checked once."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulators.can_bus import CanBusSettings
from simulators.chamber import ChamberSettings
from simulators.cycler import CyclerSettings
from simulators.module_layout import ModuleLayout
from simulators.sensors import SensorParameters
from simulators.serial_line import SerialSettings

__all__ = ["PROTOCOLS", "SimulatorSettings"]

PROTOCOLS = ("modbus-tcp", "modbus-rtu", "can")
MOST_DEVICES = 64
MAX_SPEED = 1e5  # the work of a wall second grows with it; above, signals would wait for its end


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorSettings:
    """What to simulate and where to serve it.

    Attributes
    ----------
    protocol : str
        One of `PROTOCOLS`.
    map_name : str
        Device map, by name or path.
    host, port : str, int
        Of Modbus TCP. Port 0 takes a free one.
    serial : SerialSettings
        Of Modbus RTU.
    can : CanBusSettings
        Of CAN.
    cell : str
        A name in `simulators.catalogue.CELLS`.
    effects : Mapping[str, float]
        Physical effects by their public name, see `simulators.effects`.
    seed : int
        Of all noise.
    lock_step : bool
        Time moves only with the client's lock-step register; otherwise with the wall clock times `speed`.
    capacity_Ah : float or None
        In place of the cell type's own.
    initial_soc, ambient_degC : float
        Where the cell starts, and the constant temperature around it.
    module : ModuleLayout or None
        A module of such cells in place of one; the cycler's rated voltage and current then count per cell.
    faults : str
        A script, see `simulators.faults`; for the first device.
    chamber : ChamberSettings or None
        A temperature chamber around the first device's cell, served over Modbus TCP beside it; its air begins at
        `ambient_degC`, which is then the room's.
    devices : int
        So many equal ones at one address: Modbus units, or CAN nodes, from the first one's number on. Each has a cell
        and noise of its own.
    sensors : SensorParameters
        Noise, resolution and constant errors of the measurement.
    cycler : CyclerSettings
        Rating of the device; its ambient temperature follows `ambient_degC`.
    """

    protocol: str = "modbus-tcp"
    map_name: str = "generic"
    host: str = "127.0.0.1"
    port: int = 0
    serial: SerialSettings = SerialSettings()
    can: CanBusSettings = CanBusSettings()
    cell: str = "nmc"
    effects: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    lock_step: bool = False
    speed: float = 1.0
    capacity_Ah: float | None = None
    initial_soc: float = 0.5
    ambient_degC: float = 25.0
    module: ModuleLayout | None = None
    faults: str = ""
    chamber: ChamberSettings | None = None
    devices: int = 1
    sensors: SensorParameters = SensorParameters()
    cycler: CyclerSettings = CyclerSettings()

    def __post_init__(self) -> None:
        """Check what no part below checks.

        Raises
        ------
        ValueError
            If the protocol is unknown, or speed or port are impossible.
        """
        if self.protocol not in PROTOCOLS:
            raise ValueError(f"unknown protocol {self.protocol!r}; choose one of {', '.join(PROTOCOLS)}")
        if not 0.0 < self.speed <= MAX_SPEED:
            raise ValueError(f"speed is {self.speed}; it must be above 0 and at most {MAX_SPEED:g}")
        if not 1 <= self.devices <= MOST_DEVICES:
            raise ValueError(f"{self.devices} devices; it must be 1..{MOST_DEVICES}")
        if not 0 <= self.port <= 65535:
            raise ValueError(f"port is {self.port}; it must lie in 0..65535 (0: a free one)")
