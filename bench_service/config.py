"""The only reader of `bench.toml` and of the environment.

Without a file the service knows one bench, `sim`, whose simulator it starts itself.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from bench_service.errors import ServiceError
from drivers.address import parse_address
from drivers.errors import CyclerConnectionError

CONFIG_FILE = "bench.toml"
DATA_DIR_VARIABLE = "BENCH_DATA_DIR"
WORKER_NICE_VARIABLE = "BENCH_WORKER_NICE"
LONGEST_DEVICE_WATCHDOG_S = 2.0


class ConfigError(ServiceError):
    """A configuration that the service refuses; the message names file, key and reason.

    Parameters
    ----------
    file : str
        File, or environment variable, in which the value stands.
    key : str
        Dotted name of the key, empty if the whole file is meant.
    reason : str
        What is wrong, and what would be right.
    """

    code = "config"

    def __init__(self, file: str, key: str, reason: str) -> None:
        super().__init__(f"{file}: {key}: {reason}" if key else f"{file}: {reason}", (file, key))
        self.file = file
        self.key = key
        self.reason = reason


def _number(value: object) -> float:
    """TOML writes 4 as well as 4.0 for a quantity; a string or a boolean is neither."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("must be a number")
    if not math.isfinite(value):
        raise ValueError("must be finite")
    return float(value)


def _ordered(window: tuple[float, float]) -> tuple[float, float]:
    if not window[0] < window[1]:
        raise ValueError(f"low {window[0]:g} must be below high {window[1]:g}")
    return window


