"""Tables of the two databases, in terms that SQLite and PostgreSQL share.

Times are UTC, ISO 8601 with microseconds and ``Z``, as text: they sort as text and mean the same everywhere.
"""

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
)

_NAMES = {
    "pk": "pk_%(table_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s",
    "ix": "ix_%(table_name)s_%(column_0_name)s",
    "uq": "uq_%(table_name)s_%(column_0_name)s",
}
META = MetaData(naming_convention=_NAMES)
SAMPLES = MetaData(naming_convention=_NAMES)

# SQLite numbers rows by itself only where the key is exactly INTEGER.
_SERIAL = BigInteger().with_variant(Integer, "sqlite")
_ID = String(64)
_UTC = String(32)
_SHA256 = String(64)


def _number() -> Column[int]:
    """Rising in the order of insertion: what came last is told by this, never by a clock that may have been set."""
    return Column("number", BigInteger, nullable=False, server_default="0", index=True)


def _json(name: str, *, nullable: bool = True) -> Column[object]:
    return Column(name, JSON(none_as_null=True), nullable=nullable)


def _cell_id() -> Column[str | None]:
    """Cell that a row belongs to; no foreign key, as cells are never deleted and older tables have none."""
    return Column("cell_id", _ID, index=True)


cell = Table(
    "cell",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("label", Text),
    Column("owner", Text),
    _json("type"),
    Column("capacity_Ah", Float(53)),
    _json("metadata", nullable=False),
    # All that it is found by, in small letters.
    Column("words", Text, nullable=False),
    Column("created_utc", _UTC, nullable=False),
    Column("retired_utc", _UTC),
)

cell_place = Table(
    "cell_place",
    META,
    Column("id", _SERIAL, primary_key=True, autoincrement=True),
    Column("bench", Text, nullable=False, index=True),
    # None: the bench was emptied.
    Column("cell_id", _ID, ForeignKey("cell.id")),
    Column("since_utc", _UTC, nullable=False),
)


