"""Keep which recording the journal of a live flight became.

Why: a live flight is scored, reported and compared as a recording, and becomes one once.
"""

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"


def upgrade() -> None:
    """Add the column; no flight has become one so far."""
    op.add_column("flights", sa.Column("recording_id", sa.String(12)))
    op.create_index("ix_flights_recording_id", "flights", ["recording_id"])


def downgrade() -> None:
    """Drop the column."""
    op.drop_index("ix_flights_recording_id", "flights")
    op.drop_column("flights", "recording_id")
