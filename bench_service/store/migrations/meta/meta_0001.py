"""Profiles, campaigns, models, runs, comparisons and events."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0001"
down_revision = None
branch_labels = None
depends_on = None

ID, UTC, SHA256, REAL = sa.String(64), sa.String(32), sa.String(64), sa.Float(53)
JSON = sa.JSON(none_as_null=True)
SERIAL = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    _profile()
    _campaign()
    _model()
    _run()
    _comparison()
    _event()
    for table, columns in INDEXES.items():
        for column in columns:
            op.create_index(f"ix_{table}_{column}", table, [column])


def downgrade() -> None:
    for table in ("event", "comparison", "run", "model", "campaign", "profile"):
        op.drop_table(table)


INDEXES = {
    "profile": ("created_utc",),
    "campaign": ("state", "created_utc"),
    "model": ("created_utc",),
    "run": ("bench", "state", "created_utc", "campaign_id"),
    "comparison": ("model_id", "created_utc"),
    "event": ("run_id", "campaign_id"),
}


def _profile() -> None:
    op.create_table(
        "profile",
        sa.Column("id", ID, primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("sha256", SHA256, nullable=False),
        sa.Column("n_points", sa.Integer, nullable=False),
        sa.Column("duration_s", REAL, nullable=False),
        sa.Column("current_min_A", REAL, nullable=False),
        sa.Column("current_max_A", REAL, nullable=False),
        sa.Column("charge_net_Ah", REAL, nullable=False),
        sa.Column("charge_min_Ah", REAL, nullable=False),
        sa.Column("charge_max_Ah", REAL, nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("codec", sa.Text, nullable=False),
        sa.Column("crc", sa.BigInteger, nullable=False),
        sa.Column("data", sa.LargeBinary, nullable=False),
    )


def _campaign() -> None:
    op.create_table(
        "campaign",
        sa.Column("id", ID, primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("bench", sa.Text, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("stage", sa.String(32), nullable=False),
        sa.Column("stages", JSON, nullable=False),
        sa.Column("progress", REAL, nullable=False),
        sa.Column("message", sa.Text, nullable=False),
        sa.Column("request", JSON, nullable=False),
        sa.Column("result", JSON),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("ended_utc", UTC),
        sa.Column("code_version", sa.Text, nullable=False),
    )


def _model() -> None:
    op.create_table(
        "model",
        sa.Column("id", ID, primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("structure", sa.Text, nullable=False),
        sa.Column("capacity_Ah", REAL, nullable=False),
        sa.Column("seed", sa.BigInteger),
        sa.Column("parent_id", ID, sa.ForeignKey("model.id", name="fk_model_parent_id")),
        sa.Column("train", JSON, nullable=False),
        sa.Column("validate", JSON, nullable=False),
        sa.Column("metrics", JSON),
        sa.Column("sha256", SHA256, nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("campaign_id", ID, sa.ForeignKey("campaign.id", name="fk_model_campaign_id")),
        sa.Column("code_version", sa.Text, nullable=False),
        sa.Column("document", JSON, nullable=False),
    )


def _run() -> None:
    op.create_table(
        "run",
        sa.Column("id", ID, primary_key=True),
        sa.Column("name", sa.Text),
        sa.Column("bench", sa.Text, nullable=False),
        sa.Column("profile_id", ID, sa.ForeignKey("profile.id", name="fk_run_profile_id"), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("reason", sa.Text),
        sa.Column("dt_s", REAL, nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("started_utc", UTC),
        sa.Column("ended_utc", UTC),
        sa.Column("n_samples", sa.BigInteger),
        sa.Column("missed_ticks", sa.BigInteger),
        sa.Column("sha256", SHA256),
        sa.Column("model_id", ID, sa.ForeignKey("model.id", name="fk_run_model_id")),
        sa.Column("initial_soc", REAL, nullable=False),
        sa.Column("observer_initial_soc", REAL),
        sa.Column("capacity_Ah", REAL, nullable=False),
        sa.Column("limits", JSON, nullable=False),
        sa.Column("seed", sa.BigInteger),
        sa.Column("campaign_id", ID, sa.ForeignKey("campaign.id", name="fk_run_campaign_id")),
        sa.Column("code_version", sa.Text, nullable=False),
    )


def _comparison() -> None:
    op.create_table(
        "comparison",
        sa.Column("id", ID, primary_key=True),
        sa.Column("model_id", ID, sa.ForeignKey("model.id", name="fk_comparison_model_id"), nullable=False),
        sa.Column("runs", JSON, nullable=False),
        sa.Column("initial_soc", REAL),
        sa.Column("result", JSON, nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("campaign_id", ID, sa.ForeignKey("campaign.id", name="fk_comparison_campaign_id")),
        sa.Column("code_version", sa.Text, nullable=False),
    )


def _event() -> None:
    op.create_table(
        "event",
        sa.Column("id", SERIAL, primary_key=True, autoincrement=True),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("severity", sa.String(16), nullable=False),
        sa.Column("code", sa.Text, nullable=False),
        sa.Column("text", sa.Text, nullable=False),
        sa.Column("bench", sa.Text),
        sa.Column("run_id", ID),
        sa.Column("campaign_id", ID),
    )
