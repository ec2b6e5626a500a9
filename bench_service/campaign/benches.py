"""The benches of the service: what each is, what it does now, and who hears of it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Iterator

from bench_service.bench.admission import ticks_per_sample
from bench_service.bench.latch import Latch
from bench_service.bench.limits import Limits
from bench_service.bench.listener import BenchStatus
from bench_service.bench.messages import STOP_ASKED, EndedMessage, EventMessage, LiveMessage
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.campaign.cell_on_bench import cell_type_of, with_cell
from bench_service.campaign.hardware import Hardware, Standing
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.seal import Seal
from bench_service.config import BenchConfig
from bench_service.errors import NotFoundError
from bench_service.store.cells import CellRecord
from bench_service.store.records import Json

ACKNOWLEDGED = "acknowledged"  # the event's code, as control processes send it too
LATCHED = "latched"  # beginning of the event's code, which ends as the latch's
_ACKNOWLEDGE_S = 2.0


class Bench:
    """One bench: its configuration, its supervisor and its latest live values.

    Parameters
    ----------
    config : BenchConfig
    url : str
        Of the cycler.
    limits : Limits
    supervisor : BenchSupervisor
    runs_before_cell : int
        Number of the last run before its cell was the present one: a simulated cell begins anew with the service.
    seal : Seal or None
        On an effect that is hidden in its simulated cell.
    hardware : Hardware or None
        What is known of its device.
    chamber_url : str or None
        Where a simulated temperature chamber is served.

    Attributes
    ----------
    base : BenchConfig
        As it is configured; `config` and `limits` are those with the cell that stands on it.
    cell : CellRecord or None
        Which cell that is, since `cell_since_utc`; None where nobody has said.
    """

    def __init__(
        self,
        config: BenchConfig,
        url: str,
        limits: Limits,
        supervisor: BenchSupervisor,
        runs_before_cell: int = 0,
        seal: Seal | None = None,
        hardware: Hardware | None = None,
        chamber_url: str | None = None,
    ) -> None:
        self.base = self.config = config
        self.url = url
        self.limits = limits
        self.supervisor = supervisor
        self.runs_before_cell = runs_before_cell
        self.seal = seal
        self.hardware = hardware
        self.live: LiveMessage | None = None
        self.chamber_url = chamber_url
        self.cell: CellRecord | None = None
        self.cell_since_utc: str | None = None

    def carry(self, cell: CellRecord | None, since_utc: str | None) -> None:
        """Take a cell, or none, on the bench; raises `BadRequestError` where it cannot be there."""
        self.config = with_cell(self.base, cell)
        self.limits = Limits.from_json(self.config.limits.model_dump())
        self.cell, self.cell_since_utc = cell, since_utc

    @property
    def name(self) -> str:
        """The bench's name."""
        return self.supervisor.name

    @property
    def lock_step(self) -> bool:
        """Whether its time moves with its runs: as the device says, or as it is configured until one is there."""
        capabilities, simulate = self.supervisor.status.capabilities, self.config.simulate
        return bool(capabilities["lock_step"]) if capabilities else simulate is not None and simulate.lock_step

    def tick_s(self, dt_s: float) -> float:
        """Return the period of the set-points in a run with this period of samples."""
        return dt_s / ticks_per_sample(dt_s, self.config.watchdog_s, self.lock_step)

    def sampled_limits(self, dt_s: float) -> Limits:
        """Return its limits for profiles whose set-points change at samples only, as designs have them."""
        return self.limits.between_samples(dt_s, self.tick_s(dt_s))

    def summary(self) -> Json:
        """Give the JSON object of the live feed: everything but the limits."""
        status = self.supervisor.status
        capabilities = status.capabilities
        return {
            "name": self.name,
            "url": self.url,
            "map": self.config.map,
            "state": status.state,
            "reason": status.reason,
            "run_id": status.run_id,
            "capabilities": capabilities,
            "capacity_Ah": self.config.capacity_Ah,
            "live": self.live,
            "lock_step": bool(capabilities and capabilities["lock_step"]),
            "chamber": self._chamber(),
            "cell": self._cell(),
            "seal": None if self.seal is None else self.seal.to_json(),
            "commissioning": None if (standing := self.standing()) is None else standing.to_json(),
        }

    def _cell(self) -> Json | None:
        """Say which cell is on it; None where nobody has said."""
        cell = self.cell
        if cell is None:
            return None
        kind = None if (told := cell_type_of(cell.type)) is None else told.title
        return {"id": cell.id, "label": cell.label, "owner": cell.owner, "type": kind, "since_utc": self.cell_since_utc}

    def _chamber(self) -> Json | None:
        """Say what the temperature chamber may do, and what it says of itself; None where there is none."""
        chamber = self.config.chamber
        if chamber is None:
            return None
        low, high = self.config.chamber_degC or (None, None)
        told = self.supervisor.status.chamber or {"online": False, "reason": self.supervisor.status.reason}
        return {"map": chamber.map, "temperature_degC": [low, high], "tolerance_K": chamber.tolerance_K, **told}

    def standing(self) -> Standing | None:
        """Say whether the hardware is commissioned, by what was last read of record and map."""
        status = self.supervisor.status
        return (
            None
            if self.hardware is None
            else self.hardware.standing(status.capabilities, status.identity, status.chamber)
        )

    def to_json(self) -> Json:
        """Give the JSON object of the REST API."""
        cell = self.config.cell_type
        told = None if cell is None else cell.model_dump(mode="json")
        return self.summary() | {"limits": self.limits.to_json(), "cell_type": told}


