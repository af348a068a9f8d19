"""Keep with a flight that is over the first exceedance that it had come to.

Why: one that was passed by a seek has raised no alarm, and still was exceeded. What earlier
versions stored says it by its alarms alone.
"""

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"


def upgrade() -> None:
    """Add the column; every row stays."""
    op.add_column("flights", sa.Column("exceeded_t", sa.Float))


def downgrade() -> None:
    """Drop the column."""
    op.drop_column("flights", "exceeded_t")
