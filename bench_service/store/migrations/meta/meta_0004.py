"""What people write about a run: label, operator, notes."""

import sqlalchemy as sa
from alembic import op

revision = "meta_0004"
down_revision = "meta_0003"
branch_labels = None
depends_on = None

NAMES = ("label", "operator", "notes")


def upgrade() -> None:
    for name in NAMES:
        op.add_column("run", sa.Column(name, sa.Text))


def downgrade() -> None:
    for name in NAMES:
        op.drop_column("run", name)
