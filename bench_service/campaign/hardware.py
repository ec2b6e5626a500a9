"""Whether a bench has been commissioned, and as what: a record holds for one device, wiring and map alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from bench_service.bench.messages import EventMessage
from bench_service.config import BenchConfig
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CommissioningRecord, Json
from drivers.cycler import IDENTITY, changed_identity
from drivers.errors import BadMapError
from drivers.register_map import map_content
from models.data.seal import SEAL, content_sha256, sealed

SCHEMA = 1
State = Literal["commissioned", "simulated", "missing", "failed", "void", "unknown"]
WARNED = ("missing", "failed", "void")  # a run on such hardware says so


@dataclass(frozen=True, slots=True)
class Standing:
    """What is known of a bench's hardware.

    Parameters
    ----------
    state : str
        ``commissioned``; ``simulated``: nothing to be proved; ``missing``: never done; ``failed``: the last time;
        ``void``: done, but on another device, wiring or map, or the record was changed; ``unknown``: no device there.
    reason : str or None
        Why it is not commissioned.
    record : str or None
        Id of the newest record.
    identity : dict or None
        What the device says of itself.
    chamber : dict or None
        What the temperature chamber says of itself; None where there is none.
    """

    state: State
    reason: str | None
    record: str | None
    identity: dict[str, str] | None
    chamber: dict[str, str] | None = None

    @property
    def warns(self) -> bool:
        """Whether a run must say that its hardware is unverified."""
        return self.state in WARNED

    def to_json(self) -> Json:
        """Give the JSON object that goes with a run and a bench."""
        return asdict(self)

    def warning(self, bench: str, run_id: str) -> EventMessage:
        """Return what is told when a run starts."""
        text = f"{bench}: the hardware is not commissioned: {self.reason}; 'bench-service commission {bench}' does it"
        return EventMessage(severity="warning", code="not_commissioned", text=text, run_id=run_id)


def wiring_of(config: BenchConfig) -> Json:
    """Return how a device is connected and guarded; other settings may change without a new commissioning."""
    simulate = config.simulate
    source = {"url": config.url} if simulate is None else {"simulated": [simulate.protocol, simulate.cell]}
    chamber = {} if config.chamber is None else {"chamber": {"url": config.chamber.url, "map": config.chamber.map}}
    return {**source, **chamber, "watchdog_s": config.watchdog_s, "external_interlock": config.external_interlock}


@dataclass(frozen=True, slots=True)
class Hardware:
    """A bench's hardware as far as it is known.

    Parameters
    ----------
    bench : str
    config : BenchConfig
    record : CommissioningRecord or None
        The newest one.
    map_sha256 : str
        Of the content of the device map.
    """

    bench: str
    config: BenchConfig
    record: CommissioningRecord | None
    map_sha256: str

    @classmethod
    def read(cls, store: MetadataStore, bench: str, config: BenchConfig) -> Hardware:
        """Read record and map as they are now."""
        return cls(bench, config, store.commissionings.last(bench), _map_sha256(config.map))

    def standing(
        self,
        capabilities: Mapping[str, Any] | None,
        identity: dict[str, str] | None,
        chamber: Mapping[str, Any] | None = None,
    ) -> Standing:
        """Say what is known of the device that is connected; `chamber` is what is known of the temperature chamber."""
        said = None if chamber is None else {key: chamber[key] for key in ("name", *IDENTITY) if chamber.get(key)}
        return replace(self._cycler_standing(capabilities, identity), chamber=said)

    def _cycler_standing(self, capabilities: Mapping[str, Any] | None, identity: dict[str, str] | None) -> Standing:
        record = None if self.record is None else self.record.id
        if self.config.simulate is not None or (capabilities is not None and capabilities["lock_step"]):
            return Standing("simulated", None, record, identity)
        if self.record is None:
            return Standing("missing", "it never was", None, identity)
        if self.record.state != "passed":
            reason = f"on {self.record.created_utc} it {self.record.state}: {self.record.document.get('reason')}"
            return Standing("failed", reason, record, identity)
        if (changed := self._changed(self.record)) is not None:
            return Standing("void", f"since {self.record.created_utc} {changed}", record, identity)
        if identity is None:
            return Standing("unknown", "no device is connected", record, None)
        if (changed := changed_identity(self.record.document["identity"], identity)) is not None:
            return Standing("void", f"another device than on {self.record.created_utc}: {changed}", record, identity)
        return Standing("commissioned", None, record, identity)

    def document(self, report: Json, record_id: str, created_utc: str, code_version: str) -> Json:
        """Return the sealed record of a commissioning."""
        wiring = wiring_of(self.config)
        return sealed(
            {
                "schema": SCHEMA,
                "kind": "commissioning",
                "id": record_id,
                "bench": self.bench,
                "created_utc": created_utc,
                "code_version": code_version,
                **report,
                "map": {"name": self.config.map, "sha256": self.map_sha256},
                "wiring": wiring | {"sha256": content_sha256({"wiring": wiring})},
                "configuration_sha256": content_sha256({"bench": self.config.model_dump(mode="json")}),
                "limits": self.config.limits.model_dump(mode="json"),
            }
        )

    def _changed(self, record: CommissioningRecord) -> str | None:
        document = record.document
        if document.get(SEAL) != record.sha256 or content_sha256(document) != record.sha256:
            return "the record itself was damaged or changed"
        if document["map"]["sha256"] != self.map_sha256:
            return f"the device map {self.config.map!r} has changed"
        before, now = document["wiring"], wiring_of(self.config)
        changed = [name for name in now if before.get(name) != now[name]]
        if changed:
            shown = ", ".join(f"{name} is {now[name]!r} where it was {before.get(name)!r}" for name in changed)
            return f"the wiring has changed: {shown}"
        return None


def _map_sha256(name: str) -> str:
    try:
        return content_sha256({"map": map_content(name)})
    except BadMapError as error:
        # The bench itself says what is wrong with it; here it is only no map that a record could have been made with.
        return f"unreadable: {error}"
