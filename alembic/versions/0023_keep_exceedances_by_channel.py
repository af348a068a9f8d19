"""Keep how often a flight exceeded the limit of each channel, how far, and which limits held.

Why: its headline told the first exceedance alone, and its record drew none of the limits of a set.
"""

import sqlalchemy as sa
from alembic import op

revision = "0023"
down_revision = "0022"


def upgrade() -> None:
    """Add the columns; of flights so far their alarms tell."""
    op.add_column("flights", sa.Column("exceedances", sa.JSON))
    op.add_column("flights", sa.Column("limits_held", sa.JSON))


def downgrade() -> None:
    """Drop the columns."""
    op.drop_column("flights", "limits_held")
    op.drop_column("flights", "exceedances")
