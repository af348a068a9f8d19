"""Sessions of browsers, which outlast a server."""

from alembic import op

from app.store.tables import sessions

revision = "0031"
down_revision = "0030"


def upgrade() -> None:
    """A new table only; a database of 0.1.0 has it from the first migration."""
    sessions.create(op.get_bind(), checkfirst=True)
