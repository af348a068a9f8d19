"""Digests of the journals of ended live flights."""

import sqlalchemy as sa
from alembic import op

revision = "0030"
down_revision = "0029"


def upgrade() -> None:
    """A journal that has become a recording has the digest of the recording's file."""
    op.add_column("flights", sa.Column("journal_digest", sa.String(64)))
    op.execute(
        "UPDATE flights SET journal_digest = (SELECT recordings.digest FROM recordings "
        "WHERE recordings.id = flights.recording_id AND recordings.complete)"
    )