profile = Table(
    "profile",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("name", Text, nullable=False),
    Column("sha256", _SHA256, nullable=False),
    Column("n_points", Integer, nullable=False),
    Column("duration_s", Float(53), nullable=False),
    Column("current_min_A", Float(53), nullable=False),
    Column("current_max_A", Float(53), nullable=False),
    Column("charge_net_Ah", Float(53), nullable=False),
    Column("charge_min_Ah", Float(53), nullable=False),
    Column("charge_max_Ah", Float(53), nullable=False),
    Column("created_utc", _UTC, nullable=False, index=True),
    Column("codec", Text, nullable=False),
    Column("crc", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
)

protocol = Table(
    "protocol",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("name", Text, nullable=False),
    Column("sha256", _SHA256, nullable=False),
    Column("n_steps", Integer, nullable=False),
    Column("created_utc", _UTC, nullable=False, index=True),
    _json("document", nullable=False),
)

campaign = Table(
    "campaign",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("name", Text, nullable=False),
    Column("bench", Text, nullable=False),
    Column("state", String(16), nullable=False, index=True),
    Column("stage", String(32), nullable=False),
    _json("stages", nullable=False),
    Column("progress", Float(53), nullable=False),
    Column("message", Text, nullable=False),
    _json("request", nullable=False),
    _json("result"),
    Column("created_utc", _UTC, nullable=False, index=True),
    Column("ended_utc", _UTC),
    Column("code_version", Text, nullable=False),
    _json("done"),
)

model = Table(
    "model",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("name", Text, nullable=False),
    Column("structure", Text, nullable=False),
    Column("capacity_Ah", Float(53), nullable=False),
    Column("seed", BigInteger),
    Column("parent_id", _ID, ForeignKey("model.id"), index=True),
    _json("train", nullable=False),
    _json("validate", nullable=False),
    _json("metrics"),
    Column("sha256", _SHA256, nullable=False),
    Column("created_utc", _UTC, nullable=False, index=True),
    Column("campaign_id", _ID, ForeignKey("campaign.id")),
    Column("code_version", Text, nullable=False),
    _json("document", nullable=False),
    _cell_id(),
)

run = Table(
    "run",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("name", Text),
    Column("bench", Text, nullable=False, index=True),
    # A run plays one of the two.
    Column("profile_id", _ID, ForeignKey("profile.id")),
    Column("protocol_id", _ID, ForeignKey("protocol.id")),
    Column("state", String(16), nullable=False, index=True),
    Column("reason", Text),
    Column("dt_s", Float(53), nullable=False),
    Column("created_utc", _UTC, nullable=False, index=True),
    Column("started_utc", _UTC),
    Column("ended_utc", _UTC),
    Column("n_samples", BigInteger),
    Column("missed_ticks", BigInteger),
    Column("sha256", _SHA256),
    Column("model_id", _ID, ForeignKey("model.id")),
    Column("initial_soc", Float(53), nullable=False),
    Column("observer_initial_soc", Float(53)),
    Column("capacity_Ah", Float(53), nullable=False),
    _json("limits", nullable=False),
    Column("seed", BigInteger),
    Column("campaign_id", _ID, ForeignKey("campaign.id"), index=True),
    Column("code_version", Text, nullable=False),
    Column("damage", Text),
    Column("elapsed_s", Float(53)),
    # No foreign key: a run may be kept longer than the one that it goes on from.
    Column("continues", _ID),
    Column("on_interruption", String(16)),
    _json("standing"),
    Column("repaired_utc", _UTC),
    Column("removed_utc", _UTC),
    # What people write about it.
    Column("label", Text),
    Column("operator", Text),
    Column("notes", Text),
    _json("commissioning"),
    _cell_id(),
)

commissioning = Table(
    "commissioning",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    # No foreign keys: a record is kept whatever becomes of bench and runs.
    Column("bench", Text, nullable=False, index=True),
    Column("state", String(16), nullable=False),
    Column("sha256", _SHA256, nullable=False),
    Column("created_utc", _UTC, nullable=False),
    _json("document", nullable=False),
)

device = Table(
    "device",
    META,
    Column("id", _SERIAL, primary_key=True, autoincrement=True),
    Column("bench", Text, nullable=False, index=True),
    _json("identity", nullable=False),
    Column("since_utc", _UTC, nullable=False),
)

comparison = Table(
    "comparison",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("model_id", _ID, ForeignKey("model.id"), nullable=False, index=True),
    _json("runs", nullable=False),
    Column("initial_soc", Float(53)),
    _json("result", nullable=False),
    Column("created_utc", _UTC, nullable=False, index=True),
    Column("campaign_id", _ID, ForeignKey("campaign.id")),
    Column("code_version", Text, nullable=False),
    _cell_id(),
)

diagnosis = Table(
    "diagnosis",
    META,
    Column("id", _ID, primary_key=True),
    _number(),
    Column("model_id", _ID, ForeignKey("model.id"), nullable=False, index=True),
    _json("runs", nullable=False),
    _json("train", nullable=False),
    Column("mode", String(16), nullable=False),
    Column("initial_soc", Float(53)),
    _json("result", nullable=False),
    Column("created_utc", _UTC, nullable=False, index=True),
    Column("campaign_id", _ID, ForeignKey("campaign.id")),
    Column("code_version", Text, nullable=False),
    _cell_id(),
)

event = Table(
    "event",
    META,
    Column("id", _SERIAL, primary_key=True, autoincrement=True),
    Column("created_utc", _UTC, nullable=False),
    Column("severity", String(16), nullable=False),
    Column("code", Text, nullable=False),
    Column("text", Text, nullable=False),
    Column("bench", Text),
    # No foreign keys: an event is kept whatever it is about.
    Column("run_id", _ID, index=True),
    Column("campaign_id", _ID, index=True),
    _cell_id(),
)

chunk = Table(
    "chunk",
    SAMPLES,
    Column("id", _SERIAL, primary_key=True, autoincrement=True),
    Column("run_id", _ID, nullable=False),
    Column("stream", String(32), nullable=False),
    Column("seq0", BigInteger, nullable=False),
    Column("n", Integer, nullable=False),
    Column("t0", Float(53), nullable=False),
    Column("t1", Float(53), nullable=False),
    Column("sealed", Boolean, nullable=False),
    Column("codec", Text, nullable=False),
    Column("crc", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    UniqueConstraint("run_id", "stream", "seq0", name="uq_chunk_row"),
)

closed_run = Table(
    "closed_run",
    SAMPLES,
    Column("run_id", _ID, primary_key=True),
    Column("state", String(16), nullable=False),
    Column("reason", Text),
    Column("n_samples", BigInteger, nullable=False),
    Column("sha256", _SHA256),
    Column("closed_utc", _UTC, nullable=False),
)