Number = Annotated[float, BeforeValidator(_number)]
Positive = Annotated[float, BeforeValidator(_number), Field(gt=0)]
Window = Annotated[tuple[Number, Number], AfterValidator(_ordered)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class LimitsConfig(_Table):
    """Limits that no run on the bench may leave; a run may only narrow them.

    Units are in the names; windows are ``(low, high)``.
    """

    voltage_V: Window = (2.5, 4.2)
    current_A: Window = (-10.0, 5.0)
    temperature_degC: Window = (-20.0, 60.0)
    soc: Window = (0.0, 1.0)
    ramp_A_per_s: Positive | None = None
    duration_s: Positive = 14 * 86400.0

    @field_validator("soc")
    @classmethod
    def _within_zero_and_one(cls, soc: tuple[float, float]) -> tuple[float, float]:
        if soc[0] < 0 or soc[1] > 1:
            raise ValueError("state of charge is a fraction between 0 and 1")
        return soc


class SimulateConfig(_Table):
    """A simulated cycler and cell, started by the service as a process of its own.

    ``speed`` counts simulated seconds per second and has a meaning only on the wall clock
    (``lock_step = false``). ``capacity_Ah`` replaces the true capacity of the simulated cell; ``baud`` is
    the pace of a simulated serial line, ``faults`` a script of what goes wrong when (docs/cyclers.md).
    ``hidden_effect`` names one more effect, or "random", whose size the seed draws; both stay sealed until the
    bench's seal is opened.
    """

    protocol: Literal["modbus-tcp", "modbus-rtu", "can"] = "modbus-tcp"
    baud: int = Field(default=115200, ge=300, le=4_000_000, strict=True)
    cell: Literal["nmc", "lfp", "nimh"] = "nmc"
    effects: dict[str, Number] = {}
    hidden_effect: str | None = None
    faults: str = ""
    seed: int = Field(default=1, ge=0, strict=True)
    lock_step: bool = Field(default=True, strict=True)
    speed: Positive = 1.0
    initial_soc: Annotated[float, BeforeValidator(_number), Field(ge=0, le=1)] = 0.5
    ambient_degC: Number = 25.0
    capacity_Ah: Positive | None = None


# What the data sheets of the simulated cells allow; a test compares with the simulator's own catalogue.
_ROOM_degC = (-20.0, 60.0)
_SIMULATED_CELLS: dict[str, dict[str, Any]] = {
    "nmc": {"capacity_Ah": 2.5, "voltage_V": (2.5, 4.2), "current_A": (-10.0, 5.0), "temperature_degC": _ROOM_degC},
    "lfp": {"capacity_Ah": 2.5, "voltage_V": (2.0, 3.65), "current_A": (-25.0, 10.0), "temperature_degC": _ROOM_degC},
    "nimh": {"capacity_Ah": 2.0, "voltage_V": (0.9, 1.6), "current_A": (-6.0, 2.0), "temperature_degC": (-10.0, 50.0)},
}
_STATED_FOR_HARDWARE = ("voltage_V", "current_A", "temperature_degC")


class BenchConfig(_Table):
    """One bench: a cycler channel with a cell on it.

    Exactly one of ``url`` (see `drivers.address`) and ``simulate`` is given. The defaults of capacity and
    limits are those of the simulated cell; for a real cell they must be stated.
    """

    url: str | None = None
    simulate: SimulateConfig | None = None
    map: str = "generic"
    capacity_Ah: Positive = 2.5
    limits: LimitsConfig = LimitsConfig()
    watchdog_s: Positive = 1.0
    external_interlock: bool = Field(default=False, strict=True)
    timeout_s: Positive = 0.5
    settle_s: Annotated[float, BeforeValidator(_number), Field(ge=0)] = 1.0

    @model_validator(mode="before")
    @classmethod
    def _as_simulated(cls, table: Any) -> Any:
        """Fill in what the simulated cell allows; values of a wrong type are left for the fields to refuse."""
        simulate = table.get("simulate") if isinstance(table, dict) else None
        if isinstance(simulate, SimulateConfig):
            simulate = simulate.model_dump()
        limits = table.get("limits", {}) if isinstance(table, dict) else None
        if not isinstance(simulate, dict) or not isinstance(limits, dict):
            return table
        known = dict(_SIMULATED_CELLS.get(str(simulate.get("cell", "nmc")), _SIMULATED_CELLS["nmc"]))
        capacity_Ah = known.pop("capacity_Ah")
        if simulate.get("capacity_Ah") is not None:
            capacity_Ah = simulate["capacity_Ah"]
        return {"capacity_Ah": capacity_Ah} | table | {"limits": known | limits}

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.url is None) == (self.simulate is None):
            raise ValueError("give exactly one of 'url' (a cycler) and 'simulate' (a simulator)")
        return self

    @model_validator(mode="after")
    def _stated(self) -> Self:
        if self.url is not None:
            missing = [f"limits.{name}" for name in _STATED_FOR_HARDWARE if name not in self.limits.model_fields_set]
            if "capacity_Ah" not in self.model_fields_set:
                missing.append("capacity_Ah")
            if missing:
                raise ValueError(f"a real cell has no default {', '.join(missing)}; state what its data sheet allows")
        return self

    @model_validator(mode="after")
    def _watched(self) -> Self:
        if self.watchdog_s > LONGEST_DEVICE_WATCHDOG_S and not self.external_interlock:
            raise ValueError(
                f"watchdog_s is {self.watchdog_s:g} s; above {LONGEST_DEVICE_WATCHDOG_S:g} s the bench needs "
                "'external_interlock = true', a declaration that hardware of its own cuts the cell off"
            )
        return self

    @field_validator("url")
    @classmethod
    def _known_transport(cls, url: str | None) -> str | None:
        if url is None:
            return None
        try:
            parse_address(url)
        except CyclerConnectionError as error:
            raise ValueError(str(error)) from error
        return url


_BENCH_NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"


class ServiceConfig(_Table):
    """Everything the service is told from outside."""

    data_dir: Path = Path("bench-data")
    workers: int = Field(default=1, ge=1, le=64, strict=True)
    worker_nice: int = Field(default=19, ge=0, le=19, strict=True)
    bench: dict[Annotated[str, Field(pattern=_BENCH_NAME)], BenchConfig] = {
        "sim": BenchConfig(simulate=SimulateConfig())
    }

    @field_validator("bench")
    @classmethod
    def _at_least_one(cls, bench: dict[str, BenchConfig]) -> dict[str, BenchConfig]:
        if not bench:
            raise ValueError("needs at least one bench, a table [bench.NAME]")
        return bench


def load_config(path: Path | None = None, environ: Mapping[str, str] | None = None) -> ServiceConfig:
    """Read the configuration.

    Parameters
    ----------
    path : Path or None
        The file; None means `bench.toml` of the working directory where there is one, else the defaults.
    environ : mapping or None
        The environment, of the process by default. ``BENCH_DATA_DIR`` wins over the file's ``data_dir``,
        ``BENCH_WORKER_NICE`` over its ``worker_nice``.

    Raises
    ------
    ConfigError
        File missing, not TOML, an unknown key, a value outside its range.
    """
    environ = os.environ if environ is None else environ
    if path is None:
        path = Path(CONFIG_FILE) if Path(CONFIG_FILE).exists() else None
    config = ServiceConfig() if path is None else parse_config(_read(path), str(path))
    if DATA_DIR_VARIABLE in environ:
        if not environ[DATA_DIR_VARIABLE].strip():
            raise ConfigError("environment", DATA_DIR_VARIABLE, "is empty; name a directory or unset it")
        config = config.model_copy(update={"data_dir": Path(environ[DATA_DIR_VARIABLE])})
    if WORKER_NICE_VARIABLE in environ:
        text = environ[WORKER_NICE_VARIABLE]
        if not text.isdecimal() or int(text) > 19:
            raise ConfigError("environment", WORKER_NICE_VARIABLE, f"is {text!r}; name a whole number from 0 to 19")
        config = config.model_copy(update={"worker_nice": int(text)})
    return config


