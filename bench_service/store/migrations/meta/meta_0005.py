"""Protocols, and runs that play one in place of a profile."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0005"
down_revision = "meta_0004"
branch_labels = None
depends_on = None

ID = sa.String(64)


def upgrade() -> None:
    op.create_table(
        "protocol",
        sa.Column("id", ID, nullable=False),
        sa.Column("number", sa.BigInteger, nullable=False, server_default="0"),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("sha256", ID, nullable=False),
        sa.Column("n_steps", sa.Integer, nullable=False),
        sa.Column("created_utc", sa.String(32), nullable=False),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_protocol"),
    )
    op.create_index("ix_protocol_number", "protocol", ["number"])
    op.create_index("ix_protocol_created_utc", "protocol", ["created_utc"])
    # Nothing refers to a run by a foreign key, so that its table may be made anew where a column cannot be changed.
    with op.batch_alter_table("run") as table:
        table.alter_column("profile_id", existing_type=ID, nullable=True)
        table.add_column(sa.Column("protocol_id", ID))
        table.add_column(sa.Column("on_interruption", sa.String(16)))
        table.add_column(sa.Column("standing", sa.JSON(none_as_null=True)))
        table.create_foreign_key("fk_run_protocol_id", "protocol", ["protocol_id"], ["id"])


def downgrade() -> None:
    with op.batch_alter_table("run") as table:
        table.drop_constraint("fk_run_protocol_id", type_="foreignkey")
        table.drop_column("standing")
        table.drop_column("on_interruption")
        table.drop_column("protocol_id")
        table.alter_column("profile_id", existing_type=ID, nullable=False)
    op.drop_index("ix_protocol_created_utc", "protocol")
    op.drop_index("ix_protocol_number", "protocol")
    op.drop_table("protocol")
