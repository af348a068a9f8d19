"""Keep with a scoring which limits were in force while its recording was flown.

Why: an exceedance is judged by the limits in force, and every view has to say which these were.
"""

import sqlalchemy as sa
from alembic import op

revision = "0022"
down_revision = "0021"


def upgrade() -> None:
    """Add the column; of no scoring it is known so far."""
    op.add_column("scorings", sa.Column("limits_in_force", sa.JSON))


def downgrade() -> None:
    """Drop the column."""
    op.drop_column("scorings", "limits_in_force")