def parse_config(text: str, file: str = CONFIG_FILE) -> ServiceConfig:
    """Check the text of a configuration file; ``file`` is only its name in messages.

    Raises
    ------
    ConfigError
        Not TOML, an unknown key, a value outside its range; only the first fault is named.
    """
    try:
        document: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(file, "", f"not valid TOML: {error}") from error
    try:
        return ServiceConfig.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        reason = "unknown key" if first["type"] == "extra_forbidden" else first["msg"]
        raise ConfigError(file, key, reason.removeprefix("Value error, ")) from error


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ConfigError(str(path), "", "no such file; 'bench-service config init' writes a commented one") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), "", f"cannot be read: {error}") from error


def example_config() -> str:
    """Text of a commented `bench.toml` whose values are the defaults."""
    return _EXAMPLE


_EXAMPLE = """\
# Configuration of bench-service. Every value here is the default. Positive current charges the cell.

# Where runs, samples and models are kept. The environment variable BENCH_DATA_DIR wins over this line.
data_dir = "bench-data"

# Worker processes for fits and comparisons, and how much they give way to other programs: 19 most, 0 not at all. On a
# machine that others keep busy, 19 gets them hardly any time. The environment variable BENCH_WORKER_NICE wins.
workers = 1
worker_nice = 19

# One table per bench. "sim" is simulated: the service starts its simulator itself.
[bench.sim]
# A real cycler instead of a simulated one:  url = "modbus-tcp://192.168.1.50:502"  and no "simulate" table; or
# "modbus-rtu:///dev/ttyUSB0?baud=115200&parity=N", or "can://socketcan/can0?bitrate=500000&node=1&log=traffic";
# capacity_Ah and the limits of voltage, current and temperature must then be stated.
# Register map: a name from drivers/maps, or the path of a .toml file.
map = "generic"
# Nominal capacity of the cell, for counting charge before a run. Simulated: the simulated cell's own.
capacity_Ah = 2.5
# The cycler's own watchdog switches its output off after this time without a command. Above 2 s, or with a
# device that has none, the bench starts only with external_interlock = true: your declaration that hardware
# of its own protects the cell.
watchdog_s = 1.0
external_interlock = false
# Longest wait for one answer of the cycler, and the time after a set-point change in which the measured
# current is not yet compared with the commanded one.
timeout_s = 0.5
settle_s = 1.0

[bench.sim.simulate]
# modbus-tcp, modbus-rtu (a pseudo-terminal, paced to its baud rate) or can (needs map = "generic_can")
protocol = "modbus-tcp"
baud = 115200
# nmc, lfp or nimh
cell = "nmc"
# Physical effects of the simulated cell on top of its own, for example { hysteresis = 0.02 }.
effects = {}
# One more effect that nobody is told: "random" or a name; the page looks for it and opens the seal.
# hidden_effect = "random"
# What goes wrong when, for example "silence@sample:30; nan.voltage@t:12.5+3" (docs/cyclers.md).
faults = ""
seed = 1
# true: simulated time moves one period per sample, as fast as the machine can. false: the wall clock, times speed.
lock_step = true
speed = 1.0
# Where the cell starts, and the temperature around it.
initial_soc = 0.5
ambient_degC = 25.0
# True capacity of the simulated cell. Absent: the cell's own.
# capacity_Ah = 2.5

# Limits of the bench. A run may only narrow them. Simulated: what the simulated cell allows.
[bench.sim.limits]
voltage_V = [2.5, 4.2]
current_A = [-10.0, 5.0]
temperature_degC = [-20.0, 60.0]
soc = [0.0, 1.0]
# Largest change of the set-point per second. Absent: steps are allowed.
# ramp_A_per_s = 10.0
# Longest run: 14 days.
duration_s = 1209600.0
"""
