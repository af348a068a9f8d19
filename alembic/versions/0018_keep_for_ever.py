"""Keep for ever those flights and recordings of which that is said.

Why: what is old, or too much, may be deleted by rule, and some of it must not be.
"""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"

TABLES = ("flights", "recordings")


def upgrade() -> None:
    """Add the column; of nothing it is said so far."""
    for table in TABLES:
        keep = sa.Column("keep", sa.Boolean, nullable=False, server_default=sa.false())
        op.add_column(table, keep)


def downgrade() -> None:
    """Drop the column."""
    for table in TABLES:
        op.drop_column(table, "keep")
