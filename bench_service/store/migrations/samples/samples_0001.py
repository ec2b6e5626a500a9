"""Chunks of samples, and what is known of closed runs."""

import sqlalchemy as sa
from alembic import op

revision = "samples_0001"
down_revision = None
branch_labels = None
depends_on = None

SERIAL = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    op.create_table(
        "chunk",
        sa.Column("id", SERIAL, primary_key=True, autoincrement=True),
        sa.Column("run_id", sa.String(64), nullable=False),
        sa.Column("stream", sa.String(32), nullable=False),
        sa.Column("seq0", sa.BigInteger, nullable=False),
        sa.Column("n", sa.Integer, nullable=False),
        sa.Column("t0", sa.Float(53), nullable=False),
        sa.Column("t1", sa.Float(53), nullable=False),
        sa.Column("sealed", sa.Boolean, nullable=False),
        sa.Column("codec", sa.Text, nullable=False),
        sa.Column("crc", sa.BigInteger, nullable=False),
        sa.Column("data", sa.LargeBinary, nullable=False),
        sa.UniqueConstraint("run_id", "stream", "seq0", name="uq_chunk_row"),
    )
    op.create_table(
        "closed_run",
        sa.Column("run_id", sa.String(64), primary_key=True),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("reason", sa.Text),
        sa.Column("n_samples", sa.BigInteger, nullable=False),
        sa.Column("sha256", sa.String(64)),
        sa.Column("closed_utc", sa.String(32), nullable=False),
    )


def downgrade() -> None:
    op.drop_table("closed_run")
    op.drop_table("chunk")
