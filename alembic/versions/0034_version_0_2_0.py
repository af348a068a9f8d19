"""From the schema of the first databases of version 0.2.0 to that of the last ones."""

from typing import Any

import sqlalchemy as sa
from alembic import op

from app.store.tables import UNCOMPRESSED, metadata

revision = "0034"
down_revision = "0024"

NEW_COLUMNS: dict[str, tuple[sa.Column[Any], ...]] = {
    "datasets": (sa.Column("dictionary", sa.JSON), sa.Column("findings", sa.JSON)),
    "monitors": (sa.Column("dictionary", sa.JSON),),
    "flights": (
        sa.Column("summary", sa.JSON),
        sa.Column("journal_digest", sa.String(64)),
        sa.Column("end_reason", sa.Text),
    ),
    "alarms": (
        sa.Column("channels", sa.JSON),
        sa.Column("cause", sa.String(32)),
        sa.Column("arrived", sa.Float),
        sa.Column("manoeuvre", sa.Integer),
    ),
}


def upgrade() -> None:
    """Every row stays. The program summarizes the flights that have ended when it starts."""
    metadata.create_all(op.get_bind())  # the new tables; 0024 has made them in a database of 0.1.0
    for table, columns in NEW_COLUMNS.items():
        for column in columns:
            op.add_column(table, column)
    for table in ("flights", "recordings"):
        op.create_index(f"ix_{table}_created", table, ["created", "id"])
    # a journal that has become a recording has the digest of the recording's file
    op.execute(
        "UPDATE flights SET journal_digest = (SELECT recordings.digest FROM recordings "
        "WHERE recordings.id = flights.recording_id AND recordings.complete)"
    )
    if op.get_bind().dialect.name == "postgresql":
        op.execute(UNCOMPRESSED)
