"""Cells, which of them stood on which bench since when, and what belongs to one."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0007"
down_revision = "meta_0006"
branch_labels = None
depends_on = None

ID = sa.String(64)
UTC = sa.String(32)
BELONGING = ("run", "model", "comparison", "diagnosis", "event")


def upgrade() -> None:
    op.create_table(
        "cell",
        sa.Column("id", ID, nullable=False),
        sa.Column("number", sa.BigInteger, nullable=False, server_default="0"),
        sa.Column("label", sa.Text),
        sa.Column("owner", sa.Text),
        sa.Column("type", sa.JSON(none_as_null=True)),
        sa.Column("capacity_Ah", sa.Float(53)),
        sa.Column("metadata", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("words", sa.Text, nullable=False),
        sa.Column("created_utc", UTC, nullable=False),
        sa.Column("retired_utc", UTC),
        sa.PrimaryKeyConstraint("id", name="pk_cell"),
    )
    op.create_index("ix_cell_number", "cell", ["number"])
    op.create_table(
        "cell_place",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), nullable=False, autoincrement=True),
        sa.Column("bench", sa.Text, nullable=False),
        sa.Column("cell_id", ID),
        sa.Column("since_utc", UTC, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_cell_place"),
        sa.ForeignKeyConstraint(["cell_id"], ["cell.id"], name="fk_cell_place_cell_id"),
    )
    op.create_index("ix_cell_place_bench", "cell_place", ["bench"])
    # No foreign keys: so a column is added without making its table anew, and cells are never deleted.
    for table in BELONGING:
        op.add_column(table, sa.Column("cell_id", ID))
        op.create_index(f"ix_{table}_cell_id", table, ["cell_id"])


def downgrade() -> None:
    for table in BELONGING:
        op.drop_index(f"ix_{table}_cell_id", table)
        op.drop_column(table, "cell_id")
    op.drop_table("cell_place")
    op.drop_table("cell")
