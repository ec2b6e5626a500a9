"""Which device was seen on a bench since when."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0008"
down_revision = "meta_0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "device",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), nullable=False, autoincrement=True),
        sa.Column("bench", sa.Text, nullable=False),
        sa.Column("identity", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("since_utc", sa.String(32), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_device"),
    )
    op.create_index("ix_device_bench", "device", ["bench"])


def downgrade() -> None:
    op.drop_table("device")
