"""Numbers that order rows whatever the clock does; damage, elapsed time and removal of runs; progress of campaigns."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0003"
down_revision = "meta_0002"
branch_labels = None
depends_on = None

NUMBERED = ("profile", "campaign", "model", "run", "comparison", "diagnosis")
RUN = {
    "damage": sa.Text,
    "elapsed_s": sa.Float(53),
    "continues": sa.String(64),
    "repaired_utc": sa.String(32),
    "removed_utc": sa.String(32),
}


def upgrade() -> None:
    for table in NUMBERED:
        op.add_column(table, sa.Column("number", sa.BigInteger, nullable=False, server_default="0"))
        op.execute(sa.text(_NUMBER[op.get_bind().dialect.name == "sqlite"].format(table=table)))
        op.create_index(f"ix_{table}_number", table, ["number"])
    for name, kind in RUN.items():
        op.add_column("run", sa.Column(name, kind))
    op.add_column("campaign", sa.Column("done", sa.JSON(none_as_null=True)))


def downgrade() -> None:
    op.drop_column("campaign", "done")
    for name in RUN:
        op.drop_column("run", name)
    for table in NUMBERED:
        op.drop_index(f"ix_{table}_number", table)
        op.drop_column(table, "number")


# SQLite still knows in which order rows came; elsewhere only the clock tells.
_NUMBER = {
    True: "UPDATE {table} SET number = rowid",
    False: "UPDATE {table} SET number = (SELECT count(*) FROM {table} AS o WHERE o.created_utc < {table}.created_utc"
    " OR (o.created_utc = {table}.created_utc AND o.id <= {table}.id))",
}
