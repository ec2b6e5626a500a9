"""What the metadata store returns: frozen values with the names of the REST API.

Times are UTC, ISO 8601 with microseconds and ``Z``. Positive current charges.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal, TypedDict

RunState = Literal["created", "running", "paused", "completed", "stopped", "fault", "interrupted"]
CampaignState = Literal["queued", "running", "completed", "failed", "stopped", "interrupted"]
Severity = Literal["info", "warning", "error"]
Json = dict[str, Any]

OPEN_RUN_STATES: tuple[RunState, ...] = ("created", "running", "paused")
IMPORTED = "import"  # where a run that was brought in from a file stands in place of a bench


def utc_text(moment: datetime) -> str:
    """Return a moment, which must know its zone, as it is stored."""
    return moment.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


@dataclass(frozen=True, slots=True)
class RunReference:
    """A run as the input of something else: which run, and the content hash that it had."""

    run_id: str
    sha256: str | None


@dataclass(frozen=True, slots=True)
class ProfileRecord:
    """A current profile without its points.

    Attributes
    ----------
    sha256 : str
        Of the points: times, then currents, as little-endian float64.
    current_A : (float, float)
        Least and greatest current.
    charge_Ah : (float, float, float)
        Charge at the end, least and greatest charge on the way, from 0 at the start.
    """

    id: str
    name: str
    sha256: str
    n_points: int
    duration_s: float
    current_A: tuple[float, float]
    charge_Ah: tuple[float, float, float]
    created_utc: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtocolRecord:
    """A protocol without its document; `sha256` is that of the document in canonical JSON."""

    id: str
    name: str
    sha256: str
    n_steps: int
    created_utc: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RunIntent:
    """A run as it was decided; what is None nobody has said.

    Attributes
    ----------
    on_interruption : str or None
        ``resume``: a protocol that is cut off by something outside the cell goes on by itself.
    standing : dict or None
        Where a protocol that goes on had been cut off; see `protocol.state.Standing`.
    """

    bench: str
    profile_id: str | None
    protocol_id: str | None = None
    on_interruption: str | None = None
    standing: Json | None = None
    dt_s: float
    initial_soc: float
    capacity_Ah: float
    limits: Json
    code_version: str
    name: str | None = None
    model_id: str | None = None
    observer_initial_soc: float | None = None
    seed: int | None = None
    campaign_id: str | None = None
    continues: str | None = None
    commissioning: Json | None = None
    cell_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """A run: what was decided before it started, and what has become of it.

    Attributes
    ----------
    number : int
        Rises from run to run, whatever the clock does.
    elapsed_s : float or None
        From start to end by a clock that nobody sets; None where one process did not see both.
    continues : str or None
        The run whose profile it takes up again where that was interrupted.
    damage : str or None
        What is missing of its samples, where reading them has shown that something is.
    repaired_utc : str or None
        When a damaged run was repaired: count and hash are since then those of what is left, `damage` says what is not.
    removed_utc : str or None
        When its samples were given up, by the rule of retention.
    label, operator, notes : str or None
        What people have written about it.
    commissioning : dict or None
        What was known of the bench's hardware when it started: `campaign.hardware.Standing`.
    """

    id: str
    number: int = 0
    name: str | None = None
    bench: str
    profile_id: str | None
    protocol_id: str | None = None
    on_interruption: str | None = None
    standing: Json | None = None
    state: RunState
    reason: str | None = None
    dt_s: float
    created_utc: str
    started_utc: str | None = None
    ended_utc: str | None = None
    n_samples: int | None = None
    missed_ticks: int | None = None
    sha256: str | None = None
    model_id: str | None = None
    initial_soc: float
    observer_initial_soc: float | None = None
    capacity_Ah: float
    limits: Json
    seed: int | None = None
    campaign_id: str | None = None
    code_version: str
    continues: str | None = None
    elapsed_s: float | None = None
    damage: str | None = None
    repaired_utc: str | None = None
    removed_utc: str | None = None
    label: str | None = None
    operator: str | None = None
    notes: str | None = None
    commissioning: Json | None = None
    cell_id: str | None = None

    @property
    def called(self) -> str:
        """What people call it, in a sentence."""
        return f"run {self.name or self.id[:8]!r}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CommissioningRecord:
    """What a bench's hardware was seen to do; `document` is sealed (`models.data.seal`), `sha256` its seal."""

    id: str
    bench: str
    state: str
    sha256: str
    created_utc: str
    document: Json


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOrigin:
    """Where a model comes from: its runs, its parent where it is a further version of one, the code that made it."""

    name: str
    structure: str
    capacity_Ah: float
    code_version: str
    train: Sequence[RunReference] = ()
    validate: Sequence[RunReference] = ()
    metrics: Json | None = None
    seed: int | None = None
    parent_id: str | None = None
    campaign_id: str | None = None
    cell_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRecord:
    """An identified or imported model, without its document; `sha256` is that of the document in canonical JSON."""

    id: str
    name: str
    structure: str
    capacity_Ah: float
    seed: int | None
    parent_id: str | None
    train: tuple[RunReference, ...]
    validate: tuple[RunReference, ...]
    metrics: Json | None
    sha256: str
    created_utc: str
    campaign_id: str | None
    code_version: str
    cell_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonRecord:
    """A model compared with runs; `result` is the JSON of the command ``compare``."""

    id: str
    model_id: str
    runs: tuple[RunReference, ...]
    initial_soc: float | None
    result: Json
    created_utc: str
    campaign_id: str | None
    code_version: str
    cell_id: str | None = None

    @property
    def run_ids(self) -> tuple[str, ...]:
        """Ids of the compared runs."""
        return tuple(reference.run_id for reference in self.runs)


class Stage(TypedDict):
    """One stage of a campaign; its state is ``waiting``, ``running``, ``done``, or the end that the campaign took."""

    name: str
    state: str
    detail: str
    seconds: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRecord:
    """A campaign. To change it: `dataclasses.replace`, then `CampaignTable.save`."""

    id: str
    name: str
    bench: str
    state: CampaignState
    stage: str
    stages: tuple[Stage, ...]
    progress: float = 0.0
    message: str = ""
    request: Json
    result: Json | None = None
    created_utc: str
    ended_utc: str | None = None
    code_version: str
    done: Json | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRecord:
    """Something that happened, for the people at the bench."""

    id: int
    created_utc: str
    severity: Severity
    code: str
    text: str
    bench: str | None
    run_id: str | None
    campaign_id: str | None
    cell_id: str | None = None
