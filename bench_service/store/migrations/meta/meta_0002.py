"""Diagnoses of models."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0002"
down_revision = "meta_0001"
branch_labels = None
depends_on = None

ID, UTC, REAL = sa.String(64), sa.String(32), sa.Float(53)
JSON = sa.JSON(none_as_null=True)


def upgrade() -> None:
    op.create_table(
        "diagnosis",
        sa.Column("id", ID, primary_key=True),
        sa.Column("model_id", ID, sa.ForeignKey("model.id", name="fk_diagnosis_model_id"), nullable=False),
        sa.Column("runs", JSON, nullable=False),
        sa.Column("train", JSON, nullable=False),
        sa.Column("mode", sa.String(16), nullable=False),
        sa.Column("initial_soc", REAL),
        sa.Column("result", JSON, nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("campaign_id", ID, sa.ForeignKey("campaign.id", name="fk_diagnosis_campaign_id")),
        sa.Column("code_version", sa.Text, nullable=False),
    )
    op.create_index("ix_diagnosis_model_id", "diagnosis", ["model_id"])
    op.create_index("ix_diagnosis_created_utc", "diagnosis", ["created_utc"])
    op.create_index("ix_model_parent_id", "model", ["parent_id"])


def downgrade() -> None:
    op.drop_index("ix_model_parent_id", "model")
    op.drop_table("diagnosis")