class Benches:
    """All benches by name, and the listener of their supervisors.

    Parameters
    ----------
    broadcaster : Broadcaster
        Gets states and live values.
    on_event : callable
        Takes the bench's name and an event.
    on_ended : callable
        Takes the end of a run, see `BenchListener.on_ended`.
    on_stop : callable
        Takes a bench that somebody has stopped past the service, and the reason.
    *on_state : callable
        Each takes a bench whose state has changed.
    """

    def __init__(
        self,
        broadcaster: Broadcaster,
        on_event: Callable[[str, EventMessage], None],
        on_ended: Callable[[EndedMessage], None],
        on_stop: Callable[[Bench, str], None],
        *on_state: Callable[[Bench], None],
    ) -> None:
        self._broadcaster = broadcaster
        self._on_event = on_event
        self._on_ended = on_ended
        self._on_stop = on_stop
        self._on_state = on_state
        self._benches: dict[str, Bench] = {}
        self._latched: dict[str, Latch | None] = {}

    def __iter__(self) -> Iterator[Bench]:
        """Go through the benches in the configuration's order."""
        return iter(self._benches.values())

    def add(self, benches: Iterable[Bench]) -> None:
        """Take benches in; their supervisors are not started yet."""
        self._benches.update({bench.name: bench for bench in benches})

    def get(self, name: str) -> Bench:
        """Give a bench; raises `NotFoundError`."""
        if name not in self._benches:
            raise NotFoundError.of("bench", name)
        return self._benches[name]

    async def acknowledge(self, name: str) -> Bench:
        """Clear a latched fault and wait a moment for it; the bench stays in fault where its cause is still there."""
        bench = self.get(name)
        if bench.supervisor.status.state != "fault":
            return bench
        bench.supervisor.acknowledge()
        if bench.supervisor.status.state != "fault":  # no control process there to say so
            text = "acknowledged while the bench was offline"
            self._on_event(name, EventMessage(severity="info", code=ACKNOWLEDGED, text=text, run_id=None))
        with contextlib.suppress(TimeoutError):
            await bench.supervisor.wait_for("idle", "offline", timeout_s=_ACKNOWLEDGE_S)
        return bench

    async def open_seal(self, name: str) -> Json:
        """Tell what was hidden in a bench's simulated cell; open for all from now on.

        Raises
        ------
        NotFoundError
            No such bench, or nothing is hidden in it.
        """
        bench = self.get(name)
        if bench.seal is None:
            raise NotFoundError(f"bench {name} has no sealed effect", ("bench", name))
        if bench.seal.opened is None:
            bench.seal = await asyncio.to_thread(bench.seal.open)
            event = EventMessage(severity="info", code="seal_opened", text=_words(bench.seal), run_id=None)
            self._on_event(name, event)
            self.publish(bench)
        return bench.seal.to_json()

    def on_state(self, bench: str, status: BenchStatus) -> None:
        """Publish a new state; that a fault is latched is written down, so that it outlives the service."""
        latched = status.latched
        if latched is not None and latched != self._latched.get(bench):
            code = f"{LATCHED}_{latched.code}"
            self._on_event(bench, EventMessage(severity="info", code=code, text=latched.text, run_id=None))
        self._latched[bench] = latched
        if status.state == "offline":
            self.get(bench).live = None
        for on_state in self._on_state:
            on_state(self.get(bench))
        self.publish(self.get(bench))

    def publish(self, bench: Bench) -> None:
        """Tell everybody how a bench is now."""
        self._broadcaster.publish({"type": "bench"} | bench.summary())

    def on_live(self, bench: str, live: LiveMessage) -> None:
        """Keep and publish live values."""
        self.get(bench).live = live
        self._broadcaster.publish({"type": "live", "bench": bench} | live)

    def on_event(self, bench: str, event: EventMessage) -> None:
        """Pass an event on."""
        self._on_event(bench, event)
        if event["code"] == STOP_ASKED:
            self._on_stop(self.get(bench), event["text"])

    def on_ended(self, bench: str, ended: EndedMessage) -> None:
        """Pass the end of a run on."""
        self._on_ended(ended)


def _words(seal: Seal) -> str:
    told = seal.opened or {}
    size = f"{told['value']:g} {told['unit']} where the cell had {told['before']:g}"
    return f"the seal is opened: {told['effect']}, {size}"
