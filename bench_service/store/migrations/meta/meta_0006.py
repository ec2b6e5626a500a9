"""Commissioning records, and with each run what was known of its hardware."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0006"
down_revision = "meta_0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "commissioning",
        sa.Column("id", sa.String(64), nullable=False),
        sa.Column("number", sa.BigInteger, nullable=False, server_default="0"),
        sa.Column("bench", sa.Text, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("created_utc", sa.String(32), nullable=False),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_commissioning"),
    )
    op.create_index("ix_commissioning_number", "commissioning", ["number"])
    op.create_index("ix_commissioning_bench", "commissioning", ["bench"])
    op.add_column("run", sa.Column("commissioning", sa.JSON(none_as_null=True)))


def downgrade() -> None:
    op.drop_column("run", "commissioning")
    op.drop_table("commissioning")
